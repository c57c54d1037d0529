"""/explore: search and filter the statements of the corpus, and show everything known about one."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response

from lilgym_mp.analysis.phenomena import Phenomenon
from lilgym_mp.appearances import APPEARANCES
from lilgym_mp.web import corpus_statements
from lilgym_mp.web.app_services import Services
from lilgym_mp.web.field_types import AppearanceName, Name, SplitName
from lilgym_mp.web.scene_images import png
from lilgym_mp.web.templating import render_page

router = APIRouter()
api = APIRouter(prefix="/api/explore", tags=["explore"])

Count = Annotated[int, Query(ge=0, le=1_000_000)]
TextQuery = Annotated[str, Query(max_length=200)]


@router.get("/explore", include_in_schema=False)
def explore_page(request: Request) -> Response:
    return render_page(request, "explore.html", appearances=list(APPEARANCES))


@router.get("/explore/{appearance}/{split}/{statement_id:path}", include_in_schema=False)
def statement_page(
    request: Request, services: Services, appearance: AppearanceName, split: SplitName, statement_id: str
) -> Response:
    found = corpus_statements.find_statement(services.catalogue, appearance, split, statement_id)
    query = {"appearance": appearance, "split": split, "statement_id": found.id}
    return render_page(request, "explore_statement.html", statement=found.statement, query=query)


@api.get("/choices")
def choices(
    services: Services, appearance: AppearanceName = "tower", split: SplitName = "dev"
) -> corpus_statements.ChoicesBody:
    """Filter values, with the number of statements for each."""
    return corpus_statements.filter_choices(services.catalogue, appearance, split)


@api.get("/statements")
def statements(
    services: Services,
    appearance: AppearanceName = "tower",
    split: SplitName = "dev",
    text: TextQuery = "",
    phenomenon: Phenomenon | None = None,
    word: TextQuery | None = None,
    least: Count = 0,
    most: Count = 1_000,
    first: Count = 0,
) -> corpus_statements.StatementsBody:
    """Statements that contain the text (in statement or program, or as the whole id) and match the filters."""
    return corpus_statements.search_statements(
        services.catalogue,
        appearance,
        split,
        text=text,
        phenomenon=None if phenomenon is None else str(phenomenon),
        word=word,
        least=least,
        most=most,
        first=first,
    )


@api.get("/statement")
def statement(
    services: Services,
    statement_id: Annotated[Name, Query()],
    appearance: AppearanceName = "tower",
    split: SplitName = "dev",
) -> corpus_statements.StatementBody:
    """A statement with its program, scenes, solutions and outcomes of recorded episodes."""
    found = corpus_statements.find_statement(services.catalogue, appearance, split, statement_id)
    return corpus_statements.statement_body(services.catalogue, found, appearance, services.recorded_outcomes)


@api.get("/picture", response_class=Response)
def picture(
    services: Services,
    statement_id: Annotated[Name, Query()],
    appearance: AppearanceName = "tower",
    split: SplitName = "dev",
) -> Response:
    """A start scene of a statement, as a PNG image; the last one, as scenes to flip follow the empty one."""
    found = corpus_statements.find_statement(services.catalogue, appearance, split, statement_id)
    return Response(png(found.tasks[-1][1].start), media_type="image/png")


router.include_router(api)
