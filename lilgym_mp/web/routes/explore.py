"""/explore: the statements of the corpus, searched and filtered, each with everything that is known of it."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Query, Request, Response

from lilgym_mp.analysis.phenomena import Phenomenon
from lilgym_mp.web import corpus_statements
from lilgym_mp.web.app_services import ServicesOf
from lilgym_mp.web.field_types import Name
from lilgym_mp.web.templating import page

router = APIRouter()
api = APIRouter(prefix="/api/explore", tags=["explore"])

AppearanceName = Literal["tower", "scatter"]
SplitName = Literal["train", "dev", "test"]
Count = Annotated[int, Query(ge=0, le=1_000_000)]
TextQuery = Annotated[str, Query(max_length=200)]


@router.get("/explore", include_in_schema=False)
def explore_page(request: Request) -> Response:
    return page(request, "explore.html")


@router.get("/explore/{appearance}/{split}/{statement_id:path}", include_in_schema=False)
def statement_page(
    request: Request, services: ServicesOf, appearance: AppearanceName, split: SplitName, statement_id: str
) -> Response:
    found = corpus_statements.find(services.catalogue, appearance, split, statement_id)
    query = {"appearance": appearance, "split": split, "statement_id": found.id}
    return page(request, "explore_statement.html", statement=found.statement, query=query)


@api.get("/choices")
def choices(
    services: ServicesOf, appearance: AppearanceName = "tower", split: SplitName = "dev"
) -> corpus_statements.ChoicesBody:
    """What the statements can be filtered by."""
    return corpus_statements.choices(services.catalogue, appearance, split)


@api.get("/statements")
def statements(
    services: ServicesOf,
    appearance: AppearanceName = "tower",
    split: SplitName = "dev",
    text: TextQuery = "",
    phenomenon: Phenomenon | None = None,
    word: TextQuery | None = None,
    least: Count = 0,
    most: Count = 1_000,
    first: Count = 0,
) -> corpus_statements.StatementsBody:
    """Statements that hold the text (in the statement, the program or as the id) and pass the filters."""
    return corpus_statements.search(
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
    services: ServicesOf,
    statement_id: Annotated[Name, Query()],
    appearance: AppearanceName = "tower",
    split: SplitName = "dev",
) -> corpus_statements.StatementBody:
    """A statement with its program, scenes, solutions and what recorded runs did with it."""
    found = corpus_statements.find(services.catalogue, appearance, split, statement_id)
    return corpus_statements.statement_body(services.catalogue, found, appearance, services.outcomes)


router.include_router(api)
