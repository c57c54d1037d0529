"""/annotate: write a program for a statement, run it on shown scenes, and submit it to be checked on hidden ones.

The procedure of the paper (Wu et al. 2023, Figure 8), for the statements of the served corpus and their FlipIt scenes.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from typing import Annotated, NamedTuple

from anyio.to_thread import run_sync
from fastapi import APIRouter, Depends, Query, Request, Response
from pydantic import AfterValidator, BaseModel, StringConstraints
from sqlalchemy import select

from lilgym_mp.contrib.web import language
from lilgym_mp.contrib.web.app_services import AppServices, Services
from lilgym_mp.contrib.web.bodies import JSON, pick, scene_body
from lilgym_mp.contrib.web.database import Annotation, Database
from lilgym_mp.contrib.web.errors import http_error
from lilgym_mp.contrib.web.field_types import AppearanceName, Name, ShortText, SplitName, storable
from lilgym_mp.contrib.web.program_evaluator import EvaluatorBusy, ProgramEvaluationError, SceneValue
from lilgym_mp.contrib.web.routes.explore import find_statement, list_statements
from lilgym_mp.contrib.web.templating import render_page
from lilgym_mp.corpus.records import FLIPIT
from lilgym_mp.programs.syntax import MAX_LENGTH
from lilgym_mp.scene import Scene
from lilgym_mp.scene.appearances import APPEARANCES

router = APIRouter()
api = APIRouter(prefix="/api/annotate", tags=["annotate"])

ACCEPTED = "Saved: your program has the statement's value in every scene, hidden ones included."
FAILED = "Saved, but your program does not have the statement's value in every hidden scene. Reread the statement."
DOWNLOAD_HEADERS = {"Content-Disposition": 'attachment; filename="annotations.jsonl"'}
ProgramText = Annotated[str, StringConstraints(max_length=2 * MAX_LENGTH), AfterValidator(storable)]
Annotator = Annotated[
    str, StringConstraints(strip_whitespace=True, min_length=1, max_length=80), AfterValidator(storable)
]


class ProgramBody(BaseModel):
    program: ProgramText


class NewAnnotation(ProgramBody):
    name: Annotator
    comment: ShortText = ""


class AnnotatedStatement(NamedTuple):
    """A statement of the corpus with labelled scenes: those shown, and those that only check submissions."""

    id: str
    appearance: str
    split: str
    text: str
    shown: list[tuple[Scene, bool]]
    hidden: list[tuple[Scene, bool]]


def get_statement(
    services: Services,
    statement_id: Annotated[Name, Query()],
    appearance: AppearanceName = "tower",
    split: SplitName = "dev",
) -> AnnotatedStatement:
    """Responds with 404 if there is no such statement, or it has no FlipIt scenes."""
    found = find_statement(services.catalogue, appearance, split, statement_id)
    scenes = [(task.start, task.truth(task.start)) for start, task in found.tasks if start == FLIPIT]
    if not scenes:
        raise http_error(404, f"the statement {statement_id!r} has no FlipIt scenes; choose another")
    middle = (len(scenes) + 1) // 2
    return AnnotatedStatement(found.id, appearance, split, found.statement, scenes[:middle], scenes[middle:])


CurrentStatement = Annotated[AnnotatedStatement, Depends(get_statement)]


@router.get("/annotate", include_in_schema=False)
def annotate_page(request: Request) -> Response:
    return render_page(request, "annotate.html", appearances=list(APPEARANCES))


@api.get("/language")
def words() -> JSON:
    """All words of the program language, with signatures and documentation."""
    return language.language()


@api.post("/check")
def check(text: ProgramBody) -> JSON:
    """Checks the syntax of a program."""
    return language.check(text.program)


@api.get("/statements")
def statements(
    services: Services, appearance: AppearanceName = "tower", split: SplitName = "dev", name: Name = ""
) -> list[JSON]:
    """The statements with FlipIt scenes, and whether the annotator called `name` has an accepted program for each."""
    catalogue = services.catalogue
    done = select(Annotation.statement_id).where(
        Annotation.corpus == catalogue.corpus,
        Annotation.appearance == appearance,
        Annotation.split == split,
        Annotation.name == name.strip(),
        Annotation.accepted,
    )
    with services.database.read() as session:
        ids = set(session.scalars(done))
    return [
        {**pick(statement, "id", "statement"), "done": statement.id in ids}
        for statement in list_statements(catalogue, appearance, split)
        if any(start == FLIPIT for start, _ in statement.tasks)
    ]


@api.get("/statement")
def statement(found: CurrentStatement) -> JSON:
    """A statement with the scenes shown to annotators and its value there; of the others, only the number."""
    shown = [{"label": label, "scene": scene_body(scene)} for scene, label in found.shown]
    return {"statement": found.text, "shown": shown, "hidden": len(found.hidden)}


@api.post("/run")
async def run(found: CurrentStatement, written: ProgramBody, services: Services) -> list[JSON]:
    """A program's value on each shown scene, part by part; null where it has none, with the error in `fault`."""
    values = await _evaluate(services, written.program, [scene for scene, _ in found.shown], traced=True)
    return [
        {**pick(value, "truth", "fault"), "label": label, "parts": [part._asdict() for part in value.parts]}
        for value, (_, label) in zip(values, found.shown, strict=True)
    ]


@api.post("/annotations", status_code=201)
async def submit(found: CurrentStatement, new: NewAnnotation, services: Services) -> JSON:
    """Saves a program that agrees with the shown scenes, after checking it on the hidden ones.

    Responds with 409 if it disagrees with a shown scene, or has no value on the empty scene, as every program must.
    """
    scenes, labels = zip(*found.shown, *found.hidden, strict=True)
    *values, empty = await _evaluate(services, new.program, [*scenes, Scene.empty()])
    agrees = [value.truth is label for value, label in zip(values, labels, strict=True)]
    if not all(agrees[: len(found.shown)]):
        raise http_error(409, "the program does not agree with the shown scenes; run it, and submit it once it does")
    if empty.truth is None:
        raise http_error(
            409, f"the program fails on a scene without items ({empty.fault}); it must have a value in every scene"
        )
    row = Annotation(
        corpus=services.catalogue.corpus,
        appearance=found.appearance,
        split=found.split,
        statement_id=found.id,
        statement=found.text,
        accepted=all(agrees),
        **new.model_dump(),
    )
    await run_sync(_save, services.database, row)
    return {"accepted": all(agrees), "message": ACCEPTED if all(agrees) else FAILED}


@api.get("/annotations", response_class=Response)
def download(services: Services) -> Response:
    """All annotations in the database, as JSON lines in the order of their submission."""
    with services.database.read() as session:
        text = "".join(_lines(session.scalars(select(Annotation).order_by(Annotation.id))))
    return Response(text, media_type="application/jsonl", headers=DOWNLOAD_HEADERS)


def _lines(rows: Iterable[Annotation]) -> Iterator[str]:
    names = [column.name for column in Annotation.__table__.columns]
    for row in rows:
        yield json.dumps({name: getattr(row, name) for name in names}, ensure_ascii=False) + "\n"


def _save(database: Database, row: Annotation) -> None:
    with database.write() as session:
        session.add(row)


async def _evaluate(
    services: AppServices, program: str, scenes: Sequence[Scene], *, traced: bool = False
) -> list[SceneValue]:
    """Responds with 422 for an invalid program or one that exceeds a limit, 503 if all workers stay busy."""
    try:
        return await services.evaluator.evaluate(program, scenes, traced=traced)
    except ProgramEvaluationError as fault:
        raise http_error(422, str(fault)) from None
    except EvaluatorBusy:
        raise http_error(503, "too many programs are running; your text is kept: try again in a moment") from None
