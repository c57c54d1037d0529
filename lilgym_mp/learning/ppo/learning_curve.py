"""Evaluations on dev while PPO trains, for learning curves."""

from __future__ import annotations

from collections.abc import Mapping
from statistics import fmean
from typing import NamedTuple

from lilgym_mp.corpus import CorpusError, load_tasks
from lilgym_mp.corpus.matching import solvable_matching_corpus
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.evaluation import Episode, Policy, evaluate
from lilgym_mp.evaluation.episodes import scenes
from lilgym_mp.learning.common.model import Model
from lilgym_mp.learning.common.run_directory import EVALUATIONS_FILE, RunDirectory
from lilgym_mp.learning.ppo.agent import ModelPolicy
from lilgym_mp.learning.ppo.learner import PPORecipe
from lilgym_mp.programs.task import Task
from lilgym_mp.scene.actions import Stop

SPLIT = "dev"


class LearningCurve:
    """Evaluations on dev at intervals of `every` steps, with the same random numbers each time."""

    def __init__(self, settings: EnvConfig, recipe: PPORecipe, every: int, run: RunDirectory) -> None:
        """Raises CorpusError when dev has no tasks."""
        settings.tasks(SPLIT)
        self._settings = settings
        self._recipe = recipe
        self._every = every
        self._run = run
        self._dynamics = settings.dynamics()
        self._matching = _matching_tasks(settings)
        self.last: int | None = None  # steps of the latest point

    def is_due(self, steps: int) -> bool:
        """Whether `steps` are enough since the last evaluation; the first is always due."""
        return self.last is None or steps - self.last >= self._every

    def add_point(self, model: Model, steps: int) -> None:
        """Appends a point, unless there is one at this step already."""
        if self.last == steps:
            return
        point = self.evaluation(ModelPolicy(model.eval(), mask=self._recipe.mask, sampled=True), steps)
        model.clear_cache()  # cached values differ by rounding; training must not depend on evaluations
        self._run.record(point._asdict(), EVALUATIONS_FILE)
        self.last = steps

    def evaluation(self, policy: Policy, steps: int) -> DevEvaluation:
        """Plays the dev split once; accuracies on solvable tasks are None where the curve has none."""
        episodes = evaluate(policy, self._settings, SPLIT, seed=self._recipe.seed)
        solvable = [episode for episode in episodes if episode.task in self._matching]
        return DevEvaluation(
            steps,
            len(episodes),
            fmean([episode.is_success for episode in episodes]),
            fmean([episode.reward for episode in episodes]),
            len(solvable) or None,
            fmean([episode.is_success for episode in solvable]) if solvable else None,
            fmean([self._stopped_in_goal(episode) for episode in solvable]) if solvable else None,
        )

    def _stopped_in_goal(self, episode: Episode) -> bool:
        last = scenes(self._dynamics, episode.start, episode.actions)[-1]
        return isinstance(episode.actions[-1], Stop) and self._matching[episode.task].solved_by(last)


class DevEvaluation(NamedTuple):
    """One episode from each start scene of dev; fractions from 0 to 1."""

    steps: int  # training steps so far
    start_scenes: int
    accuracy: float
    mean_reward: float
    # Scratch only: tasks for which the corpus has a scene labelled with the target (Figure 4); else None
    start_scenes_with_image: int | None
    accuracy_with_image: float | None
    image_accuracy: float | None  # fraction of them that end with STOP in such a scene: the NLVR reward's success


def _matching_tasks(settings: EnvConfig) -> Mapping[str, Task]:
    """By id, the tasks with a scene of the corpus labelled with the target; none for FlipIt or without labels."""
    try:
        tasks = load_tasks(settings.corpus, settings.appearance, settings.start, SPLIT)
        return {task.id: task for task in solvable_matching_corpus(tasks)}
    except CorpusError:
        return {}
