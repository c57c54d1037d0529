"""Evaluations while a run trains: the points of its learning curve on dev."""

from __future__ import annotations

import json
import time
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

from lilgym_mp.actions import Stop
from lilgym_mp.corpus import CorpusError, load_tasks
from lilgym_mp.corpus.matching import Content, MatchingTask, content, matching_corpus
from lilgym_mp.corpus.records import SCRATCH
from lilgym_mp.evaluation import Policy, Settings, evaluate
from lilgym_mp.evaluation.recording import scenes
from lilgym_mp.evaluation.runs import Episode
from lilgym_mp.scene import Scene

SPLIT = "dev"
Goals = Mapping[str, frozenset[Content]]  # by task, `content` of the corpus's scenes with the target as label


class DevEvaluation(NamedTuple):
    """One visit to each start scene of dev; shares from 0 to 1."""

    steps: int  # of training
    seconds: float  # of training
    start_scenes: int
    accuracy: float
    mean_reward: float
    # Of Scratch, the tasks for which the corpus has a scene with the target as label (Figure 4); else None:
    start_scenes_with_image: int | None
    accuracy_with_image: float | None
    image_accuracy: float | None  # share of them that end with STOP in such a scene, as the NLVR reward wants it


class DevEvaluator:
    """Plays dev with the same random numbers each time."""

    def __init__(self, settings: Settings, seed: int) -> None:
        """Raises CorpusError where dev has no tasks."""
        env = settings.make(SPLIT)
        self._settings, self._seed = settings, seed
        self._tasks, self._dynamics = env.tasks, env.dynamics
        self._goals = _goals(settings)

    def __call__(self, policy: Policy, steps: int, seconds: float) -> DevEvaluation:
        episodes = evaluate(policy, self._settings, SPLIT, seed=self._seed)
        found = {} if self._goals is None else self._with_images(episodes, self._goals)
        return DevEvaluation(
            steps,
            round(seconds, 3),
            len(episodes),
            _share([episode.is_success for episode in episodes]),
            sum(episode.reward for episode in episodes) / len(episodes),
            found.get("start_scenes"),
            found.get("accuracy"),
            found.get("image_accuracy"),
        )

    def _with_images(self, episodes: Sequence[Episode], goals: Goals) -> dict[str, Any]:
        kept = [episode for episode in episodes if goals[episode.task_id]]
        if not kept:
            return {}
        return {
            "start_scenes": len(kept),
            "accuracy": _share([episode.is_success for episode in kept]),
            "image_accuracy": _share([self._stopped_in(episode, goals[episode.task_id]) for episode in kept]),
        }

    def _stopped_in(self, episode: Episode, goals: frozenset[Content]) -> bool:
        actions = [self._dynamics.appearance.decode(action) for action in episode.actions]
        if not isinstance(actions[-1], Stop):
            return False
        last: Scene = scenes(self._dynamics, self._tasks.by_id(episode.task_id).start, actions)[-1]
        return content(last) in goals


def _goals(settings: Settings) -> Goals | None:
    """None of FlipIt, and of a corpus without scenes to compare with."""
    if settings.start != SCRATCH:
        return None
    try:
        tasks = matching_corpus(load_tasks(settings.corpus, settings.appearance, settings.start, SPLIT))
    except CorpusError:
        return None
    return {task.id: task.goals for task in tasks if isinstance(task, MatchingTask)}


def _share(held: Sequence[bool]) -> float:
    return sum(held) / len(held)


def last_steps(file: Path) -> int | None:
    """How far the run was at the file's last whole line, None where there is none."""
    if not file.exists():
        return None
    for line in reversed(file.read_text(encoding="utf-8").splitlines()):
        with suppress(ValueError, KeyError, TypeError):
            return int(json.loads(line)["steps"])
    return None


class TrainingClock:
    """The seconds that a run has trained, evaluations left out."""

    def __init__(self, seconds_before: float) -> None:
        self._before = seconds_before
        self._began = time.monotonic()

    @property
    def seconds(self) -> float:
        return self._before + time.monotonic() - self._began

    @contextmanager
    def paused(self) -> Generator[None, None, None]:
        """The time within does not count."""
        began = time.monotonic()
        yield
        self._began += time.monotonic() - began
