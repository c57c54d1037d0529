"""/watch: recorded episodes step by step, with the agents' predictions."""

from __future__ import annotations

from collections import Counter
from pathlib import Path as FilePath
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Path, Query, Request, Response
from pydantic import BaseModel

from lilgym_mp.actions import ActionType, describe
from lilgym_mp.appearances import Appearance, InvalidReason
from lilgym_mp.evaluation.decisions import Decision, action_cells
from lilgym_mp.evaluation.episodes import GREEDY, SAMPLED, Header, RecordedEpisode, Recording
from lilgym_mp.evaluation.recording import scenes
from lilgym_mp.evaluation.runs import FINAL_OUTCOMES
from lilgym_mp.rules import Dynamics
from lilgym_mp.scene import BOX_COUNT, Scene
from lilgym_mp.web.app_services import Services
from lilgym_mp.web.bodies import Body, Reward, SceneBody, png, scene_body
from lilgym_mp.web.errors import http_error
from lilgym_mp.web.field_types import OutcomeName
from lilgym_mp.web.run_directory import RecordingFile, RunDirectory, UnreadableRecording
from lilgym_mp.web.templating import render_page

router = APIRouter()
api = APIRouter(prefix="/api/watch", tags=["watch"])

EPISODES_PER_RESPONSE = 100
MAX_GRID_CELLS = 2_000  # finer grids get no legal cells
RecordingId = Annotated[str, Path(pattern=r"^[0-9a-f]{16}$", description="as returned by the list of recordings")]
EpisodeIndex = Annotated[int, Path(ge=0, le=10_000_000)]


class RecordingSummary(Body):
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


class RunSummary(Body):
    """A run with an agent, and the command that records its episodes."""

    id: str
    name: str
    command: str


class RecordingsBody(Body):
    """Recordings and runs in the runs directory; `directory` is null if the server has none."""

    directory: str | None
    recordings: list[RecordingSummary]
    runs: list[RunSummary]


class RecordingBody(RecordingSummary):
    """A recording with summary statistics."""

    supervision: str
    successes: int
    outcomes: dict[str, int]  # numbers of episodes, like the next
    invalid_reasons: dict[str, int]
    has_decisions: bool
    has_judgements: bool
    command: str  # records the same episodes with decisions
    comparable: list[RecordingSummary]  # other recordings of the same tasks


class EpisodeSummary(Body):
    """An entry of the episode list."""

    index: int
    task: str
    statement: str
    target: bool
    outcome: str
    invalid_reason: str | None
    actions: int
    reward: Reward
    statement_seen: bool


class EpisodesBody(Body):
    """A page of the matching episodes, in the recording's order, and how many match."""

    total: int
    episodes: list[EpisodeSummary]


class CellBody(Body):
    """The probabilities of ADD and REMOVE at a grid cell. Tower has one row, a column per box."""

    column: int
    row: int
    add: float
    remove: float


class AnswerBody(Body):
    """A language model's answer, and whether it was understood as a single action."""

    text: str
    understood: bool


class DecisionBody(Body):
    """The agent's predictions before an action."""

    stop: float
    add: float
    remove: float
    cells: list[CellBody]
    likeliest: dict[str, float]  # probabilities by action, like those by program, in descending order
    legal_stop: int
    legal_add: int
    legal_remove: int
    legal_probability: float
    value: float | None
    success_probability: float | None
    programs: dict[str, float]
    optimal: bool | None
    steps_to_go: int | None
    answers: list[AnswerBody]
    notes: list[str]


class LegalCell(Body):
    """A grid cell with at least one legal action, by the exact mask."""

    column: int
    row: int
    add: int  # number of legal ADDs
    remove: bool


class StepBody(Body):
    """A scene and the action taken in it; the last scene has no action."""

    scene: SceneBody
    action: str | None
    reward: float | None
    decision: DecisionBody | None
    legal: list[LegalCell]


class EpisodeBody(EpisodeSummary):
    """An episode with all of its steps."""

    program: str
    total: Reward
    tags: list[str]
    form_seen: bool
    optimal_actions: int | None
    grid: tuple[int, int]
    steps: list[StepBody]


class EpisodeFilters(BaseModel):
    """Criteria for episodes; None matches any."""

    success: bool | None = None
    outcome: OutcomeName | None = None
    invalid_reason: InvalidReason | None = None
    seen: Annotated[bool | None, Query(description="whether the statement occurs in the training tasks")] = None
    target: bool | None = None
    task: Annotated[str | None, Query(max_length=200)] = None
    text: Annotated[str, Query(max_length=200, description="contained in the statement or the task's id")] = ""
    offset: Annotated[int, Query(ge=0, le=10_000_000)] = 0

    def matches(self, episode: RecordedEpisode) -> bool:
        criteria = (
            (self.success, episode.is_success),
            (self.outcome, episode.outcome),
            (self.invalid_reason, episode.invalid_reason),
            (self.seen, episode.statement_seen),
            (self.target, episode.target),
            (self.task, episode.task),
        )
        return all(wanted is None or wanted == actual for wanted, actual in criteria) and (
            self.text.lower() in episode.statement.lower() or self.text.lower() in episode.task.lower()
        )


@router.get("/watch", include_in_schema=False)
def watch_page(request: Request) -> Response:
    return render_page(
        request,
        "watch.html",
        outcomes=list(FINAL_OUTCOMES),
        invalid_reasons=[str(reason) for reason in InvalidReason],
    )


@api.get("/recordings")
def recordings(services: Services) -> RecordingsBody:
    """The recordings in the runs directory, and its runs whose agents can be recorded."""
    directory = services.run_directory.directory
    return RecordingsBody(
        directory=None if directory is None else str(directory),
        recordings=[_summary(file) for file in services.run_directory.recordings()],
        runs=[
            RunSummary.of(agent, command=f"lilgym-mp evaluate {run} --record {run} --record-decisions")
            for agent in services.run_directory.agents().values()
            if (run := agent.path.parent)
        ],
    )


@api.get("/recordings/{recording_id}")
def recording(recording_id: RecordingId, services: Services) -> RecordingBody:
    """A recording: agent, settings, outcome counts, and other recordings of the same tasks."""
    read = _read(services.run_directory, recording_id)
    files = services.run_directory.recordings()
    header, episodes = read.header, read.episodes
    decisions = [decision for episode in episodes for decision in episode.decisions or ()]
    return RecordingBody.of(
        header,
        id=recording_id,
        name=next((file.name for file, _, _ in files if file.id == recording_id), ""),
        fault=None,
        configuration=header.settings.configuration,
        rules=header.settings.rules,
        successes=sum(episode.is_success for episode in episodes),
        outcomes=dict(Counter(episode.outcome for episode in episodes).most_common()),
        invalid_reasons=Counter(episode.invalid_reason for episode in episodes if episode.invalid_reason),
        has_decisions=bool(decisions),
        has_judgements=any(decision.steps_to_go is not None for decision in decisions),
        command=_rerecord_command(header, read.path.parent),
        comparable=[
            _summary(one)
            for one in files
            if one.file.id != recording_id and one.header and _task_set(one.header) == _task_set(header)
        ],
    )


@api.get("/recordings/{recording_id}/episodes")
def episodes(
    recording_id: RecordingId, services: Services, filters: Annotated[EpisodeFilters, Query()]
) -> EpisodesBody:
    """Episodes that match the filters: at most 100, starting at `offset`."""
    found = enumerate(_read(services.run_directory, recording_id).episodes)
    matching = [(index, episode) for index, episode in found if filters.matches(episode)]
    page = matching[filters.offset : filters.offset + EPISODES_PER_RESPONSE]
    summaries = [EpisodeSummary.of(episode, index=index, actions=len(episode.actions)) for index, episode in page]
    return EpisodesBody(total=len(matching), episodes=summaries)


@api.get("/recordings/{recording_id}/episodes/{index}")
def episode(recording_id: RecordingId, index: EpisodeIndex, services: Services) -> EpisodeBody:
    """An episode step by step: scenes, actions, legal cells, and the agent's predictions."""
    recording = _read(services.run_directory, recording_id)
    episode = _find_episode(recording, index)
    try:
        dynamics = recording.header.settings.dynamics()
        steps = _steps(dynamics, episode)
    except (ValueError, TypeError, IndexError) as fault:
        raise http_error(422, f"the episode cannot be replayed: {fault}") from None
    return EpisodeBody.of(
        episode,
        index=index,
        actions=len(episode.actions),
        total=episode.reward,
        grid=_grid(dynamics.appearance),
        steps=steps,
    )


@api.get("/recordings/{recording_id}/episodes/{index}/picture", response_class=Response)
def picture(recording_id: RecordingId, index: EpisodeIndex, services: Services) -> Response:
    """The start scene of an episode, as a PNG image."""
    recording = _read(services.run_directory, recording_id)
    return Response(png(_find_episode(recording, index).start), media_type="image/png")


def _read(run_directory: RunDirectory, recording_id: str) -> Recording:
    """Responds with 404 if there is no such recording, 422 if it is unreadable."""
    try:
        recording = run_directory.read(recording_id)
    except UnreadableRecording as fault:
        raise http_error(422, str(fault)) from None
    if recording is None:
        raise http_error(404, "there is no such recording; it may have been moved: reload the list")
    return recording


def _find_episode(recording: Recording, index: int) -> RecordedEpisode:
    """Responds with 404 if there is no such episode."""
    if index >= len(recording.episodes):
        raise http_error(404, f"this recording has episodes 0 to {len(recording.episodes) - 1}, not {index}")
    return recording.episodes[index]


def _summary(recording: RecordingFile) -> RecordingSummary:
    file, header, fault = recording
    if header is None:
        return RecordingSummary(id=file.id, name=file.name, fault=fault)
    settings = header.settings
    own = {"id": file.id, "name": file.name, "configuration": settings.configuration, "rules": settings.rules}
    return RecordingSummary.of(header, fault=None, **own)


def _rerecord_command(header: Header, directory: FilePath) -> str:
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


def _task_set(header: Header) -> tuple[str, str, str]:
    return header.settings.configuration, header.split, header.tasks_sha256


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
    kinds: dict[str, Any] = {}
    for name, kind in (("stop", ActionType.STOP), ("add", ActionType.ADD), ("remove", ActionType.REMOVE)):
        kinds |= {name: decision.types[kind], f"legal_{name}": decision.legal[kind]}
    adds, removes = decision.add_cells, decision.remove_cells
    return DecisionBody.of(
        decision,
        **kinds,
        cells=[
            CellBody(column=cell // rows, row=cell % rows, add=adds.get(cell, 0.0), remove=removes.get(cell, 0.0))
            for cell in sorted({*adds, *removes})
        ],
        likeliest={describe(action): share for action, share in decision.likeliest},
    )
