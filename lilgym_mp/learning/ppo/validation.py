"""Play besides training: held-out tasks, which choose the best weights, and dev, for learning curves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from statistics import fmean
from typing import NamedTuple

from torch import Tensor

from lilgym_mp.corpus import CorpusError, load_tasks
from lilgym_mp.evaluation import Episode, Policy, Settings, evaluate
from lilgym_mp.evaluation.episodes import scenes
from lilgym_mp.learning.common.model import Model
from lilgym_mp.learning.common.run_directory import EVALUATIONS_FILE, VALIDATIONS_FILE, RunDirectory
from lilgym_mp.learning.common.tasks import TRAINING_SPLIT
from lilgym_mp.learning.ppo.agent import ModelPolicy
from lilgym_mp.learning.ppo.learner import PPORecipe
from lilgym_mp.programs.task import Task
from lilgym_mp.scene.actions import Stop

SPLIT = "dev"


@dataclass
class ValidationState:
    """The validations so far, in a checkpoint; field names are part of its format."""

    validated_at: int = 0
    best: float | None = None  # accuracy
    best_steps: int = 0
    without_better: int = 0  # validations since the best one


class Validation:
    """Plays the held-out tasks and keeps the best weights; without such tasks it does nothing."""

    def __init__(self, settings: Settings, recipe: PPORecipe, task_ids: tuple[str, ...], run: RunDirectory) -> None:
        self._settings, self._recipe, self._task_ids, self._run = settings, recipe, task_ids, run
        self.state = ValidationState()
        self.best_weights: dict[str, Tensor] | None = None

    def is_due(self, steps: int) -> bool:
        return bool(self._task_ids) and steps - self.state.validated_at >= self._recipe.validate_every

    @property
    def is_out_of_patience(self) -> bool:
        return 0 < self._recipe.patience <= self.state.without_better

    def validate(self, model: Model, steps: int) -> None:
        """Plays the tasks, unless done at this step already."""
        state, seed = self.state, self._recipe.seed
        if not self._task_ids or (state.best is not None and state.validated_at == steps):
            return
        policy = ModelPolicy(model.eval(), mask=self._recipe.mask, sampled=self._recipe.sampled)
        episodes = evaluate(policy, self._settings, TRAINING_SPLIT, seed=seed, task_ids=self._task_ids)
        model.clear_cache()
        accuracy = fmean([episode.is_success for episode in episodes])
        state.validated_at = steps
        state.without_better += 1
        if state.best is None or accuracy > state.best:
            state.best, state.best_steps, state.without_better = accuracy, steps, 0
            self.best_weights = {name: tensor.detach().clone() for name, tensor in model.state_dict().items()}
        line = {"steps": steps, "tasks": len(episodes), "accuracy": accuracy, "best_steps": state.best_steps}
        self._run.record(line, VALIDATIONS_FILE)


class LearningCurve:
    """Evaluations on dev at intervals of `every` steps, with the same random numbers each time."""

    def __init__(self, settings: Settings, recipe: PPORecipe, every: int, run: RunDirectory) -> None:
        """Raises CorpusError when dev has no tasks."""
        settings.tasks(SPLIT)
        self._settings, self._recipe, self._every, self._run = settings, recipe, every, run
        self._dynamics, self._matching = settings.dynamics(), _matching_tasks(settings)
        self.last: int | None = None  # steps of the latest point

    def is_due(self, steps: int) -> bool:
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


def _matching_tasks(settings: Settings) -> Mapping[str, Task]:
    """By id, the tasks with a scene of the corpus labelled with the target; none for FlipIt or without labels."""
    from lilgym_mp.corpus.matching import solvable_matching_corpus

    try:
        tasks = load_tasks(settings.corpus, settings.appearance, settings.start, SPLIT)
        return {task.id: task for task in solvable_matching_corpus(tasks)}
    except CorpusError:
        return {}
