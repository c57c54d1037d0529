"""Checks recordings by playing their actions again, without the agent."""

from __future__ import annotations

from collections import Counter

from lilgym_mp.evaluation.episodes import EpisodesError, RecordedEpisode, Recording
from lilgym_mp.rules import Dynamics, Outcome
from lilgym_mp.task import Task

TOLERANCE = 1e-9  # of a reward


def check_recording(recording: Recording) -> None:
    """Raises EpisodesError naming the file and what is wrong, unless every number of the recording is true.

    Its tasks must be those of the installed corpus, each played as often as the header says, and its actions must have
    the recorded rewards and outcome.
    """
    header = recording.header
    tasks = header.settings.make(header.split).tasks
    found = tasks.provenance.sha256
    if header.tasks_sha256 != found:
        raise _error(recording, f"its tasks have the checksum {header.tasks_sha256[:10]}, those installed {found[:10]}")
    played = Counter(episode.task for episode in recording.episodes)
    for task in tasks:
        if played.pop(task.id, 0) != header.passes:
            raise _error(recording, f"the task {task.id} must be played {header.passes} times")
    if played:
        raise _error(recording, f"the split {header.split} has no task {next(iter(played))}")
    if header.stop_forcing:
        raise _error(recording, "STOP was forced, which evaluations must not do")
    dynamics = header.settings.dynamics()
    for index, episode in enumerate(recording.episodes):
        if (fault := _fault(dynamics, tasks.by_id(episode.task), episode)) is not None:
            raise _error(recording, f"episode {index} ({episode.task}): {fault}")


def _fault(dynamics: Dynamics, task: Task, episode: RecordedEpisode) -> str | None:
    recorded = episode.statement, episode.program, episode.target, episode.start
    if recorded != (task.statement, task.program, task.target, task.start):
        return "its statement, program, target or start scene is not the task's"
    state = dynamics.start(task)
    outcome = Outcome.CONTINUES
    for action, reward in zip(episode.actions, episode.rewards, strict=True):
        if outcome is not Outcome.CONTINUES:
            return f"it has actions after {outcome}"
        transition = dynamics.step(state, action)
        state, outcome = transition.state, transition.outcome
        if abs(transition.reward - reward) > TOLERANCE:
            return f"its reward {reward:g} is {transition.reward:g} when played again"
    return None if outcome == episode.outcome else f"its outcome {episode.outcome} is {outcome} when played again"


def _error(recording: Recording, problem: str) -> EpisodesError:
    return EpisodesError(f"{recording.path}: {problem}")
