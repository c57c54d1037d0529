"""Response models of recorded episodes for /watch, and their construction: filters, replay, decisions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from lilgym_mp.actions import ActionType, describe
from lilgym_mp.appearances import Appearance
from lilgym_mp.evaluation.decisions import Decision, action_cells
from lilgym_mp.evaluation.episodes import GREEDY, SAMPLED, Header, RecordedEpisode, Recording
from lilgym_mp.evaluation.recording import scenes
from lilgym_mp.rules import Dynamics
from lilgym_mp.scene import BOX_COUNT, Scene
from lilgym_mp.web.errors import http_error
from lilgym_mp.web.run_directory import RecordingFile, RunDirectory, UnreadableRecording
from lilgym_mp.web.scene_body import SceneBody, scene_body

EPISODES_PER_RESPONSE = 100
MAX_GRID_CELLS = 2_000  # finer grids get no legal cells


class RecordingSummary(BaseModel):
    """A recording in the list; if its header is unreadable, `fault` says why and the other fields are null."""

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


class RunSummary(BaseModel):
    """A run with an agent, and the command that records its episodes."""

    id: str
    name: str
    command: str


class RecordingsBody(BaseModel):
    """Recordings and runs in the runs directory; `directory` is null if the server has none."""

    directory: str | None
    recordings: list[RecordingSummary]
    runs: list[RunSummary]


class CountBody(BaseModel):
    name: str
    episodes: int


class RecordingBody(RecordingSummary):
    """A recording with summary statistics."""

    supervision: str
    successes: int
    outcomes: list[CountBody]
    invalid_reasons: list[CountBody]
    phenomena: list[CountBody]
    has_decisions: bool
    has_judgements: bool
    command: str  # records the same episodes with decisions
    comparable: list[RecordingSummary]  # other recordings of the same tasks


class EpisodeSummary(BaseModel):
    """An entry of the episode list."""

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
    """A page of the matching episodes, in the recording's order, and how many match."""

    total: int
    episodes: list[EpisodeSummary]


class CellBody(BaseModel):
    """The probabilities of ADD and REMOVE at a grid cell. Tower has one row, a column per box."""

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
    """A language model's answer, and whether it was understood as a single action."""

    text: str
    understood: bool


class DecisionBody(BaseModel):
    """The agent's predictions before an action."""

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
    """A grid cell with at least one legal action, by the exact mask."""

    column: int
    row: int
    add: int  # number of legal ADDs
    remove: bool


class StepBody(BaseModel):
    """A scene and the action taken in it; the last scene has no action."""

    scene: SceneBody
    action: str | None
    reward: float | None
    decision: DecisionBody | None
    legal: list[LegalCell]


class EpisodeBody(EpisodeSummary):
    """An episode with all of its steps."""

    program: str
    total: float
    phenomena: list[str]
    tags: list[str]
    form_seen: bool
    optimal_actions: int | None
    grid: tuple[int, int]
    steps: list[StepBody]


@dataclass(frozen=True)
class EpisodeFilters:
    """Criteria for episodes; None matches any."""

    success: bool | None = None
    outcome: str | None = None
    invalid_reason: str | None = None
    seen: bool | None = None
    phenomenon: str | None = None
    target: bool | None = None
    task: str | None = None
    text: str = ""

    def matches(self, episode: RecordedEpisode) -> bool:
        criteria: Sequence[tuple[Any, Any]] = (
            (self.success, episode.is_success),
            (self.outcome, episode.outcome),
            (self.invalid_reason, episode.invalid_reason),
            (self.seen, episode.statement_seen),
            (self.target, episode.target),
            (self.task, episode.task),
        )
        return (
            all(wanted is None or wanted == actual for wanted, actual in criteria)
            and (self.phenomenon is None or self.phenomenon in episode.phenomena)
            and (self.text.lower() in episode.statement.lower() or self.text.lower() in episode.task.lower())
        )


def recordings_body(run_directory: RunDirectory) -> RecordingsBody:
    directory = run_directory.directory
    return RecordingsBody(
        directory=None if directory is None else str(directory),
        recordings=[_summary(file) for file in run_directory.recordings()],
        runs=[
            RunSummary(id=run.id, name=run.name, command=_record_command(directory / run.name))
            for run in run_directory.agent_runs()
            if directory is not None
        ],
    )


def _record_command(run: Path) -> str:
    return f"lilgym-mp evaluate {run} --record {run} --record-decisions"


def _summary(file: RecordingFile) -> RecordingSummary:
    if file.header is None:
        return RecordingSummary(id=file.id, name=file.name, fault=file.fault)
    return RecordingSummary(**_header_fields(file.id, file.name, file.header), fault=None)


def _header_fields(recording_id: str, name: str, header: Header) -> dict[str, Any]:
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


def read_recording(run_directory: RunDirectory, recording_id: str) -> Recording:
    """Responds with 404 if there is no such recording, 422 if it is unreadable."""
    try:
        recording = run_directory.read(recording_id)
    except UnreadableRecording as fault:
        raise http_error(422, str(fault)) from None
    if recording is None:
        raise http_error(404, "there is no such recording; it may have been moved: reload the list")
    return recording


def recording_body(run_directory: RunDirectory, recording_id: str) -> RecordingBody:
    """Error responses as those of `read_recording`."""
    recording = read_recording(run_directory, recording_id)
    files = run_directory.recordings()
    name = next((file.name for file in files if file.id == recording_id), "")
    header, episodes = recording.header, recording.episodes
    decisions = [decision for episode in episodes for decision in episode.decisions or ()]
    return RecordingBody(
        **_header_fields(recording_id, name, header),
        fault=None,
        supervision=header.supervision,
        successes=sum(episode.is_success for episode in episodes),
        outcomes=_counts(episode.outcome for episode in episodes),
        invalid_reasons=_counts(episode.invalid_reason for episode in episodes if episode.invalid_reason),
        phenomena=_counts(name for episode in episodes for name in episode.phenomena),
        has_decisions=bool(decisions),
        has_judgements=any(decision.steps_to_go is not None for decision in decisions),
        command=_rerecord_command(header, recording.path.parent),
        comparable=[_summary(file) for file in files if file.id != recording_id and _same_tasks(file.header, header)],
    )


def _rerecord_command(header: Header, directory: Path) -> str:
    """The command that records the same episodes with decisions, reconstructed from the header."""
    settings = header.settings
    words = [f"--policy {header.agent.replace(' ', '-')}" if header.run is None else header.run]
    if header.run is not None:
        words.append(f"--actions {SAMPLED if header.actions == SAMPLED else GREEDY}")
    words.append(f"--configuration {settings.configuration}")
    defaults = {"corpus": "builtin", "rules": "paper"}
    words += [f"--{name} {getattr(settings, name)}" for name in defaults if getattr(settings, name) != defaults[name]]
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


def episodes_body(recording: Recording, filters: EpisodeFilters, offset: int) -> EpisodesBody:
    matching = [(index, episode) for index, episode in enumerate(recording.episodes) if filters.matches(episode)]
    page = matching[offset : offset + EPISODES_PER_RESPONSE]
    return EpisodesBody(
        total=len(matching), episodes=[EpisodeSummary(**_episode_fields(index, episode)) for index, episode in page]
    )


def _episode_fields(index: int, episode: RecordedEpisode) -> dict[str, Any]:
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


def find_episode(recording: Recording, index: int) -> RecordedEpisode:
    """Responds with 404 if there is no such episode."""
    if not 0 <= index < len(recording.episodes):
        raise http_error(404, f"this recording has episodes 0 to {len(recording.episodes) - 1}, not {index}")
    return recording.episodes[index]


def episode_body(recording: Recording, index: int) -> EpisodeBody:
    """Responds with 404 if there is no such episode, 422 if its actions cannot be replayed."""
    episode = find_episode(recording, index)
    try:
        dynamics = recording.header.settings.dynamics()
        steps = _steps(dynamics, episode)
    except (ValueError, TypeError, IndexError) as fault:
        raise http_error(422, f"the episode cannot be replayed: {fault}") from None
    return EpisodeBody(
        **_episode_fields(index, episode),
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
    """Columns and rows."""
    return appearance.grid or (BOX_COUNT, 1)


def _steps(dynamics: Dynamics, episode: RecordedEpisode) -> list[StepBody]:
    for action in episode.actions:
        dynamics.appearance.encode(action)  # raises for an action of another appearance
    visited = scenes(dynamics, dynamics.appearance.check_scene(episode.start), episode.actions)
    if episode.outcome == "horizon" and not dynamics.rules.applies_edit_at_horizon:
        visited[-1] = visited[-2]
    decisions = episode.decisions or (None,) * len(episode.actions)
    rows = _grid(dynamics.appearance)[1]
    steps = [
        StepBody(
            scene=scene_body(scene),
            action=describe(action),
            reward=reward,
            decision=None if decision is None else _decision_body(decision, rows),
            legal=_legal_cells(dynamics, scene),
        )
        for scene, action, reward, decision in zip(visited, episode.actions, episode.rewards, decisions, strict=False)
    ]
    return [*steps, StepBody(scene=scene_body(visited[-1]), action=None, reward=None, decision=None, legal=[])]


def _legal_cells(dynamics: Dynamics, scene: Scene) -> list[LegalCell]:
    columns, rows = _grid(dynamics.appearance)
    if columns * rows > MAX_GRID_CELLS:
        return []
    kinds, cells, count = action_cells(dynamics.appearance)
    mask = dynamics.appearance.legal_mask(scene, dynamics.rules.placement)
    adds, removes = (
        np.bincount(cells[mask & (kinds == kind)], minlength=count) for kind in (ActionType.ADD, ActionType.REMOVE)
    )
    return [
        LegalCell(column=cell // rows, row=cell % rows, add=int(adds[cell]), remove=bool(removes[cell]))
        for cell in np.flatnonzero(adds + removes).tolist()
    ]


def _decision_body(decision: Decision, rows: int) -> DecisionBody:
    """`rows` of the grid: cell indices are column-major."""
    stop, add, remove = decision.types
    cells: list[CellBody] = []
    for cell in sorted({*decision.add_cells, *decision.remove_cells}):
        column, row = divmod(cell, rows)
        add_share, remove_share = decision.add_cells.get(cell, 0.0), decision.remove_cells.get(cell, 0.0)
        cells.append(CellBody(column=column, row=row, add=add_share, remove=remove_share))
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
