"""What a PPO run plays besides training: held-out tasks, which choose the best weights, and dev for learning curves."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from torch import Tensor

from lilgym_mp.evaluation import Settings, evaluate
from lilgym_mp.learning.dev_evaluation import DevEvaluator, last_steps
from lilgym_mp.learning.ppo.agent import ModelPolicy
from lilgym_mp.learning.ppo.models.protocol import Model
from lilgym_mp.learning.ppo.recipe import PPORecipe
from lilgym_mp.learning.ppo.tasks import TRAINING_SPLIT

EVALUATIONS_FILE = "evaluations.jsonl"
VALIDATIONS_FILE = "validations.jsonl"


@dataclass
class ValidationState:
    """The validations so far, in a checkpoint; field names are part of its format."""

    validated_at: int = 0
    best: float | None = None  # accuracy
    best_steps: int = 0
    without_better: int = 0  # validations since the best one


class Validation:
    """Plays the held-out tasks and keeps the best weights; without such tasks it does nothing."""

    def __init__(self, settings: Settings, recipe: PPORecipe, task_ids: tuple[str, ...], path: Path) -> None:
        """`path`: the run directory."""
        self._settings, self._recipe, self._task_ids = settings, recipe, task_ids
        self._file = path / VALIDATIONS_FILE
        self.state = ValidationState()
        self.best_weights: dict[str, Tensor] | None = None

    def is_due(self, steps: int) -> bool:
        return bool(self._task_ids) and steps - self.state.validated_at >= self._recipe.validate_every

    @property
    def is_out_of_patience(self) -> bool:
        return 0 < self._recipe.patience <= self.state.without_better

    def validate(self, model: Model, steps: int) -> None:
        """Plays the tasks, unless done at this step already."""
        state, recipe = self.state, self._recipe
        if not self._task_ids or (state.best is not None and state.validated_at == steps):
            return
        episodes = evaluate(
            playing(model, recipe, sampled=recipe.sampled),
            self._settings,
            TRAINING_SPLIT,
            seed=recipe.seed,
            task_ids=self._task_ids,
        )
        model.clear_cache()
        accuracy = sum(episode.is_success for episode in episodes) / len(episodes)
        state.validated_at = steps
        state.without_better += 1
        if state.best is None or accuracy > state.best:
            state.best, state.best_steps, state.without_better = accuracy, steps, 0
            self.best_weights = {name: tensor.detach().clone() for name, tensor in model.state_dict().items()}
        line = {"steps": steps, "tasks": len(episodes), "accuracy": accuracy, "best_steps": state.best_steps}
        with self._file.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")


class LearningCurve:
    """Evaluations on dev at intervals of `every` steps."""

    def __init__(self, settings: Settings, recipe: PPORecipe, every: int) -> None:
        """Raises CorpusError when dev has no tasks."""
        self._evaluator, self._recipe, self._every = DevEvaluator(settings, recipe.seed), recipe, every

    def is_due(self, path: Path, steps: int) -> bool:
        last = last_steps(path / EVALUATIONS_FILE)
        return last is None or steps - last >= self._every

    def add_point(self, path: Path, model: Model, steps: int, seconds: float) -> None:
        """Appends a point, unless there is one at this step already. `path`: the run directory."""
        last = last_steps(path / EVALUATIONS_FILE)
        if last is not None and steps <= last:
            return
        point = self._evaluator(playing(model, self._recipe, sampled=True), steps, seconds)
        model.clear_cache()  # cached values differ by rounding; training must not depend on evaluations
        with (path / EVALUATIONS_FILE).open("a", encoding="utf-8") as lines:
            lines.write(json.dumps(point._asdict()) + "\n")


def playing(model: Model, recipe: PPORecipe, *, sampled: bool) -> ModelPolicy:
    """The model's policy, in evaluation mode."""
    return ModelPolicy(model.eval(), mask=recipe.mask, sampled=sampled)
