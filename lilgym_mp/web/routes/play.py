"""/play: tasks to solve, with the package's rules, rewards and pictures."""

from __future__ import annotations

from typing import Annotated, Literal

from anyio.to_thread import run_sync
from fastapi import APIRouter, Query, Request, Response
from pydantic import BaseModel, Field, StringConstraints
from sqlalchemy.orm import Session

from lilgym_mp.corpus import CorpusError
from lilgym_mp.scene import Colour, Shape, Size
from lilgym_mp.web import played_episodes
from lilgym_mp.web.app_services import Services, ServicesOf
from lilgym_mp.web.authentication import CallerOf, keep_visitor
from lilgym_mp.web.errors import refusal
from lilgym_mp.web.field_types import Name, RandomId
from lilgym_mp.web.templating import page

router = APIRouter()
api = APIRouter(prefix="/api/play", tags=["play"])
MOST_TASKS = 50  # in one list

ConfigurationName = Literal["TowerScratch", "TowerFlipIt", "ScatterScratch", "ScatterFlipIt"]
SplitName = Literal["train", "dev", "test"]
RulesName = Literal["paper", "release"]
ShapeName = Literal["CIRCLE", "SQUARE", "TRIANGLE"]
ColourName = Literal["YELLOW", "BLACK", "BLUE"]
SizeName = Literal["SMALL", "MEDIUM", "LARGE"]


Nickname = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=40, pattern=r"^[\w .-]+$")]


class NewEpisode(BaseModel):
    """What to play; without `task_id` one is drawn."""

    configuration: ConfigurationName = "TowerScratch"
    split: SplitName = "dev"
    task_id: Name | None = None
    rules: RulesName = "paper"
    strict: bool = Field(False, description="whether an illegal action ends the episode, as it does for agents")


class ActionTaken(BaseModel):
    """An action by its name, such as ADD(LEFT, BLUE), and the step at which the player saw the episode."""

    action: Name
    steps: int = Field(ge=0, le=1_000)


class TaskLine(BaseModel):
    id: str
    statement: str
    target: bool


class TasksBody(BaseModel):
    """Tasks whose statement or id has the text, the first ones."""

    total: int
    tasks: list[TaskLine]


class LegalBody(BaseModel):
    """Names of legal actions."""

    actions: list[str]


class NicknameBody(BaseModel):
    """The name in the table of best play."""

    nickname: Annotated[
        str, StringConstraints(strip_whitespace=True, min_length=1, max_length=40, pattern=r"^[\w .-]+$")
    ]


@router.get("/play", include_in_schema=False)
def play_page(request: Request, services: ServicesOf) -> Response:
    return page(
        request,
        "play.html",
        sizes=services.catalogue.sizes(),
        shapes=[shape.name for shape in Shape],
        colours=[colour.name for colour in Colour],
        item_sizes=[size.name for size in Size],
    )


@api.get("/tasks")
def tasks(
    services: ServicesOf,
    configuration: ConfigurationName,
    split: SplitName = "dev",
    text: Annotated[str, Query(max_length=200)] = "",
) -> TasksBody:
    """Tasks to choose from."""
    try:
        found = services.catalogue.tasks(configuration, split)
    except (ValueError, CorpusError) as fault:
        raise refusal(404, str(fault)) from None
    wanted = text.lower()
    matching = [task for task in found if wanted in task.statement.lower() or wanted in task.id.lower()]
    lines = [TaskLine(id=task.id, statement=task.statement, target=task.target) for task in matching[:MOST_TASKS]]
    return TasksBody(total=len(matching), tasks=lines)


@api.post("/episodes", status_code=201)
async def begin(new: NewEpisode, services: ServicesOf, caller: CallerOf) -> played_episodes.EpisodeBody:
    """Begins an episode."""
    catalogue = services.catalogue
    task = await run_sync(played_episodes.find_task, catalogue, new.configuration, new.split, new.task_id)
    how = new.model_dump(exclude={"task_id"})
    begun = await services.database.write(
        lambda session: played_episodes.begin(session, catalogue, caller.id, task, **how), durable=False
    )
    return played_episodes.episode_body(begun)


def _found(services: Services, visitor_id: str, episode_id: str) -> played_episodes.Played:
    with services.database.reading() as session:
        return played_episodes.find_episode(session, services.catalogue, visitor_id, episode_id)


@api.get("/episodes/{episode_id}")
def episode(episode_id: RandomId, services: ServicesOf, caller: CallerOf) -> played_episodes.EpisodeBody:
    """An episode of this browser, as it stands."""
    return played_episodes.episode_body(_found(services, caller.id, episode_id))


@api.post("/episodes/{episode_id}/actions")
async def act(
    episode_id: RandomId, taken: ActionTaken, services: ServicesOf, caller: CallerOf
) -> played_episodes.EpisodeBody:
    """Takes an action."""

    def acted(session: Session) -> played_episodes.Played:
        found = played_episodes.find_episode(session, services.catalogue, caller.id, episode_id, locked=True)
        return played_episodes.act(found, taken.action, taken.steps)

    return played_episodes.episode_body(await services.database.write(acted, durable=False))


@api.get("/episodes/{episode_id}/legal")
def legal(
    episode_id: RandomId,
    services: ServicesOf,
    caller: CallerOf,
    shape: ShapeName | None = None,
    colour: ColourName | None = None,
    size: SizeName | None = None,
) -> LegalBody:
    """What is legal now, by the exact mask; of ADDs in Scatter those of the look."""
    found = _found(services, caller.id, episode_id)
    return LegalBody(actions=[] if found.over else played_episodes.legal_actions(found, (shape, colour, size)))


@api.get("/episodes/{episode_id}/explanation")
def explanation(episode_id: RandomId, services: ServicesOf, caller: CallerOf) -> played_episodes.ExplanationBody:
    """Why the episode ended so, part by part of the program."""
    return played_episodes.explanation(_found(services, caller.id, episode_id))


@api.post("/episodes/{episode_id}/solution")
def solution(episode_id: RandomId, services: ServicesOf, caller: CallerOf) -> played_episodes.SolutionBody:
    """The expert's solution; asked for before the end, the episode does not count in tables."""
    with services.database.writing(durable=False) as session:
        found = played_episodes.find_episode(session, services.catalogue, caller.id, episode_id, locked=True)
        if not found.over:
            found.episode.shown_solution = True
    return played_episodes.solution(services.catalogue, found)


@api.get("/progress")
def progress(services: ServicesOf, caller: CallerOf) -> played_episodes.ProgressBody:
    """What this browser has played."""
    with services.database.reading() as session:
        return played_episodes.progress(session, caller.id)


@api.get("/best")
def best(services: ServicesOf, caller: CallerOf) -> list[played_episodes.BestLine]:
    """The table of best play."""
    with services.database.reading() as session:
        return played_episodes.best(session, caller.id)


@api.put("/nickname", status_code=204)
def rename(chosen: NicknameBody, services: ServicesOf, caller: CallerOf) -> None:
    """Gives this browser a name in the table of best play."""
    with services.database.writing() as session:
        keep_visitor(session, caller.id).nickname = chosen.nickname


router.include_router(api)
