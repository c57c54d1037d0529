"""/play: solve tasks by hand under the environment's rules and rewards.

The database stores an episode's task and actions; its MDP state is rebuilt by replaying them.
"""

from __future__ import annotations

import secrets
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from anyio.to_thread import run_sync
from fastapi import APIRouter, Query, Request, Response
from pydantic import AfterValidator, BaseModel, Field, StringConstraints
from sqlalchemy import Select, func, select
from sqlalchemy.orm import Session

from lilgym_mp.actions import Action, ActionError, describe, named
from lilgym_mp.appearances import Appearance
from lilgym_mp.corpus import CorpusError, TaskSet
from lilgym_mp.programs.tracing import trace
from lilgym_mp.rules import Dynamics, Outcome, State, Transition
from lilgym_mp.solver.solver import UnsupportedAppearance
from lilgym_mp.task import Task
from lilgym_mp.web.app_services import AppServices, Catalogue, Services
from lilgym_mp.web.authentication import CurrentCaller, get_or_create_visitor
from lilgym_mp.web.bodies import Body, LegalBody, ProgramPart, Reward, SceneBody, scene_body
from lilgym_mp.web.errors import http_error
from lilgym_mp.web.field_types import ConfigurationName, ItemTypeQuery, Name, RandomId, RulesName, SplitName
from lilgym_mp.web.store.models import PlayedEpisode, Visitor
from lilgym_mp.web.templating import render_page

router = APIRouter()
api = APIRouter(prefix="/api/play", tags=["play"])

MAX_TASKS = 50  # per response
LEADERBOARD_SIZE = 20  # rows
RECENT_EPISODES = 10

OUTCOME_EXPLANATIONS = {
    Outcome.SUCCESS: "You stopped when the statement had the target truth value.",
    Outcome.WRONG_STOP: "You stopped, but the statement does not have the target truth value.",
    Outcome.INVALID_ACTION: "You took an illegal action, which ends the episode.",
    Outcome.HORIZON: "You used the last action allowed, and it was not STOP.",
}
Nickname = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=40, pattern=r"^[\w .-]+$")]


class NewEpisode(BaseModel):
    """Settings of an episode; without `task_id` a random task is drawn."""

    configuration: ConfigurationName = "TowerScratch"
    split: SplitName = "dev"
    task_id: Name | None = None
    rules: RulesName = "paper"
    strict: bool = Field(False, description="whether an illegal action ends the episode, as it does for agents")


class ActionTaken(BaseModel):
    """An action by name, such as ADD(LEFT, BLUE), and the step count that the player saw when taking it."""

    action: Name
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


class EpisodeBody(Body):
    """An episode as its player sees it. The program stays hidden until the end."""

    id: str
    configuration: str
    split: str
    rules: str
    strict: bool
    task_id: str
    statement: str
    target: bool
    steps: int
    actions_left: int
    reward: Reward
    actions: list[str]
    over: bool
    outcome: str | None
    shown_solution: bool
    grid: tuple[int, int] | None  # columns, rows; null in Tower
    scene: SceneBody


class ExplanationBody(Body):
    """Why an episode ended, and the program traced on the last scene."""

    rule: str
    invalid_reason: str | None
    program: str
    truth: bool
    target: bool
    parts: list[ProgramPart]


class SolutionStep(Body):
    """An action of the expert and the resulting scene."""

    action: str
    scene: SceneBody


class SolutionBody(Body):
    """The expert's solution from the start scene."""

    found: bool
    proven_shortest: bool
    reason: str
    start: SceneBody
    steps: list[SolutionStep]


class Results(Body):
    """A player's results in one configuration."""

    configuration: str
    episodes: int
    successes: int
    mean_reward: Annotated[float, AfterValidator(lambda mean: round(mean, 3))]


class EpisodeSummary(Body):
    """An entry of the list of recent episodes."""

    id: str
    configuration: str
    split: str
    task_id: str
    outcome: str | None
    reward: Reward
    steps: int


class ProgressBody(Body):
    """This visitor's results. Episodes whose solution was shown before the end are not counted."""

    nickname: str | None
    configurations: list[Results]
    recent: list[EpisodeSummary]


class LeaderboardRow(Results):
    player: str
    you: bool


@router.get("/play", include_in_schema=False)
def play_page(request: Request, services: Services) -> Response:
    return render_page(request, "play.html", sizes=services.catalogue.sizes())


@api.get("/tasks")
def tasks(
    services: Services,
    configuration: ConfigurationName,
    split: SplitName = "dev",
    text: Annotated[str, Query(max_length=200)] = "",
) -> TasksBody:
    """Searches the tasks of a configuration and split."""
    found, needle = _tasks(services.catalogue, configuration, split), text.lower()
    matching = [task for task in found if needle in task.statement.lower() or needle in task.id.lower()]
    return TasksBody(total=len(matching), tasks=[TaskSummary.of(task) for task in matching[:MAX_TASKS]])


@api.post("/episodes", status_code=201)
async def begin(new: NewEpisode, services: Services, caller: CurrentCaller) -> EpisodeBody:
    """Starts an episode."""
    task = await run_sync(_find_task, services.catalogue, new.configuration, new.split, new.task_id)
    dynamics = services.catalogue.dynamics(new.configuration, new.rules)
    row = PlayedEpisode(
        id=secrets.token_urlsafe(16),
        visitor_id=caller.id,
        corpus=services.catalogue.corpus,
        actions=[],
        reward=0.0,
        shown_solution=False,
        **{**new.model_dump(), "task_id": task.id},
    )

    def insert(session: Session) -> None:
        get_or_create_visitor(session, caller.id)
        session.add(row)

    await services.database.write(insert)
    return _episode_body(LoadedEpisode(row, task, dynamics, dynamics.start(task), None))


@api.get("/episodes/{episode_id}")
def episode(episode_id: RandomId, services: Services, caller: CurrentCaller) -> EpisodeBody:
    """The current state of an episode of this browser."""
    return _episode_body(_load(services, caller.id, episode_id))


@api.post("/episodes/{episode_id}/actions")
async def act(episode_id: RandomId, taken: ActionTaken, services: Services, caller: CurrentCaller) -> EpisodeBody:
    """Takes an action; an illegal one is refused unless the episode is strict."""

    def load_and_act(session: Session) -> LoadedEpisode:
        loaded = _find_episode(session, services.catalogue, caller.id, episode_id, locked=True)
        row, dynamics = loaded.row, loaded.dynamics
        if loaded.over:
            raise http_error(409, "this episode is over; start a new one")
        if taken.steps != loaded.state.steps:
            raise http_error(409, f"this episode is already at step {loaded.state.steps}; reload it")
        action, index = _parse_action(dynamics.appearance, taken.action)
        transition = dynamics.step(loaded.state, action)
        if transition.invalid is not None and not row.strict:
            reason = str(transition.invalid).replace("_", " ")
            raise http_error(409, f"{describe(action)} is not legal here: {reason}; nothing was done")
        row.actions = [*row.actions, index]
        row.reward += transition.reward
        if transition.result.ends:
            row.outcome = str(transition.outcome)
        return LoadedEpisode(row, loaded.task, dynamics, transition.state, transition)

    return _episode_body(await services.database.write(load_and_act))


@api.get("/episodes/{episode_id}/legal")
def legal(episode_id: RandomId, services: Services, caller: CurrentCaller, item_type: ItemTypeQuery) -> LegalBody:
    """Legal actions by the exact mask; Scatter's ADDs are filtered by shape, colour and size."""
    loaded = _load(services, caller.id, episode_id)
    if loaded.over:
        return LegalBody(actions=[])
    indices = np.flatnonzero(loaded.dynamics.legal_mask(loaded.state)).tolist()
    actions = map(loaded.dynamics.appearance.decode, indices)
    return LegalBody(actions=[describe(action) for action in actions if item_type.matches(action)])


@api.get("/episodes/{episode_id}/explanation")
def explanation(episode_id: RandomId, services: Services, caller: CurrentCaller) -> ExplanationBody:
    """Why the episode ended, with the value of each part of the program."""
    loaded = _load(services, caller.id, episode_id)
    if loaded.row.outcome is None or loaded.last is None:
        raise http_error(409, "the episode is not over yet")
    task, scene = loaded.task, loaded.state.scene
    return ExplanationBody.of(
        task,
        rule=OUTCOME_EXPLANATIONS[Outcome(loaded.row.outcome)],
        invalid_reason=None if loaded.last.invalid is None else str(loaded.last.invalid).replace("_", " "),
        truth=task.truth(scene),
        parts=trace(task.program, scene),
    )


@api.post("/episodes/{episode_id}/solution")
async def solution(episode_id: RandomId, services: Services, caller: CurrentCaller) -> SolutionBody:
    """The expert's solution. An episode whose solution is requested before its end is excluded from statistics."""

    def load_and_mark(session: Session) -> LoadedEpisode:
        loaded = _find_episode(session, services.catalogue, caller.id, episode_id, locked=True)
        loaded.row.shown_solution = loaded.row.shown_solution or not loaded.over
        return loaded

    loaded = await services.database.write(load_and_mark)
    return await run_sync(_solution, services.catalogue, loaded)


@api.get("/progress")
def progress(services: Services, caller: CurrentCaller) -> ProgressBody:
    """This browser's results and recent episodes."""
    results = (
        _results(func.count().filter(_IS_SUCCESS))
        .where(PlayedEpisode.visitor_id == caller.id)
        .group_by(PlayedEpisode.configuration)
        .order_by(PlayedEpisode.configuration)
    )
    recent = (
        select(PlayedEpisode)
        .where(PlayedEpisode.visitor_id == caller.id)
        .order_by(PlayedEpisode.changed.desc())
        .limit(RECENT_EPISODES)
    )
    with services.database.read_session() as session:
        visitor = session.get(Visitor, caller.id)
        return ProgressBody(
            nickname=visitor.nickname if visitor else None,
            configurations=[Results.of(row) for row in session.execute(results)],
            recent=[EpisodeSummary.of(row, steps=len(row.actions)) for row in session.scalars(recent)],
        )


@api.get("/best")
def best(services: Services, caller: CurrentCaller) -> list[LeaderboardRow]:
    """The leaderboard: players and configurations by number of distinct tasks solved, then by mean reward."""
    solved = func.count(func.distinct(PlayedEpisode.task_id)).filter(_IS_SUCCESS)
    query = (
        _results(solved)
        .add_columns(Visitor.id, Visitor.nickname)
        .join(Visitor, Visitor.id == PlayedEpisode.visitor_id)
        .group_by(Visitor.id, Visitor.nickname, PlayedEpisode.configuration)
        .having(solved > 0)
        .order_by(solved.desc(), func.avg(PlayedEpisode.reward).desc())
        .limit(LEADERBOARD_SIZE)
    )
    with services.database.read_session() as session:
        rows = session.execute(query).all()
    return [LeaderboardRow.of(row, player=row.nickname or "anonymous", you=row.id == caller.id) for row in rows]


@api.put("/nickname", status_code=204)
async def rename(chosen: NicknameBody, services: Services, caller: CurrentCaller) -> None:
    """Sets this browser's name on the leaderboard."""

    def set_nickname(session: Session) -> None:
        get_or_create_visitor(session, caller.id).nickname = chosen.nickname

    await services.database.write(set_nickname)


@dataclass(frozen=True, slots=True)
class LoadedEpisode:
    """An episode's database row, task and current MDP state."""

    row: PlayedEpisode
    task: Task
    dynamics: Dynamics
    state: State
    last: Transition | None  # None before the first action

    @property
    def over(self) -> bool:
        return self.row.outcome is not None


def _tasks(catalogue: Catalogue, configuration: str, split: str) -> TaskSet:
    """Responds with 404 if there are none."""
    try:
        return catalogue.tasks(configuration, split)
    except (ValueError, CorpusError) as fault:
        raise http_error(404, str(fault)) from None


def _find_task(catalogue: Catalogue, configuration: str, split: str, task_id: str | None) -> Task:
    """The task with that id, or a random one for None. Responds with 404 if there is none."""
    tasks = _tasks(catalogue, configuration, split)
    try:
        return tasks[secrets.randbelow(len(tasks))] if task_id is None else tasks.by_id(task_id)
    except ValueError as fault:
        raise http_error(404, str(fault)) from None


def _load(services: AppServices, visitor_id: str, episode_id: str) -> LoadedEpisode:
    with services.database.read_session() as session:
        return _find_episode(session, services.catalogue, visitor_id, episode_id)


def _find_episode(
    session: Session, catalogue: Catalogue, visitor_id: str, episode_id: str, *, locked: bool = False
) -> LoadedEpisode:
    """An episode of this visitor, replayed to its current state; `locked` selects the row for update.

    Responds with 404 if the visitor has no such episode, 409 if it belongs to another corpus.
    """
    query = select(PlayedEpisode).where(PlayedEpisode.id == episode_id, PlayedEpisode.visitor_id == visitor_id)
    row = session.scalar(query.with_for_update() if locked else query)
    if row is None:
        raise http_error(404, "you have no such episode; start a new one")
    if row.corpus != catalogue.corpus:
        raise http_error(409, f"this episode belongs to the corpus {row.corpus!r}, which is not being served")
    task = _find_task(catalogue, row.configuration, row.split, row.task_id)
    dynamics = catalogue.dynamics(row.configuration, row.rules)
    state, last = dynamics.start(task), None
    for index in row.actions:
        last = dynamics.step(state, dynamics.appearance.decode(index))
        state = last.state
    return LoadedEpisode(row, task, dynamics, state, last)


def _parse_action(appearance: Appearance, name: str) -> tuple[Action, int]:
    """The action with that name, and its index. Responds with 422 if this appearance has none."""
    try:
        action = named(name)
        return action, appearance.encode(action)
    except ActionError as fault:
        raise http_error(422, str(fault)) from None


def _episode_body(loaded: LoadedEpisode) -> EpisodeBody:
    row, appearance = loaded.row, loaded.dynamics.appearance
    return EpisodeBody.of(
        row,
        statement=loaded.task.statement,
        target=loaded.task.target,
        steps=loaded.state.steps,
        actions_left=loaded.dynamics.horizon - loaded.state.steps,
        actions=[describe(appearance.decode(index)) for index in row.actions],
        over=loaded.over,
        grid=appearance.grid,
        scene=scene_body(loaded.state.scene),
    )


def _solution(catalogue: Catalogue, loaded: LoadedEpisode) -> SolutionBody:
    """Responds with 404 if there is no expert for the appearance."""
    try:
        solved = catalogue.solver(loaded.row.configuration, loaded.row.rules).solve(loaded.task)
    except UnsupportedAppearance as fault:
        raise http_error(404, str(fault)) from None
    state, steps = loaded.dynamics.start(loaded.task), []
    for action in solved.actions:
        state = loaded.dynamics.step(state, action).state
        steps.append(SolutionStep(action=describe(action), scene=scene_body(state.scene)))
    return SolutionBody(
        found=solved.solved,
        proven_shortest=solved.proven_optimal,
        reason=solved.reason,
        start=scene_body(loaded.task.start),
        steps=steps,
    )


_IS_COUNTED = (PlayedEpisode.outcome.is_not(None), PlayedEpisode.shown_solution.is_(False))
_IS_SUCCESS = PlayedEpisode.outcome == str(Outcome.SUCCESS)


def _results(successes: Any) -> Select[str, int, Any, Any]:
    """Episodes that count, as the columns of `Results`."""
    return select(
        PlayedEpisode.configuration,
        func.count().label("episodes"),
        successes.label("successes"),
        func.avg(PlayedEpisode.reward).label("mean_reward"),
    ).where(*_IS_COUNTED)
