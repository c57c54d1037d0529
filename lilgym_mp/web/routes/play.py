"""/play: solve tasks by hand under the environment's rules and rewards."""

from __future__ import annotations

from typing import Annotated

from anyio.to_thread import run_sync
from fastapi import APIRouter, Query, Request, Response
from pydantic import BaseModel, Field, StringConstraints
from sqlalchemy.orm import Session

from lilgym_mp.corpus import CorpusError
from lilgym_mp.web import field_types, played_episodes
from lilgym_mp.web.app_services import AppServices, Services
from lilgym_mp.web.authentication import CurrentCaller, get_or_create_visitor
from lilgym_mp.web.bodies import Body, LegalBody
from lilgym_mp.web.errors import http_error
from lilgym_mp.web.templating import render_page

router = APIRouter()
api = APIRouter(prefix="/api/play", tags=["play"])
MAX_TASKS = 50  # per response


Nickname = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=40, pattern=r"^[\w .-]+$")]


class NewEpisode(BaseModel):
    """Settings of an episode; without `task_id` a random task is drawn."""

    configuration: field_types.ConfigurationName = "TowerScratch"
    split: field_types.SplitName = "dev"
    task_id: field_types.Name | None = None
    rules: field_types.RulesName = "paper"
    strict: bool = Field(False, description="whether an illegal action ends the episode, as it does for agents")


class ActionTaken(BaseModel):
    """An action by name, such as ADD(LEFT, BLUE), and the step count that the player saw when taking it."""

    action: field_types.Name
    steps: int = Field(ge=0, le=1_000)


class TaskSummary(Body):
    id: str
    statement: str
    target: bool


class TasksBody(Body):
    """The first tasks whose statement or id contains the text, and how many there are."""

    total: int
    tasks: list[TaskSummary]


class NicknameBody(BaseModel):
    """The name shown on the leaderboard."""

    nickname: Nickname


@router.get("/play", include_in_schema=False)
def play_page(request: Request, services: Services) -> Response:
    return render_page(request, "play.html", sizes=services.catalogue.sizes())


@api.get("/tasks")
def tasks(
    services: Services,
    configuration: field_types.ConfigurationName,
    split: field_types.SplitName = "dev",
    text: Annotated[str, Query(max_length=200)] = "",
) -> TasksBody:
    """Searches the tasks of a configuration and split."""
    try:
        found = services.catalogue.tasks(configuration, split)
    except (ValueError, CorpusError) as fault:
        raise http_error(404, str(fault)) from None
    needle = text.lower()
    matching = [task for task in found if needle in task.statement.lower() or needle in task.id.lower()]
    return TasksBody(total=len(matching), tasks=[TaskSummary.of(task) for task in matching[:MAX_TASKS]])


@api.post("/episodes", status_code=201)
async def begin(new: NewEpisode, services: Services, caller: CurrentCaller) -> played_episodes.EpisodeBody:
    """Starts an episode."""
    catalogue = services.catalogue
    task = await run_sync(played_episodes.find_task, catalogue, new.configuration, new.split, new.task_id)
    settings = new.model_dump(exclude={"task_id"})
    started = await services.database.write(
        lambda session: played_episodes.begin(session, catalogue, caller.id, task, **settings)
    )
    return played_episodes.episode_body(started)


def _load(services: AppServices, visitor_id: str, episode_id: str) -> played_episodes.LoadedEpisode:
    with services.database.read_session() as session:
        return played_episodes.find_episode(session, services.catalogue, visitor_id, episode_id)


@api.get("/episodes/{episode_id}")
def episode(episode_id: field_types.RandomId, services: Services, caller: CurrentCaller) -> played_episodes.EpisodeBody:
    """The current state of an episode of this browser."""
    return played_episodes.episode_body(_load(services, caller.id, episode_id))


@api.post("/episodes/{episode_id}/actions")
async def act(
    episode_id: field_types.RandomId, taken: ActionTaken, services: Services, caller: CurrentCaller
) -> played_episodes.EpisodeBody:
    """Takes an action."""

    def load_and_act(session: Session) -> played_episodes.LoadedEpisode:
        loaded = played_episodes.find_episode(session, services.catalogue, caller.id, episode_id, locked=True)
        return played_episodes.act(loaded, taken.action, taken.steps)

    return played_episodes.episode_body(await services.database.write(load_and_act))


@api.get("/episodes/{episode_id}/legal")
def legal(
    episode_id: field_types.RandomId, services: Services, caller: CurrentCaller, item_type: field_types.ItemTypeQuery
) -> LegalBody:
    """Legal actions by the exact mask; Scatter's ADDs are filtered by shape, colour and size."""
    loaded = _load(services, caller.id, episode_id)
    return LegalBody(actions=[] if loaded.over else played_episodes.legal_actions(loaded, item_type))


@api.get("/episodes/{episode_id}/explanation")
def explanation(
    episode_id: field_types.RandomId, services: Services, caller: CurrentCaller
) -> played_episodes.ExplanationBody:
    """Why the episode ended, with the value of each part of the program."""
    return played_episodes.explanation(_load(services, caller.id, episode_id))


@api.post("/episodes/{episode_id}/solution")
async def solution(
    episode_id: field_types.RandomId, services: Services, caller: CurrentCaller
) -> played_episodes.SolutionBody:
    """The expert's solution. An episode whose solution is requested before its end is excluded from statistics."""

    def load_and_mark(session: Session) -> played_episodes.LoadedEpisode:
        loaded = played_episodes.find_episode(session, services.catalogue, caller.id, episode_id, locked=True)
        loaded.row.shown_solution = loaded.row.shown_solution or not loaded.over
        return loaded

    loaded = await services.database.write(load_and_mark)
    return await run_sync(played_episodes.solution, services.catalogue, loaded)


@api.get("/progress")
def progress(services: Services, caller: CurrentCaller) -> played_episodes.ProgressBody:
    """This browser's results and recent episodes."""
    with services.database.read_session() as session:
        return played_episodes.progress(session, caller.id)


@api.get("/best")
def best(services: Services, caller: CurrentCaller) -> list[played_episodes.LeaderboardRow]:
    """The leaderboard."""
    with services.database.read_session() as session:
        return played_episodes.leaderboard(session, caller.id)


@api.put("/nickname", status_code=204)
async def rename(chosen: NicknameBody, services: Services, caller: CurrentCaller) -> None:
    """Sets this browser's name on the leaderboard."""

    def set_nickname(session: Session) -> None:
        get_or_create_visitor(session, caller.id).nickname = chosen.nickname

    await services.database.write(set_nickname)


router.include_router(api)
