"""Recorded episodes as the page /watch shows them: found by filters, played again step by step."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from lilgym_mp.actions import ActionType, describe
from lilgym_mp.appearances import Appearance, Scatter
from lilgym_mp.evaluation.decisions import Decision, places
from lilgym_mp.evaluation.episodes import Header, RecordedEpisode, Recording
from lilgym_mp.evaluation.recording import scenes
from lilgym_mp.rules import Dynamics
from lilgym_mp.scene import Scene
from lilgym_mp.web.errors import refusal
from lilgym_mp.web.run_directory import FoundRecording, Recordings, Unreadable
from lilgym_mp.web.scene_body import SceneBody, scene_body

MOST_LISTED = 100  # episodes of one answer
MOST_CELLS = 2_000  # of a grid whose cells are told one by one


class RecordingLine(BaseModel):
    """A recording in the list; `fault` says why it cannot be opened, and then little else is known."""

    id: str
    name: str
    fault: str | None
    agent: str | None = None
    configuration: str | None = None
    split: str | None = None
    corpus: str | None = None
    rules: str | None = None
    actions: str | None = None
    mask: bool | None = None
    seed: int | None = None
    training_seed: int | None = None
    episodes: int | None = None


class RunLine(BaseModel):
    """A run whose agent can be recorded, and the command that does it."""

    id: str
    name: str
    command: str


class RecordingsBody(BaseModel):
    """What is in the directory of runs; `directory` is None where the server was given none."""

    directory: str | None
    recordings: list[RecordingLine]
    runs: list[RunLine]


class CountBody(BaseModel):
    name: str
    episodes: int


class RecordingBody(RecordingLine):
    """A recording that was opened."""

    supervision: str
    successes: int
    outcomes: list[CountBody]
    invalid_reasons: list[CountBody]
    phenomena: list[CountBody]
    has_decisions: bool
    has_judgements: bool
    command: str  # that records decisions as well
    comparable: list[RecordingLine]  # other recordings of the same tasks


class EpisodeLine(BaseModel):
    """An episode in a list."""

    index: int
    task: str
    statement: str
    target: bool
    outcome: str
    invalid_reason: str | None
    actions: int
    reward: float
    statement_seen: bool


class EpisodesBody(BaseModel):
    """Episodes that pass the filters, in the recording's order."""

    total: int
    episodes: list[EpisodeLine]


class CellBody(BaseModel):
    """A place of the picture and what was thought of it. Tower's boxes are columns with one row."""

    column: int
    row: int
    add: float
    remove: float


class LikelyAction(BaseModel):
    action: str
    probability: float


class LikelyProgram(BaseModel):
    program: str
    probability: float


class AnswerBody(BaseModel):
    """What an agent that reads and writes answered, and whether that decided for one action."""

    text: str
    understood: bool


class DecisionBody(BaseModel):
    """What the agent went by before an action."""

    stop: float
    add: float
    remove: float
    cells: list[CellBody]
    likeliest: list[LikelyAction]
    legal_stop: int
    legal_add: int
    legal_remove: int
    legal_probability: float
    value: float | None
    success_probability: float | None
    programs: list[LikelyProgram]
    optimal: bool | None
    steps_to_go: int | None
    answers: list[AnswerBody]


class LegalCell(BaseModel):
    """A place where something is legal, by the exact mask."""

    column: int
    row: int
    add: int  # legal ADDs there
    remove: bool


class StepBody(BaseModel):
    """A scene, and what was done in it; the last scene has no action."""

    scene: SceneBody
    action: str | None
    reward: float | None
    decision: DecisionBody | None
    legal: list[LegalCell]


class EpisodeBody(EpisodeLine):
    """An episode, step by step."""

    program: str
    total: float
    phenomena: list[str]
    tags: list[str]
    form_seen: bool
    optimal_actions: int | None
    grid: tuple[int, int]
    steps: list[StepBody]


@dataclass(frozen=True)
class Filters:
    """Which episodes are wanted; None: any."""

    success: bool | None = None
    outcome: str | None = None
    invalid_reason: str | None = None
    seen: bool | None = None
    phenomenon: str | None = None
    target: bool | None = None
    task: str | None = None
    text: str = ""

    def passes(self, episode: RecordedEpisode) -> bool:
        wanted: Sequence[tuple[Any, Any]] = (
            (self.success, episode.is_success),
            (self.outcome, episode.outcome),
            (self.invalid_reason, episode.invalid_reason),
            (self.seen, episode.statement_seen),
            (self.target, episode.target),
            (self.task, episode.task),
        )
        return (
            all(value is None or value == found for value, found in wanted)
            and (self.phenomenon is None or self.phenomenon in episode.phenomena)
            and (self.text.lower() in episode.statement.lower() or self.text.lower() in episode.task.lower())
        )


def recordings_body(recordings: Recordings) -> RecordingsBody:
    directory = recordings.directory
    return RecordingsBody(
        directory=None if directory is None else str(directory),
        recordings=[_line(found) for found in recordings.list()],
        runs=[
            RunLine(id=run.id, name=run.name, command=record_command(directory, run.name))
            for run in recordings.list_runs()
            if directory is not None
        ],
    )


def record_command(directory: Path, run: str) -> str:
    place = directory / run
    return f"lilgym-mp evaluate {place} --record {place} --record-decisions"


def _line(found: FoundRecording) -> RecordingLine:
    header = found.header
    if header is None:
        return RecordingLine(id=found.id, name=found.name, fault=found.fault)
    return RecordingLine(**_about(found.id, found.name, header), fault=None)


def _about(recording_id: str, name: str, header: Header) -> dict[str, Any]:
    settings = header.settings
    return {
        "id": recording_id,
        "name": name,
        "agent": header.agent,
        "configuration": settings.configuration,
        "split": header.split,
        "corpus": header.corpus,
        "rules": settings.rules,
        "actions": header.actions,
        "mask": header.mask,
        "seed": header.seed,
        "training_seed": header.training_seed,
        "episodes": header.episodes,
    }


def opened(recordings: Recordings, recording_id: str) -> Recording:
    """The recording. Answers 404 where there is none, 422 where it is damaged."""
    try:
        found = recordings.read(recording_id)
    except Unreadable as fault:
        raise refusal(422, str(fault)) from None
    if found is None:
        raise refusal(404, "there is no such recording; it may have been moved: reload the list")
    return found


def recording_body(recordings: Recordings, recording_id: str) -> RecordingBody:
    """Everything about a recording but its episodes. Answers as `opened`."""
    recording = opened(recordings, recording_id)
    listed = recordings.list()
    name = next((found.name for found in listed if found.id == recording_id), "")
    header, episodes = recording.header, recording.episodes
    decisions = [decision for episode in episodes for decision in episode.decisions or ()]
    return RecordingBody(
        **_about(recording_id, name, header),
        fault=None,
        supervision=header.supervision,
        successes=sum(episode.is_success for episode in episodes),
        outcomes=_counts(episode.outcome for episode in episodes),
        invalid_reasons=_counts(episode.invalid_reason for episode in episodes if episode.invalid_reason),
        phenomena=_counts(name for episode in episodes for name in episode.phenomena),
        has_decisions=bool(decisions),
        has_judgements=any(decision.steps_to_go is not None for decision in decisions),
        command=_command(header, recording.path.parent),
        comparable=[_line(found) for found in listed if found.id != recording_id and _same_tasks(found.header, header)],
    )


def _command(header: Header, directory: Path) -> str:
    """What records the same with decisions, as far as the header tells."""
    settings = header.settings
    words = [f"--policy {header.agent.replace(' ', '-')}" if header.run is None else header.run]
    if header.run is not None:
        words.append(f"--actions {header.actions}")
    words.append(f"--configuration {settings.configuration}")
    usual = {"corpus": "builtin", "rules": "paper"}
    words += [f"--{name} {getattr(settings, name)}" for name in usual if getattr(settings, name) != usual[name]]
    words.append(f"--split {header.split}")
    words += [f"--seed {header.seed}"] if header.seed else []
    words += [f"--passes {header.passes}"] if header.passes > 1 else []
    return f"lilgym-mp evaluate {' '.join(words)} --record {directory} --record-decisions --force"


def _same_tasks(one: Header | None, other: Header) -> bool:
    return one is not None and (one.settings.configuration, one.split, one.tasks_sha256) == (
        other.settings.configuration,
        other.split,
        other.tasks_sha256,
    )


def _counts(names: Any) -> list[CountBody]:
    return [CountBody(name=name, episodes=count) for name, count in Counter(names).most_common()]


def episodes_body(recording: Recording, filters: Filters, offset: int) -> EpisodesBody:
    passing = [(index, episode) for index, episode in enumerate(recording.episodes) if filters.passes(episode)]
    shown = passing[offset : offset + MOST_LISTED]
    return EpisodesBody(
        total=len(passing), episodes=[EpisodeLine(**_episode_line(index, episode)) for index, episode in shown]
    )


def _episode_line(index: int, episode: RecordedEpisode) -> dict[str, Any]:
    return {
        "index": index,
        "task": episode.task,
        "statement": episode.statement,
        "target": episode.target,
        "outcome": episode.outcome,
        "invalid_reason": episode.invalid_reason,
        "actions": len(episode.actions),
        "reward": round(episode.reward, 6),
        "statement_seen": episode.statement_seen,
    }


def episode_body(recording: Recording, index: int) -> EpisodeBody:
    """Answers 404 where there is no such episode, 422 where its actions cannot be played again."""
    if not 0 <= index < len(recording.episodes):
        raise refusal(404, f"this recording has episodes 0 to {len(recording.episodes) - 1}, not {index}")
    episode = recording.episodes[index]
    try:
        dynamics = recording.header.settings.dynamics()
        steps = _steps(dynamics, episode)
    except (ValueError, TypeError, IndexError) as fault:
        raise refusal(422, f"the episode cannot be played again: {fault}") from None
    return EpisodeBody(
        **_episode_line(index, episode),
        program=episode.program,
        total=round(episode.reward, 6),
        phenomena=list(episode.phenomena),
        tags=list(episode.tags),
        form_seen=episode.form_seen,
        optimal_actions=episode.optimal_actions,
        grid=_grid(dynamics.appearance),
        steps=steps,
    )


def _grid(appearance: Appearance) -> tuple[int, int]:
    return appearance.grid if isinstance(appearance, Scatter) else (3, 1)


def _steps(dynamics: Dynamics, episode: RecordedEpisode) -> list[StepBody]:
    for action in episode.actions:
        dynamics.appearance.encode(action)  # one of another appearance cannot be played
    seen = scenes(dynamics, dynamics.appearance.check_scene(episode.start), episode.actions)
    if episode.outcome == "horizon" and not dynamics.rules.applies_edit_at_horizon:
        seen[-1] = seen[-2]
    decisions = episode.decisions or (None,) * len(episode.actions)
    cell_of = _cell_of(dynamics.appearance)
    steps = [
        StepBody(
            scene=scene_body(scene),
            action=describe(action),
            reward=reward,
            decision=None if decision is None else _decision_body(decision, cell_of),
            legal=_legal(dynamics, scene),
        )
        for scene, action, reward, decision in zip(seen, episode.actions, episode.rewards, decisions, strict=False)
    ]
    return [*steps, StepBody(scene=scene_body(seen[-1]), action=None, reward=None, decision=None, legal=[])]


def _cell_of(appearance: Appearance) -> Callable[[int], tuple[int, int]]:
    """From a cell to its column and row."""
    rows = _grid(appearance)[1]
    return lambda cell: (cell // rows, cell % rows)


def _legal(dynamics: Dynamics, scene: Scene) -> list[LegalCell]:
    columns, rows = _grid(dynamics.appearance)
    if columns * rows > MOST_CELLS:
        return []
    kinds, cells, count = places(dynamics.appearance)
    mask = dynamics.appearance.legal_mask(scene, dynamics.rules.placement)
    adds, removes = (
        np.bincount(cells[mask & (kinds == kind)], minlength=count) for kind in (ActionType.ADD, ActionType.REMOVE)
    )
    return [
        LegalCell(column=cell // rows, row=cell % rows, add=int(adds[cell]), remove=bool(removes[cell]))
        for cell in np.flatnonzero(adds + removes).tolist()
    ]


def _decision_body(decision: Decision, cell_of: Callable[[int], tuple[int, int]]) -> DecisionBody:
    stop, add, remove = decision.types
    cells: list[CellBody] = []
    for cell in sorted({*decision.add_cells, *decision.remove_cells}):
        column, row = cell_of(cell)
        adds, removes = decision.add_cells.get(cell, 0.0), decision.remove_cells.get(cell, 0.0)
        cells.append(CellBody(column=column, row=row, add=adds, remove=removes))
    return DecisionBody(
        stop=stop,
        add=add,
        remove=remove,
        cells=cells,
        likeliest=[LikelyAction(action=describe(action), probability=share) for action, share in decision.likeliest],
        legal_stop=decision.legal[ActionType.STOP],
        legal_add=decision.legal[ActionType.ADD],
        legal_remove=decision.legal[ActionType.REMOVE],
        legal_probability=decision.legal_probability,
        value=decision.value,
        success_probability=decision.success_probability,
        programs=[LikelyProgram(program=program, probability=share) for program, share in decision.programs.items()],
        optimal=decision.optimal,
        steps_to_go=decision.steps_to_go,
        answers=[AnswerBody(**answer._asdict()) for answer in decision.answers],
    )
