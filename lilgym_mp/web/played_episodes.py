"""Episodes that people play: rebuilt from the task and the actions taken, moved on by the package's rules."""

from __future__ import annotations

import secrets
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import BaseModel
from sqlalchemy import func, select
from sqlalchemy.orm import Session

from lilgym_mp.actions import Action, ActionError, AddItem, describe, named
from lilgym_mp.appearances import Appearance, Scatter
from lilgym_mp.corpus import CorpusError
from lilgym_mp.programs.tracing import trace
from lilgym_mp.rules import Dynamics, Outcome, State, Transition
from lilgym_mp.task import Task
from lilgym_mp.web.authentication import keep_visitor
from lilgym_mp.web.catalogue import Catalogue
from lilgym_mp.web.errors import refusal
from lilgym_mp.web.scene_body import SceneBody, scene_body
from lilgym_mp.web.store.models import PlayedEpisode, Visitor

MOST_BEST = 20  # rows of the table of best play

RULES_IN_WORDS = {
    Outcome.SUCCESS: "You stopped, and the statement has the wanted truth value.",
    Outcome.WRONG_STOP: "You stopped, but the statement does not have the wanted truth value.",
    Outcome.INVALID_ACTION: "The action was not legal, which ends an episode.",
    Outcome.HORIZON: "That was the last action allowed, and it was not a STOP.",
}


class EpisodeBody(BaseModel):
    """An episode as its player sees it. The program is not told before the end."""

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
    reward: float
    actions: list[str]
    over: bool
    outcome: str | None
    shown_solution: bool
    grid: tuple[int, int] | None  # Scatter's columns and rows
    scene: SceneBody


class ProgramPart(BaseModel):
    """A part of the program, its value, and the items (box, index) that the value is or holds."""

    depth: int
    source: str
    value: str
    items: list[tuple[int, int]]


class ExplanationBody(BaseModel):
    """Why an episode ended as it did."""

    rule: str
    invalid_reason: str | None
    program: str
    truth: bool
    target: bool
    parts: list[ProgramPart]


class SolutionStep(BaseModel):
    """An action of the expert, and the scene after it."""

    action: str
    scene: SceneBody


class SolutionBody(BaseModel):
    """The expert's shortest solution from the start."""

    found: bool
    proven_shortest: bool
    reason: str
    start: SceneBody
    steps: list[SolutionStep]


@dataclass(frozen=True, slots=True)
class Played:
    """An episode's task and where it stands."""

    episode: PlayedEpisode
    task: Task
    dynamics: Dynamics
    state: State
    last: Transition | None

    @property
    def over(self) -> bool:
        return self.episode.outcome is not None


def begin(
    session: Session, catalogue: Catalogue, visitor_id: str, task: Task, *, configuration: str, split: str, **how: Any
) -> Played:
    """A new episode of the task."""
    keep_visitor(session, visitor_id)
    episode = PlayedEpisode(
        id=secrets.token_urlsafe(16),
        visitor_id=visitor_id,
        corpus=catalogue.corpus,
        configuration=configuration,
        split=split,
        task_id=task.id,
        actions=[],
        reward=0.0,
        shown_solution=False,
        **how,
    )
    session.add(episode)
    dynamics = catalogue.dynamics(configuration, episode.rules)
    return Played(episode, task, dynamics, dynamics.start(task), None)


def find_task(catalogue: Catalogue, configuration: str, split: str, task_id: str | None) -> Task:
    """The task of that id, or any. Answers 404 where there is none."""
    try:
        tasks = catalogue.tasks(configuration, split)
        if task_id is None:
            return tasks[secrets.randbelow(len(tasks))]
        return tasks.by_id(task_id)
    except (ValueError, CorpusError) as fault:
        raise refusal(404, str(fault)) from None


def find_episode(
    session: Session, catalogue: Catalogue, visitor_id: str, episode_id: str, *, locked: bool = False
) -> Played:
    """An episode of this visitor, brought to where it stands. Answers 404 where there is none."""
    asked = select(PlayedEpisode).where(PlayedEpisode.id == episode_id, PlayedEpisode.visitor_id == visitor_id)
    episode = session.scalar(asked.with_for_update() if locked else asked)
    if episode is None:
        raise refusal(404, "there is no such episode of yours; begin a new one")
    if episode.corpus != catalogue.corpus:
        raise refusal(409, f"this episode is of the corpus {episode.corpus!r}, which is not served now")
    task = find_task(catalogue, episode.configuration, episode.split, episode.task_id)
    dynamics = catalogue.dynamics(episode.configuration, episode.rules)
    state, last = dynamics.start(task), None
    for index in episode.actions:
        last = dynamics.step(state, dynamics.appearance.decode(index))
        state = last.state
    return Played(episode, task, dynamics, state, last)


def read_action(appearance: Appearance, name: str) -> Action:
    """The action of that name. Answers 422 for a name of none, or of none of this appearance."""
    try:
        action = named(name)
        appearance.encode(action)
        return action
    except ActionError as fault:
        raise refusal(422, str(fault)) from None


def act(played: Played, name: str, steps: int) -> Played:
    """The episode after an action. Answers 409 where it is over, has moved on, or, unless it is strict, where the
    action is not legal; then nothing changes."""
    episode = played.episode
    if played.over:
        raise refusal(409, "this episode is over; begin a new one")
    if steps != played.state.steps:
        raise refusal(409, f"this episode is at step {played.state.steps} already; reload it")
    action = read_action(played.dynamics.appearance, name)
    moved = played.dynamics.step(played.state, action)
    if moved.invalid is not None and not episode.strict:
        reason = str(moved.invalid).replace("_", " ")
        raise refusal(409, f"{describe(action)} is not legal here: {reason}; nothing was done")
    episode.actions = [*episode.actions, played.dynamics.appearance.encode(action)]
    episode.reward += moved.reward
    if moved.result.ends:
        episode.outcome = str(moved.outcome)
    return Played(episode, played.task, played.dynamics, moved.state, moved)


def episode_body(played: Played) -> EpisodeBody:
    episode, appearance = played.episode, played.dynamics.appearance
    return EpisodeBody(
        id=episode.id,
        configuration=episode.configuration,
        split=episode.split,
        rules=episode.rules,
        strict=episode.strict,
        task_id=episode.task_id,
        statement=played.task.statement,
        target=played.task.target,
        steps=played.state.steps,
        actions_left=played.dynamics.horizon - played.state.steps,
        reward=round(episode.reward, 6),
        actions=[describe(appearance.decode(index)) for index in episode.actions],
        over=played.over,
        outcome=episode.outcome,
        shown_solution=episode.shown_solution,
        grid=appearance.grid if isinstance(appearance, Scatter) else None,
        scene=scene_body(played.state.scene),
    )


def legal_actions(played: Played, look: tuple[str | None, str | None, str | None]) -> list[str]:
    """The names of the actions that are legal now; of ADDs of items only those of the look (shape, colour, size)."""
    appearance = played.dynamics.appearance
    mask = played.dynamics.legal_mask(played.state)
    actions = map(appearance.decode, np.flatnonzero(mask).tolist())
    return [describe(action) for action in actions if not isinstance(action, AddItem) or _looks(action, look)]


def _looks(action: AddItem, look: tuple[str | None, str | None, str | None]) -> bool:
    names = (action.shape.name, action.colour.name, action.size.name)
    return all(wanted is None or wanted == name for wanted, name in zip(look, names, strict=True))


def explanation(played: Played) -> ExplanationBody:
    """Which rule ended the episode, and what the program makes of the last scene. Answers 409 before the end."""
    if played.episode.outcome is None or played.last is None:
        raise refusal(409, "the episode is not over yet")
    task, scene = played.task, played.state.scene
    return ExplanationBody(
        rule=RULES_IN_WORDS[Outcome(played.episode.outcome)],
        invalid_reason=None if played.last.invalid is None else str(played.last.invalid).replace("_", " "),
        program=task.program,
        truth=task.truth(scene),
        target=task.target,
        parts=[ProgramPart(**part._asdict()) for part in trace(task.program, scene)],
    )


def solution(catalogue: Catalogue, played: Played) -> SolutionBody:
    """The expert's way from the start."""
    solver = catalogue.solver(played.episode.configuration, played.episode.rules)
    found = solver.solve(played.task)
    state, steps = played.dynamics.start(played.task), []
    for action in found.actions:
        state = played.dynamics.step(state, action).state
        steps.append(SolutionStep(action=describe(action), scene=scene_body(state.scene)))
    return SolutionBody(
        found=found.solved,
        proven_shortest=found.proven_optimal,
        reason=found.reason,
        start=scene_body(played.task.start),
        steps=steps,
    )


class ConfigurationProgress(BaseModel):
    configuration: str
    episodes: int
    successes: int
    mean_reward: float


class EpisodeLine(BaseModel):
    """An episode in a list."""

    id: str
    configuration: str
    split: str
    task_id: str
    outcome: str | None
    reward: float
    steps: int


class ProgressBody(BaseModel):
    """What this browser has played. Episodes whose solution was shown before the end are not counted."""

    nickname: str | None
    configurations: list[ConfigurationProgress]
    recent: list[EpisodeLine]


class BestLine(BaseModel):
    """A player's successes in one configuration."""

    player: str
    configuration: str
    episodes: int
    successes: int
    mean_reward: float
    you: bool


COUNTED = (PlayedEpisode.outcome.is_not(None), PlayedEpisode.shown_solution.is_(False))
_SUCCESSES = func.count().filter(PlayedEpisode.outcome == str(Outcome.SUCCESS))
_TASKS = func.count(func.distinct(PlayedEpisode.task_id)).filter(PlayedEpisode.outcome == str(Outcome.SUCCESS))


def progress(session: Session, visitor_id: str) -> ProgressBody:
    """What a visitor has played, the latest episodes first."""
    counts = session.execute(
        select(PlayedEpisode.configuration, func.count(), _SUCCESSES, func.avg(PlayedEpisode.reward))
        .where(PlayedEpisode.visitor_id == visitor_id, *COUNTED)
        .group_by(PlayedEpisode.configuration)
        .order_by(PlayedEpisode.configuration)
    )
    recent = session.scalars(
        select(PlayedEpisode)
        .where(PlayedEpisode.visitor_id == visitor_id)
        .order_by(PlayedEpisode.changed.desc())
        .limit(10)
    )
    visitor = session.get(Visitor, visitor_id)
    return ProgressBody(
        nickname=visitor.nickname if visitor else None,
        configurations=[
            ConfigurationProgress(
                configuration=name, episodes=episodes, successes=successes, mean_reward=round(float(mean), 3)
            )
            for name, episodes, successes, mean in counts
        ],
        recent=[
            EpisodeLine(
                id=episode.id,
                configuration=episode.configuration,
                split=episode.split,
                task_id=episode.task_id,
                outcome=episode.outcome,
                reward=round(episode.reward, 6),
                steps=len(episode.actions),
            )
            for episode in recent
        ],
    )


def best(session: Session, visitor_id: str) -> list[BestLine]:
    """Players by how many different tasks of a configuration they solved, then by mean reward."""
    mean = func.avg(PlayedEpisode.reward)
    rows = session.execute(
        select(Visitor.id, Visitor.nickname, PlayedEpisode.configuration, func.count(), _TASKS, mean)
        .join(Visitor, Visitor.id == PlayedEpisode.visitor_id)
        .where(*COUNTED)
        .group_by(Visitor.id, Visitor.nickname, PlayedEpisode.configuration)
        .order_by(_TASKS.desc(), mean.desc())
        .limit(MOST_BEST)
    )
    return [
        BestLine(
            player=nickname or "somebody",
            configuration=configuration,
            episodes=episodes,
            successes=successes,
            mean_reward=round(float(reward), 3),
            you=found_id == visitor_id,
        )
        for found_id, nickname, configuration, episodes, successes, reward in rows
    ]
