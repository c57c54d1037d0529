"""/watch: recorded episodes step by step, with the agents' predictions."""

from __future__ import annotations

import pathlib
import secrets
from collections import Counter
from collections.abc import Iterable
from contextlib import suppress
from random import Random
from tempfile import TemporaryDirectory
from threading import Lock
from typing import Annotated

from fastapi import APIRouter, HTTPException, Path, Request, Response
from pydantic import BaseModel, Field

from lilgym_mp.contrib.web.app_services import Services
from lilgym_mp.contrib.web.bodies import JSON, ConfigurationName, Name, pick, png, scene_body
from lilgym_mp.contrib.web.responses import in_turn, refusing, render_page
from lilgym_mp.contrib.web.runs import PARSER, FoundFile, Runs
from lilgym_mp.envs.rules import Dynamics
from lilgym_mp.evaluation.decisions import Decision
from lilgym_mp.evaluation.episode_files import Header, Recording
from lilgym_mp.evaluation.episodes import FINAL_OUTCOMES, Episode, scenes
from lilgym_mp.evaluation.film import episode_frames, film_frames
from lilgym_mp.evaluation.policies import AS_TRAINED, NamedPolicy
from lilgym_mp.evaluation.recording import Recorder
from lilgym_mp.evaluation.results import EvaluationPlan, play, training_statements
from lilgym_mp.programs import ProgramError
from lilgym_mp.programs.bounded import bounded_truths
from lilgym_mp.programs.errors import StepLimitError
from lilgym_mp.scene import BOX_COUNT, Scene
from lilgym_mp.scene.actions import describe

router = APIRouter()
api = APIRouter(prefix="/api/watch", tags=["watch"])

REQUESTED_EPISODES = 12
_PLAYING = Lock()  # held while an agent plays on request
PartnerName = Annotated[str, Field(max_length=100, pattern=r"^[\w:.-]+$")]
RecordingId = Annotated[str, Path(pattern=r"^[0-9a-f]{16}$", description="as returned by the list of recordings")]
EpisodeIndex = Annotated[int, Path(ge=0, le=10_000_000)]


class NewRecording(BaseModel):
    """An agent, as named on the page, and the configuration in which it plays."""

    agent: PartnerName
    configuration: ConfigurationName


@router.get("/watch", include_in_schema=False)
def watch_page(request: Request, services: Services) -> Response:
    """The page that shows agents' episodes; only configurations that each agent plays are offered."""
    offered = services.sizes()
    agents = [
        (agent, title, [name for name in services.runs.plays(agent) if name in offered])
        for agent, title in services.runs.agents().items()
    ]
    chosen = [PARSER, "TowerFlipIt"]
    return render_page(request, "watch.html", outcomes=list(FINAL_OUTCOMES), agents=agents, chosen=chosen)


@api.get("/recordings")
def recordings(services: Services, text: Name = "") -> JSON:
    """The recordings in the runs directory and those made on request.

    `first`: the id of the first one with an episode whose statement or task contains the text; null if there is none.
    """
    found = services.runs.recordings()
    return {"recordings": [_summary(*each) for each in found.items()], "first": _first(services.runs, found, text)}


def _first(runs: Runs, found: Iterable[FoundFile], text: str) -> str | None:
    for file in found:
        with suppress(HTTPException):  # an unreadable one
            episodes = runs.read(file.id).episodes
            if any(text.lower() in f"{episode.statement} {episode.task}".lower() for episode in episodes):
                return file.id
    return None


@api.post("/recordings", status_code=201)
def record(new: NewRecording, services: Services) -> JSON:
    """Lets an agent play a few tasks drawn from dev, and records them until the server ends.

    Responds with 404 or 422 if it cannot play them, 503 while another agent plays.
    """
    agent = services.runs.agent(new.agent)
    if agent.game is not None:
        raise HTTPException(422, "this agent plays the two-agent game; choose another")
    settings = services.settings(new.configuration)
    with in_turn(_PLAYING, 0, "another agent is playing"), refusing():
        ids = services.tasks(new.configuration, "dev").ids
        chosen = Random(secrets.randbits(32)).sample(ids, min(len(ids), REQUESTED_EPISODES))
        plan = EvaluationPlan(settings, "dev", record_decisions=True, task_ids=chosen)
        label = services.runs.agents()[new.agent].partition(" (")[0]
        details = {"label": label, "actions": AS_TRAINED, "recipe": agent.description.recipe}
        named = NamedPolicy(new.agent, agent.policy, agent.description.supervision, details=details)
        seen = training_statements(settings, named)
        recorder = Recorder(settings, "dev", seen, judges_decisions=True)
        path = recorder.write(services.runs.requested, play(named, plan, seen))
    return {"id": next(file.id for file in services.runs.recordings() if file.path == path)}


@api.get("/recordings/{recording_id}")
def recording(recording_id: RecordingId, services: Services) -> JSON:
    """A recording: agent, settings, outcome counts, its episodes, and other recordings of the same tasks."""
    recording = services.runs.read(recording_id)
    header = recording.header
    episodes = recording.episodes
    files = services.runs.recordings()
    return {
        **next(_summary(*each) for each in files.items() if each[0].id == recording_id),
        "supervision": header.supervision,
        "successes": sum(episode.is_success for episode in episodes),
        "outcomes": dict(Counter(episode.outcome for episode in episodes).most_common()),
        "played": [_episode_summary(index, episode) for index, episode in enumerate(episodes)],
        "comparable": [
            _summary(file, other)
            for file, other in files.items()
            if file.id != recording_id and _task_set(other) == _task_set(header)
        ],
    }


@api.get("/recordings/{recording_id}/episodes/{index}")
def episode(recording_id: RecordingId, index: EpisodeIndex, services: Services) -> JSON:
    """An episode step by step: scenes, actions, legal cells, and the agent's predictions."""
    recording = services.runs.read(recording_id)
    episode = _find_episode(recording, index)
    try:
        dynamics = recording.header.settings.dynamics()
        steps = _steps(dynamics, episode)
    except (ValueError, TypeError, IndexError) as fault:
        raise HTTPException(422, f"the episode cannot be replayed: {fault}") from None
    return {
        **_episode_summary(index, episode),
        **pick(episode, "program", "tags", "form_seen", "optimal_actions"),
        "total": round(episode.reward, 6),
        "grid": dynamics.appearance.grid or (BOX_COUNT, 1),
        "steps": steps,
    }


@api.get("/recordings/{recording_id}/episodes/{index}/picture", response_class=Response)
def picture(recording_id: RecordingId, index: EpisodeIndex, services: Services) -> Response:
    """The start scene of an episode, as a PNG image."""
    found = _find_episode(services.runs.read(recording_id), index)
    return Response(png(found.start), media_type="image/png")


@api.get("/recordings/{recording_id}/episodes/{index}/film", response_class=Response)
def film(recording_id: RecordingId, index: EpisodeIndex, services: Services) -> Response:
    """An episode as an animated GIF. Responds with 422 if its task is not there."""
    recording = services.runs.read(recording_id)
    found = _find_episode(recording, index)
    header = recording.header
    with refusing(), TemporaryDirectory() as directory:
        path = pathlib.Path(directory, "film.gif")
        film_frames(path, [list(episode_frames(header.settings.make(header.split), found))], columns=1)
        return Response(path.read_bytes(), media_type="image/gif")


def _find_episode(recording: Recording, index: int) -> Episode:
    """Responds with 404 if there is no such episode."""
    if index >= len(recording.episodes):
        raise HTTPException(404, f"this recording has episodes 0 to {len(recording.episodes) - 1}, not {index}")
    return recording.episodes[index]


def _summary(file: FoundFile, header: Header) -> JSON:
    """A recording in the list."""
    names = ("agent", "split", "corpus", "actions", "mask", "seed", "training_seed", "episodes")
    return {"id": file.id, "name": file.name, **pick(header, *names), **pick(header.settings, "configuration", "rules")}


def _episode_summary(index: int, episode: Episode) -> JSON:
    names = ("task", "statement", "target", "outcome", "invalid_reason", "statement_seen")
    rest = {"index": index, "actions": len(episode.actions), "reward": round(episode.reward, 6)}
    return {**pick(episode, *names), **rest}


def _task_set(header: Header) -> tuple[str, str, str]:
    return header.settings.configuration, header.split, header.tasks_sha256


def _steps(dynamics: Dynamics, episode: Episode) -> list[JSON]:
    """Scenes with the actions taken in them; the last scene has no action."""
    for action in episode.actions:
        dynamics.appearance.encode(action)  # raises for an action of another appearance
    visited = scenes(dynamics, dynamics.appearance.check_scene(episode.start), episode.actions)
    decisions = episode.decisions or (None,) * len(episode.actions)
    steps = [
        {
            "scene": scene_body(scene),
            "action": describe(action),
            "reward": reward,
            "decision": decision and _decision_body(decision, scene, episode.target),
        }
        for scene, action, reward, decision in zip(visited, episode.actions, episode.rewards, decisions, strict=False)
    ]
    return [*steps, {"scene": scene_body(visited[-1]), "action": None, "reward": None, "decision": None}]


def _has_value(program: str, scene: Scene, value: bool) -> bool:
    """Also for untrusted programs: invalid and slow ones have none."""
    try:
        return bounded_truths(program, [scene]) == [value]
    except (ProgramError, StepLimitError):
        return False


def _decision_body(decision: Decision, scene: Scene, target: bool) -> JSON:
    """The agent's predictions before an action; `satisfied`: the programs that have the target value in this scene."""
    satisfied = [program for program in decision.programs if _has_value(program, scene, target)]
    return {**decision.to_json(), "satisfied": satisfied}
