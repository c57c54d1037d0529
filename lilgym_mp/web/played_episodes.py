"""Episodes played by visitors: the database stores task and actions; the MDP state is rebuilt by replaying them."""

from __future__ import annotations

import secrets
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator
from sqlalchemy import Select, func, select
from sqlalchemy.orm import Session

from lilgym_mp.actions import Action, ActionError, describe, named
from lilgym_mp.appearances import Appearance
from lilgym_mp.corpus import CorpusError
from lilgym_mp.programs.tracing import trace
from lilgym_mp.rules import Dynamics, Outcome, State, Transition
from lilgym_mp.solver.solver import UnsupportedAppearance
from lilgym_mp.task import Task
from lilgym_mp.web.authentication import get_or_create_visitor
from lilgym_mp.web.bodies import Body, ProgramPart, Reward, SceneBody, scene_body
from lilgym_mp.web.catalogue import Catalogue
from lilgym_mp.web.errors import http_error
from lilgym_mp.web.field_types import ItemType
from lilgym_mp.web.store.models import PlayedEpisode, Visitor

LEADERBOARD_SIZE = 20  # rows
RECENT_EPISODES = 10

OUTCOME_EXPLANATIONS = {
    Outcome.SUCCESS: "You stopped when the statement had the target truth value.",
    Outcome.WRONG_STOP: "You stopped, but the statement does not have the target truth value.",
    Outcome.INVALID_ACTION: "You took an illegal action, which ends the episode.",
    Outcome.HORIZON: "You used the last action allowed, and it was not STOP.",
}


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


def begin(
    session: Session,
    catalogue: Catalogue,
    visitor_id: str,
    task: Task,
    *,
    configuration: str,
    split: str,
    **settings: Any,
) -> LoadedEpisode:
    """Creates an episode of the task. `settings`: further columns, that is `rules` and `strict`."""
    get_or_create_visitor(session, visitor_id)
    row = PlayedEpisode(
        id=secrets.token_urlsafe(16),
        visitor_id=visitor_id,
        corpus=catalogue.corpus,
        configuration=configuration,
        split=split,
        task_id=task.id,
        actions=[],
        reward=0.0,
        shown_solution=False,
        **settings,
    )
    session.add(row)
    dynamics = catalogue.dynamics(configuration, row.rules)
    return LoadedEpisode(row, task, dynamics, dynamics.start(task), None)


def find_task(catalogue: Catalogue, configuration: str, split: str, task_id: str | None) -> Task:
    """The task with that id, or a random one for None. Responds with 404 if there is none."""
    try:
        tasks = catalogue.tasks(configuration, split)
        if task_id is None:
            return tasks[secrets.randbelow(len(tasks))]
        return tasks.by_id(task_id)
    except (ValueError, CorpusError) as fault:
        raise http_error(404, str(fault)) from None


def find_episode(
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
    task = find_task(catalogue, row.configuration, row.split, row.task_id)
    dynamics = catalogue.dynamics(row.configuration, row.rules)
    state, last = dynamics.start(task), None
    for index in row.actions:
        last = dynamics.step(state, dynamics.appearance.decode(index))
        state = last.state
    return LoadedEpisode(row, task, dynamics, state, last)


def parse_action(appearance: Appearance, name: str) -> Action:
    """The action with that name. Responds with 422 if this appearance has none."""
    try:
        action = named(name)
        appearance.encode(action)
        return action
    except ActionError as fault:
        raise http_error(422, str(fault)) from None


def act(loaded: LoadedEpisode, name: str, steps: int) -> LoadedEpisode:
    """Takes the action with that name; `steps` is the step count the player saw.

    Responds with 409, changing nothing, if the episode is over, the step count is stale, or the action is illegal and
    the episode not strict.
    """
    row = loaded.row
    if loaded.over:
        raise http_error(409, "this episode is over; start a new one")
    if steps != loaded.state.steps:
        raise http_error(409, f"this episode is already at step {loaded.state.steps}; reload it")
    action = parse_action(loaded.dynamics.appearance, name)
    transition = loaded.dynamics.step(loaded.state, action)
    if transition.invalid is not None and not row.strict:
        reason = str(transition.invalid).replace("_", " ")
        raise http_error(409, f"{describe(action)} is not legal here: {reason}; nothing was done")
    row.actions = [*row.actions, loaded.dynamics.appearance.encode(action)]
    row.reward += transition.reward
    if transition.result.ends:
        row.outcome = str(transition.outcome)
    return LoadedEpisode(row, loaded.task, loaded.dynamics, transition.state, transition)


def episode_body(loaded: LoadedEpisode) -> EpisodeBody:
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


def legal_actions(loaded: LoadedEpisode, item_type: ItemType) -> list[str]:
    """Names of the legal actions; of Scatter's ADDs only those of matching items."""
    appearance = loaded.dynamics.appearance
    mask = loaded.dynamics.legal_mask(loaded.state)
    actions = map(appearance.decode, np.flatnonzero(mask).tolist())
    return [describe(action) for action in actions if item_type.matches(action)]


def explanation(loaded: LoadedEpisode) -> ExplanationBody:
    """Responds with 409 before the end of the episode."""
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


def solution(catalogue: Catalogue, loaded: LoadedEpisode) -> SolutionBody:
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


_IS_COUNTED = (PlayedEpisode.outcome.is_not(None), PlayedEpisode.shown_solution.is_(False))
_IS_SUCCESS = PlayedEpisode.outcome == str(Outcome.SUCCESS)
_SOLVED_TASK_COUNT = func.count(func.distinct(PlayedEpisode.task_id)).filter(_IS_SUCCESS)


def _results(successes: Any) -> Select[str, int, Any, Any]:
    """Episodes that count, as the columns of `Results`."""
    return select(
        PlayedEpisode.configuration,
        func.count().label("episodes"),
        successes.label("successes"),
        func.avg(PlayedEpisode.reward).label("mean_reward"),
    ).where(*_IS_COUNTED)


def progress(session: Session, visitor_id: str) -> ProgressBody:
    """A visitor's results by configuration, and the most recent episodes."""
    results = session.execute(
        _results(func.count().filter(_IS_SUCCESS))
        .where(PlayedEpisode.visitor_id == visitor_id)
        .group_by(PlayedEpisode.configuration)
        .order_by(PlayedEpisode.configuration)
    )
    recent = session.scalars(
        select(PlayedEpisode)
        .where(PlayedEpisode.visitor_id == visitor_id)
        .order_by(PlayedEpisode.changed.desc())
        .limit(RECENT_EPISODES)
    )
    visitor = session.get(Visitor, visitor_id)
    return ProgressBody(
        nickname=visitor.nickname if visitor else None,
        configurations=[Results.of(row) for row in results],
        recent=[EpisodeSummary.of(episode, steps=len(episode.actions)) for episode in recent],
    )


def leaderboard(session: Session, visitor_id: str) -> list[LeaderboardRow]:
    """Players and configurations by number of distinct tasks solved, then by mean reward; marks the visitor's rows."""
    rows = session.execute(
        _results(_SOLVED_TASK_COUNT)
        .add_columns(Visitor.id, Visitor.nickname)
        .join(Visitor, Visitor.id == PlayedEpisode.visitor_id)
        .group_by(Visitor.id, Visitor.nickname, PlayedEpisode.configuration)
        .having(_SOLVED_TASK_COUNT > 0)
        .order_by(_SOLVED_TASK_COUNT.desc(), func.avg(PlayedEpisode.reward).desc())
        .limit(LEADERBOARD_SIZE)
    )
    return [LeaderboardRow.of(row, player=row.nickname or "anonymous", you=row.id == visitor_id) for row in rows]
