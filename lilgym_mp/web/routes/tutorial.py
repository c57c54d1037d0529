"""/annotate/tutorial: small annotation tasks with advice, for new annotators."""

from __future__ import annotations

from typing import NamedTuple

from fastapi import APIRouter, Request, Response
from sqlalchemy import select

from lilgym_mp.scene import Colour, Item, Scene, Shape, Size
from lilgym_mp.web.app_services import Services
from lilgym_mp.web.authentication import CurrentPerson
from lilgym_mp.web.bodies import Body, SceneBody, scene_body
from lilgym_mp.web.errors import http_error
from lilgym_mp.web.field_types import RandomId
from lilgym_mp.web.routes.annotate import (
    ACCEPTED,
    ProgramBody,
    RunBody,
    VerdictBody,
    check_program,
    run_program,
    verdict_body,
)
from lilgym_mp.web.store.models import TutorialAnswer
from lilgym_mp.web.templating import render_page

router = APIRouter()
api = APIRouter(prefix="/api/annotate/tutorial", tags=["annotate"])


class TutorialTask(NamedTuple):
    """A statement with labelled scenes: the first is shown, the others are hidden."""

    name: str
    title: str
    statement: str
    advice: str
    scenes: tuple[tuple[Scene, bool], ...]


def _block(level: int, colour: Colour) -> Item:
    return Item(40, 80 - 21 * level, Shape.SQUARE, colour, Size.MEDIUM)


def _towers(*colours: str) -> Scene:
    """A scene of towers; each string names the colours (y, k, b) of a box from the bottom up."""
    by_letter = {"y": Colour.YELLOW, "k": Colour.BLACK, "b": Colour.BLUE}
    return Scene.of(*([_block(level, by_letter[letter]) for level, letter in enumerate(box)] for box in colours))


def _item(x: int, y: int, shape: Shape, colour: Colour, size: Size = Size.MEDIUM) -> Item:
    return Item(x, y, shape, colour, size)


_CIRCLE, _SQUARE, _TRIANGLE = Shape
_YELLOW, _BLACK, _BLUE = Colour

TASKS: tuple[TutorialTask, ...] = (
    TutorialTask(
        "exist",
        "Existence",
        "At least one of the items is blue.",
        "filter_obj(items, condition) keeps the items for which the condition holds; exist(...) is true if any are "
        "left. all_items holds the items of all three boxes. Try: exist(filter_obj(all_items, lambda x: is_blue(x)))",
        (
            (_towers("yb", "k", ""), True),
            (_towers("yk", "k", ""), False),
            (_towers("", "", "b"), True),
            (_towers("", "", ""), False),
        ),
    ),
    TutorialTask(
        "count",
        "Counting boxes",
        "Exactly two towers have a black block at the base.",
        "all_boxes holds the three boxes; a box can be used wherever a collection of items is expected. is_bottom(x) "
        "is true if the item is the lowest in its box. Count the boxes that hold such an item: "
        "equal_int(count(filter_obj(all_boxes, lambda b: ...)), 2)",
        (
            (_towers("ky", "kb", "yk"), True),
            (_towers("ky", "kb", "k"), False),
            (_towers("k", "bk", "y"), False),
            (_towers("kkk", "", "kb"), True),
        ),
    ),
    TutorialTask(
        "faithful",
        "Be faithful to the statement",
        "Every triangle is yellow.",
        "A program that agrees with the shown scene may still fail on the hidden ones: here it is also true that some "
        "triangle is yellow, but that is not what the statement says. Express what it says, as briefly as possible: "
        "All(items, condition).",
        (
            (Scene.of([_item(5, 70, _TRIANGLE, _YELLOW)], [_item(30, 30, _CIRCLE, _BLACK)], []), True),
            (Scene.of([_item(5, 70, _TRIANGLE, _YELLOW)], [_item(30, 30, _TRIANGLE, _BLACK)], []), False),
            (Scene.of([_item(5, 5, _CIRCLE, _BLUE)], [_item(30, 30, _TRIANGLE, _YELLOW)], []), True),
            (Scene.of([], [_item(30, 30, _TRIANGLE, _BLUE)], [_item(60, 60, _TRIANGLE, _YELLOW)]), False),
        ),
    ),
    TutorialTask(
        "touching",
        "Touching",
        "A circle touches a wall.",
        "is_touching_wall(x) takes an item and, if the statement names one, a side such as Side.BOTTOM.",
        (
            (Scene.of([_item(0, 40, _CIRCLE, _BLUE)], [_item(40, 80, _SQUARE, _BLACK)], []), True),
            (Scene.of([_item(30, 40, _CIRCLE, _BLUE)], [_item(40, 80, _SQUARE, _BLACK)], []), False),
            (Scene.of([], [_item(40, 80, _CIRCLE, _BLACK)], [_item(10, 10, _CIRCLE, _YELLOW)]), True),
            (Scene.of([], [_item(80, 10, _TRIANGLE, _BLACK)], [_item(10, 10, _CIRCLE, _YELLOW)]), False),
        ),
    ),
)
TASKS_BY_NAME = {task.name: task for task in TASKS}


class TutorialTaskBody(Body):
    name: str
    title: str
    statement: str
    advice: str
    label: bool
    scene: SceneBody
    hidden_scenes: int
    solved: bool


@router.get("/annotate/tutorial", include_in_schema=False)
def tutorial_page(request: Request, person: CurrentPerson) -> Response:
    return render_page(request, "annotate_tutorial.html")


@api.get("")
def tutorial_tasks(services: Services, person: CurrentPerson) -> list[TutorialTaskBody]:
    with services.database.read_session() as session:
        solved = set(session.scalars(select(TutorialAnswer.task).where(TutorialAnswer.person_id == person.id)))
    return [
        TutorialTaskBody.of(
            task,
            label=task.scenes[0][1],
            scene=scene_body(task.scenes[0][0]),
            hidden_scenes=len(task.scenes) - 1,
            solved=task.name in solved,
        )
        for task in TASKS
    ]


@api.post("/{name}/run")
async def run_tutorial(services: Services, person: CurrentPerson, name: RandomId, written: ProgramBody) -> RunBody:
    return await run_program(services, person, written.program, *_tutorial_task(name).scenes[0])


@api.post("/{name}/submissions", status_code=201)
async def submit_tutorial(
    services: Services, person: CurrentPerson, name: RandomId, written: ProgramBody
) -> VerdictBody:
    verdict = await check_program(services, person, written.program, _tutorial_task(name).scenes, 0)
    if verdict == ACCEPTED:
        answer = TutorialAnswer(person_id=person.id, task=name, program=written.program)
        await services.database.write(lambda session: session.merge(answer))
    return verdict_body(verdict)


def _tutorial_task(name: str) -> TutorialTask:
    if name not in TASKS_BY_NAME:
        raise http_error(404, f"no tutorial task {name!r}; choose from {', '.join(TASKS_BY_NAME)}")
    return TASKS_BY_NAME[name]
