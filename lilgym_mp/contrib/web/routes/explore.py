"""/explore: search and filter the statements of the corpus, and show everything known about one."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, NamedTuple

from fastapi import APIRouter, Depends, HTTPException, Query, Request, Response

from lilgym_mp.contrib.web.app_services import AppServices, Services
from lilgym_mp.contrib.web.bodies import JSON, AppearanceName, Name, SplitName, parts_body, pick, png, scene_body
from lilgym_mp.contrib.web.responses import render_page
from lilgym_mp.corpus import NoTasksError, load_tasks, words
from lilgym_mp.corpus.records import FLIPIT, SCRATCH
from lilgym_mp.envs.registration import CONFIGURATIONS, configuration_name
from lilgym_mp.programs.task import Task

router = APIRouter()
api = APIRouter(prefix="/api/explore", tags=["explore"])

PAGE_SIZE = 30  # statements
STATEMENT_CACHE_SIZE = 12  # (appearance, split) pairs
MAX_SCENES = 12  # per statement


@router.get("/explore", include_in_schema=False)
def explore_page(
    request: Request,
    services: Services,
    appearance: AppearanceName | None = None,
    split: SplitName = "dev",
    text: Annotated[str, Query(max_length=200)] = "",
    first: Annotated[int, Query(ge=0, le=1_000_000)] = 0,
) -> Response:
    """Statements that contain the text, also in the program or as the whole id, by default of the first appearance."""
    appearances = services.appearances(needs_tasks=False)
    appearance = appearance or next(name for name, text in appearances.items() if name == text)
    needle = text.lower()
    found = [
        statement
        for statement in list_statements(services, appearance, split)
        if needle in f"{statement.statement}\n{statement.program}".lower() or needle == statement.id.lower()
    ]
    return render_page(
        request,
        "explore.html",
        appearances=appearances,
        query={"appearance": appearance, "split": split, "text": text},
        found=found[first : first + PAGE_SIZE],
        total=len(found),
        first=first,
        size=PAGE_SIZE,
    )


class CorpusStatement(NamedTuple):
    """A statement of the corpus with its program ("": none) and tasks."""

    appearance: str
    split: str
    id: str
    statement: str
    program: str
    length: int  # in words
    tasks: list[tuple[str, Task]]  # with their starts


def find_statement(
    services: Services, statement_id: Name, appearance: AppearanceName = "tower", split: SplitName = "dev"
) -> CorpusStatement:
    """The statement of the task with that id. Responds with 404 if there is none."""
    for statement in list_statements(services, appearance, split):
        if any(task.id == statement_id for _, task in statement.tasks):
            return statement
    raise HTTPException(404, f"there is no statement {statement_id!r} of {appearance} in {split}")


FoundStatement = Annotated[CorpusStatement, Depends(find_statement)]


@router.get("/explore/{appearance}/{split}/{statement_id:path}", include_in_schema=False)
def statement_page(request: Request, found: FoundStatement) -> Response:
    """The page of one statement of the corpus."""
    return render_page(request, "explore_statement.html", found=found)


@api.get("/statement")
def statement(found: FoundStatement, services: Services) -> JSON:
    """A statement with its program, scenes and solutions."""
    return {
        **pick(found, "id", "statement"),
        "program": found.program or None,
        "scenes": [
            _scene(services, configuration_name(found.appearance, start), task)
            for start, task in found.tasks[:MAX_SCENES]
        ],
    }


@api.get("/picture", response_class=Response)
def picture(found: FoundStatement) -> Response:
    """A start scene of a statement, as a PNG image; the last one, as scenes to flip follow the empty one."""
    return Response(png(found.tasks[-1][1].start), media_type="image/png")


@lru_cache(STATEMENT_CACHE_SIZE)
def list_statements(services: AppServices, appearance: str, split: str) -> tuple[CorpusStatement, ...]:
    """The statements of an appearance and split, in file order. Responds with 404 if there are none."""
    found: dict[tuple[str, str], CorpusStatement] = {}
    for start in (SCRATCH, FLIPIT):
        try:
            tasks = load_tasks(services.corpus, appearance, start, split, needs_tasks=False)
        except NoTasksError:
            continue
        for task in (*tasks, *tasks.without_program):
            said = task.statement
            program = task.program
            new = CorpusStatement(appearance, split, task.id, said, program, len(words(said)), [])
            found.setdefault((said, program), new).tasks.append((start, task))
    if not found:
        raise HTTPException(404, f"the corpus has no {appearance} statements in {split}")
    return tuple(found.values())


def _scene(services: AppServices, configuration: str, task: Task) -> JSON:
    """A start scene, and the number of actions of a shortest solution, if one is found.

    Without a program, the truth is the scene's label, null for the empty scene.
    """
    if not task.program:
        is_labelled = CONFIGURATIONS[configuration][1] == FLIPIT
        return {
            "configuration": configuration,
            "task_id": task.id,
            "truth": not task.target if is_labelled else None,
            "scene": scene_body(task.start),
        }
    return {
        "configuration": configuration,
        "task_id": task.id,
        "target": task.target,
        "truth": task.truth(task.start),
        "scene": scene_body(task.start),
        "steps": services.shortest(configuration, task),
        "parts": parts_body(task.program, task.start),
    }
