"""Validation of PPO on held-out tasks, which chooses the best weights."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import fmean

from torch import Tensor

from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.evaluation import evaluate
from lilgym_mp.learning.common.model import Model
from lilgym_mp.learning.common.run_directory import VALIDATIONS_FILE, RunDirectory
from lilgym_mp.learning.common.tasks import TRAINING_SPLIT
from lilgym_mp.learning.ppo.agent import ModelPolicy
from lilgym_mp.learning.ppo.learner import PPORecipe


@dataclass
class ValidationState:
    """The validations so far, in a checkpoint; field names are part of its format."""

    validated_at: int = 0
    best: float | None = None  # accuracy
    best_steps: int = 0
    without_better: int = 0  # validations since the best one


class Validation:
    """Plays the held-out tasks and keeps the best weights; without such tasks it does nothing."""

    def __init__(self, settings: EnvConfig, recipe: PPORecipe, task_ids: tuple[str, ...], run: RunDirectory) -> None:
        self._settings = settings
        self._recipe = recipe
        self._task_ids = task_ids
        self._run = run
        self.state = ValidationState()
        self.best_weights: dict[str, Tensor] | None = None

    def is_due(self, steps: int) -> bool:
        """Whether `steps` are enough since the last validation; never without validation tasks."""
        return bool(self._task_ids) and steps - self.state.validated_at >= self._recipe.validate_every

    @property
    def is_out_of_patience(self) -> bool:
        """Whether too many validations in a row brought no better result; never if patience is 0."""
        return 0 < self._recipe.patience <= self.state.without_better

    def validate(self, model: Model, steps: int) -> None:
        """Plays the tasks, unless done at this step already."""
        state = self.state
        seed = self._recipe.seed
        if not self._task_ids or (state.best is not None and state.validated_at == steps):
            return
        policy = ModelPolicy(model.eval(), mask=self._recipe.mask, sampled=self._recipe.sampled)
        episodes = evaluate(policy, self._settings, TRAINING_SPLIT, seed=seed, task_ids=self._task_ids)
        model.clear_cache()
        accuracy = fmean([episode.is_success for episode in episodes])
        state.validated_at = steps
        state.without_better += 1
        if state.best is None or accuracy > state.best:
            state.best = accuracy
            state.best_steps = steps
            state.without_better = 0
            self.best_weights = {name: tensor.detach().clone() for name, tensor in model.state_dict().items()}
        line = {"steps": steps, "tasks": len(episodes), "accuracy": accuracy, "best_steps": state.best_steps}
        self._run.record(line, VALIDATIONS_FILE)
