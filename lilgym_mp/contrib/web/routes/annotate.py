"""/annotate: write a program for a statement, run it on shown scenes, and submit it to be checked on hidden ones.

The procedure of the paper (Wu et al. 2023, Figure 8), for the statements of the served corpus and their FlipIt scenes.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from fastapi import APIRouter, Depends, HTTPException, Request, Response
from pydantic import BaseModel, StringConstraints

from lilgym_mp.contrib.web.app_services import Services
from lilgym_mp.contrib.web.bodies import JSON, AppearanceName, Name, SplitName, parts_body, pick, scene_body
from lilgym_mp.contrib.web.database import ANNOTATION_COLUMNS, now, save_row
from lilgym_mp.contrib.web.responses import render_page
from lilgym_mp.contrib.web.routes.explore import CorpusStatement, FoundStatement, list_statements
from lilgym_mp.corpus.records import FLIPIT
from lilgym_mp.evaluation.files import json_line
from lilgym_mp.programs import ProgramError, ProgramRuntimeError
from lilgym_mp.programs.compiler import Program
from lilgym_mp.programs.syntax import MAX_LENGTH, parse
from lilgym_mp.programs.vocabulary import vocabulary
from lilgym_mp.scene import Scene

router = APIRouter()
api = APIRouter(prefix="/api/annotate", tags=["annotate"])

IDENTITY = ("name", "corpus", "appearance", "split", "statement_id", "program")  # posted twice: one row
STEP_LIMIT = 1_000_000  # of a program on a scene, as a person may submit any: about 0.1 seconds
ACCEPTED = "Saved: your program has the statement's value in every scene, hidden ones included."
FAILED = "Saved, but your program does not have the statement's value in every hidden scene. Reread the statement."


class ProgramBody(BaseModel):
    """Request with the text of a program."""

    program: Annotated[str, StringConstraints(max_length=2 * MAX_LENGTH)]


class NewAnnotation(ProgramBody):
    """Request to keep a program under the annotator's name."""

    name: Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=80)]


class LabelledScenes(NamedTuple):
    """The scenes of a statement with its value there: those shown, and those that only check submissions."""

    of: CorpusStatement
    shown: list[tuple[Scene, bool]]
    hidden: list[tuple[Scene, bool]]


def get_scenes(found: FoundStatement) -> LabelledScenes:
    """Responds with 404 if there is no such statement, or it has a program but no FlipIt scenes."""
    scenes = [(task.start, not task.target) for start, task in found.tasks if start == FLIPIT]
    if found.program and not scenes:
        raise HTTPException(404, f"the statement {found.id!r} has no FlipIt scenes; choose another")
    middle = (len(scenes) + 1) // 2
    return LabelledScenes(found, scenes[:middle], scenes[middle:])


Scenes = Annotated[LabelledScenes, Depends(get_scenes)]


@router.get("/annotate", include_in_schema=False)
def annotate_page(request: Request, services: Services) -> Response:
    """The page on which visitors write programs for statements."""
    words = [word._asdict() for word in vocabulary()]
    return render_page(request, "annotate.html", appearances=services.appearances(needs_tasks=False), words=words)


@api.post("/check")
def check(text: ProgramBody) -> JSON:
    """Whether a text parses as a program; if not, the error and its position in characters, from 0."""
    try:
        parse(text.program)
    except ProgramError as fault:
        return {"ok": False, "offset": fault.offset, "length": max(1, len(fault.piece)), "message": fault.reason}
    return {"ok": True, "offset": 0, "length": 0, "message": ""}


@api.get("/statements")
def statements(
    services: Services, appearance: AppearanceName = "tower", split: SplitName = "dev", name: Name = ""
) -> list[JSON]:
    """The statements with FlipIt scenes or without a program.

    Each says whether the annotator called `name` has an accepted program for it.
    """
    done = "SELECT statement_id FROM annotations WHERE corpus=? AND appearance=? AND split=? AND name=? AND accepted"
    with services.database.read() as connection:
        ids = {row[0] for row in connection.execute(done, (services.corpus, appearance, split, name.strip()))}
    return [
        {**pick(statement, "id", "statement"), "done": statement.id in ids}
        for statement in list_statements(services, appearance, split)
        if not statement.program or any(start == FLIPIT for start, _ in statement.tasks)
    ]


@api.get("/statement")
def statement(scenes: Scenes) -> JSON:
    """A statement with the scenes shown to annotators and its value there; of the others, only the number."""
    shown = [{"label": label, "scene": scene_body(scene)} for scene, label in scenes.shown]
    return {"statement": scenes.of.statement, "shown": shown, "hidden": len(scenes.hidden)}


@api.post("/run")
def run(scenes: Scenes, written: ProgramBody) -> list[JSON]:
    """A program's value on each shown scene, part by part; null where it has none, with the error in `fault`."""
    program = Program(written.program)
    return [
        {**_value(program, scene), "label": label, "parts": parts_body(program.source, scene, STEP_LIMIT)}
        for scene, label in scenes.shown
    ]


@api.post("/annotations", status_code=201)
def submit(scenes: Scenes, new: NewAnnotation, services: Services) -> JSON:
    """Saves a program that agrees with the shown scenes, after checking it on the hidden ones.

    Responds with 409 if it disagrees with a shown scene, or has no value on the empty scene, as every program must.
    """
    program = Program(new.program)
    shown, hidden = (
        all(_value(program, scene)["truth"] is label for scene, label in part) for part in (scenes.shown, scenes.hidden)
    )
    if not shown:
        raise HTTPException(409, "the program does not agree with the shown scenes; run it, and submit it once it does")
    if fault := _value(program, Scene.empty())["fault"]:
        raise HTTPException(409, f"the program fails on a scene without items ({fault}); it needs a value everywhere")
    about = {"corpus": services.corpus, "statement_id": scenes.of.id, "accepted": hidden, "created": now()}
    row = {"comment": "", **new.model_dump(), **about, **pick(scenes.of, "appearance", "split", "statement")}
    with services.database.write() as connection:
        same = " AND ".join(f"{name}=:{name}" for name in IDENTITY)
        if not connection.execute(f"SELECT 1 FROM annotations WHERE {same}", row).fetchone():
            save_row(connection, "annotations", row)
    return {"accepted": hidden, "message": ACCEPTED if hidden else FAILED}


@api.get("/annotations", response_class=Response)
def download(services: Services) -> Response:
    """All annotations in the database, as JSON lines in the order of their submission."""
    with services.database.read() as connection:
        found = connection.execute(f"SELECT {', '.join(ANNOTATION_COLUMNS)} FROM annotations ORDER BY id")
        rows = [{**dict(row), "accepted": bool(row["accepted"])} for row in found]
    text = "".join(map(json_line, rows))
    headers = {"Content-Disposition": 'attachment; filename="annotations.jsonl"'}
    return Response(text, media_type="application/jsonl", headers=headers)


def _value(program: Program, scene: Scene) -> JSON:
    try:
        return {"truth": program.evaluate(scene, step_limit=STEP_LIMIT), "fault": None}
    except ProgramRuntimeError as fault:
        return {"truth": None, "fault": str(fault)}
