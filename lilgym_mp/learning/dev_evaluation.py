"""Evaluations on dev during training: the points of a run's learning curve."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
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
Goals = Mapping[str, frozenset[Content]]  # task id -> contents of the corpus's scenes labelled with the target


class DevEvaluation(NamedTuple):
    """One episode from each start scene of dev; fractions from 0 to 1."""

    steps: int  # training steps so far
    seconds: float  # training time so far
    start_scenes: int
    accuracy: float
    mean_reward: float
    # Scratch only: tasks for which the corpus has a scene labelled with the target (Figure 4); else None
    start_scenes_with_image: int | None
    accuracy_with_image: float | None
    image_accuracy: float | None  # fraction of them that end with STOP in such a scene: the NLVR reward's success


class DevEvaluator:
    """Evaluates on dev with the same random numbers each time."""

    def __init__(self, settings: Settings, seed: int) -> None:
        """Raises CorpusError when dev has no tasks."""
        env = settings.make(SPLIT)
        self._settings, self._seed = settings, seed
        self._tasks, self._dynamics = env.tasks, env.dynamics
        self._goals = _goals(settings)

    def __call__(self, policy: Policy, steps: int, seconds: float) -> DevEvaluation:
        episodes = evaluate(policy, self._settings, SPLIT, seed=self._seed)
        with_images = {} if self._goals is None else self._image_metrics(episodes, self._goals)
        return DevEvaluation(
            steps,
            round(seconds, 3),
            len(episodes),
            _fraction([episode.is_success for episode in episodes]),
            sum(episode.reward for episode in episodes) / len(episodes),
            with_images.get("start_scenes"),
            with_images.get("accuracy"),
            with_images.get("image_accuracy"),
        )

    def _image_metrics(self, episodes: Sequence[Episode], goals: Goals) -> dict[str, Any]:
        kept = [episode for episode in episodes if goals[episode.task_id]]
        if not kept:
            return {}
        return {
            "start_scenes": len(kept),
            "accuracy": _fraction([episode.is_success for episode in kept]),
            "image_accuracy": _fraction([self._stopped_in(episode, goals[episode.task_id]) for episode in kept]),
        }

    def _stopped_in(self, episode: Episode, goals: frozenset[Content]) -> bool:
        actions = [self._dynamics.appearance.decode(action) for action in episode.actions]
        if not isinstance(actions[-1], Stop):
            return False
        last: Scene = scenes(self._dynamics, self._tasks.by_id(episode.task_id).start, actions)[-1]
        return content(last) in goals


def _goals(settings: Settings) -> Goals | None:
    """Goal scenes by task id; None for FlipIt, and for a corpus without labelled scenes."""
    if settings.start != SCRATCH:
        return None
    try:
        tasks = matching_corpus(load_tasks(settings.corpus, settings.appearance, settings.start, SPLIT))
    except CorpusError:
        return None
    return {task.id: task.goals for task in tasks if isinstance(task, MatchingTask)}


def _fraction(flags: Sequence[bool]) -> float:
    return sum(flags) / len(flags)


def last_steps(file: Path) -> int | None:
    """The step count in the file's last complete line; None without one."""
    if not file.exists():
        return None
    for line in reversed(file.read_text(encoding="utf-8").splitlines()):
        with suppress(ValueError, KeyError, TypeError):
            return int(json.loads(line)["steps"])
    return None
