"""PPO runs: rollouts and updates, with checkpoints, validation and evaluation. Start reading at `train_ppo`.

The algorithm itself is in `update`.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple, Unpack

import numpy as np
import torch
from torch import Tensor

from lilgym_mp.corpus.records import SCRATCH
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.envs.registration import configuration_name
from lilgym_mp.evaluation.episodes import FINAL_OUTCOMES
from lilgym_mp.learning.common.factored_policy import FactoredPolicy
from lilgym_mp.learning.common.model_file import precision, weights_digest
from lilgym_mp.learning.common.run import Budget, Counters, Session, TrainingRun, training
from lilgym_mp.learning.common.tasks import training_tasks
from lilgym_mp.learning.common.update import (
    Experience,
    Losses,
    generalised_advantages,
    make_optimiser,
    mean_losses,
    schedule,
    update,
)
from lilgym_mp.learning.ppo.agent import PPOAgent, describe, make_model
from lilgym_mp.learning.ppo.learner import TRANSFORMERS, PPORecipe
from lilgym_mp.learning.ppo.rollout import EpisodeStatistics, Rollout, RolloutCollector, policy_and_values
from lilgym_mp.learning.ppo.validation import Validation, ValidationState
from lilgym_mp.scene.appearances import make_appearance
from lilgym_mp.scene.arrays import AnyDict, Int64Array, Strings


class PPOProgress(NamedTuple):
    """A line of progress.jsonl: statistics of one rollout and its updates."""

    steps: int  # so far, like the next two fields
    episodes: int
    cpu_seconds: float  # CPU time of this process, including evaluations
    steps_per_second: float  # of CPU time, in this rollout and its updates
    accuracy: float | None  # accuracy of the episodes that ended, also by stop forcing; None without any
    mean_reward: float | None
    mean_length: float | None
    outcomes: dict[str, float]  # fractions of those episodes
    forced: float  # fraction of states with a forced STOP
    policy_loss: float
    value_loss: float
    entropy: float
    clipped: float  # fraction of probability ratios outside the clip range

    @property
    def note(self) -> str:
        """Speed and accuracy in training, for the line in the terminal."""
        accuracy = "-" if self.accuracy is None else f"{100 * self.accuracy:.0f} %"
        return f"{self.steps_per_second:,.0f} steps/s, training accuracy {accuracy}"


@dataclass
class PPOCounters(Counters):
    """Counts of a PPO run."""

    steps: int = 0  # of the environments
    episodes: int = 0


class PPORun(TrainingRun):
    """Trains an agent by PPO for `steps` environment steps in total, rounded up to whole rollouts with their updates.

    `out`: an empty or new directory, or with `resume` that of the run to continue, which must have the same settings,
    recipe and weights. With `evaluate_every` the agent is evaluated on dev (`DevEvaluation`) at the start, at intervals
    of that many steps, and at the end, without affecting training. With equal seed and threads an interrupted and
    resumed run trains the same agent as an uninterrupted one. Ctrl-C and SIGTERM save the agent after the current
    rollout and raise KeyboardInterrupt. Raises ValueError for invalid arguments, TrainingRunError for an unusable `out`
    or a loss that is not finite, CorpusError for unusable data.
    """

    saves_agent_early = reports_every_step = True

    def __init__(
        self,
        settings: EnvConfig,
        recipe: PPORecipe,
        out: Path,
        *,
        steps: int,
        recipe_name: str = "ours",
        weights: Path | None = None,
        evaluate_every: int | None = None,
        **session: Unpack[Session],
    ) -> None:
        super().__init__(out, Budget("steps", steps), session)
        self.counters: PPOCounters = PPOCounters()
        self._settings = settings
        self.recipe = recipe
        self._recipe_name = recipe_name
        self.tasks = training_tasks(settings, recipe, matching=recipe.nlvr_reward)
        if recipe.patience and not recipe.held_out:
            raise ValueError("patience needs held-out statements to validate on: raise held_out, or set patience to 0")
        appearance = make_appearance(settings.appearance, settings.grid)
        torch.manual_seed(recipe.seed)
        self.model = make_model(recipe, appearance, statements=self.tasks.statements, weights=weights)
        identity = {
            "learner": PPOAgent.kind,
            "environment": settings.to_json(),
            "recipe_name": recipe_name,
            "recipe": recipe.to_json(),
            "tasks_sha256": self.tasks.sha256,
            "weights": None if weights is None else str(weights),
            "weights_sha256": None if weights is None else weights_digest(weights),
        }
        self.begin(identity, evaluate_every=evaluate_every)
        self.model.to(self.device)
        self._optimiser = make_optimiser(self.model, recipe)
        self._rng = np.random.default_rng(recipe.seed)
        self._collector = RolloutCollector(settings, recipe, self.tasks)
        self.validation = Validation(settings, recipe, self.tasks.validation, self.files)
        self.curve = None
        if evaluate_every:
            from lilgym_mp.learning.ppo.learning_curve import LearningCurve

            self.curve = LearningCurve(settings, recipe, evaluate_every, self.files)
        self.parts = {"network": self.model, "optimiser": self._optimiser}
        if not self.load():
            self._collector.reset(self._rng)

    @property
    def configurations(self) -> Strings:
        """The configurations the agent plays: with empty starts, its appearance's Scratch too."""
        scratch = configuration_name(self._settings.appearance, SCRATCH)
        return (self._settings.configuration, *([scratch] if self.tasks.from_empty.any() else []))

    def introduction(self) -> str:
        recipe = self.recipe
        model = self.model
        steps = self.counters.steps
        resumed = f", resumed after {steps:,}" if steps else ""
        frozen = f" and {model.frozen_parameters:,} frozen" if model.frozen_parameters else ""
        return (
            f"{self.configurations[0]}, corpus {self._settings.corpus}, {len(self.tasks.tasks):,} training tasks,"
            f" {len(self.tasks.validation):,} for validation; {self.budget.amount:,} steps{resumed}\n"
            f"model {recipe.model}: {model.trained_parameters:,} trained parameters{frozen};"
            f" {'PPO+SF' if recipe.stop_forcing else 'PPO'}, {'a' if recipe.mask else 'no'} mask of legal actions,"
            f" seed {recipe.seed}\n"
            f"run directory: {self.out}"
        )

    def learn(self) -> None:
        self.optimise()
        if not self.stop.requested:
            self.validation.validate(self.model, self.counters.steps)
            self.save()

    def is_over(self) -> bool:
        """Also once the validation is out of patience."""
        return super().is_over() or self.validation.is_out_of_patience

    def step(self) -> PPOProgress:
        """Collects a rollout and optimises on it."""
        counters = self.counters
        if self.curve is not None and self.curve.is_due(counters.steps):
            self.curve.add_point(self.model, counters.steps)
        start_seconds = self.seconds()
        entropy_coefficient = schedule(self._optimiser, self.recipe, self.progress())
        self.model.eval()
        with self._precision():
            rollout = self._collector.collect(self.model, self._rng)
        self.model.train()
        self.model.clear_cache()
        losses = update(self._experience(rollout), self._optimiser, self.recipe, entropy_coefficient, self._rng)
        counters.steps += self.recipe.rollout
        counters.updates += len(losses)
        progress = self._progress(mean_losses(losses), start_seconds)
        if self.validation.is_due(counters.steps):
            self.validation.validate(self.model, counters.steps)
        return progress

    def _experience(self, rollout: Rollout) -> Experience:
        recipe = self.recipe
        legal = rollout.legal
        advantages = generalised_advantages(
            rollout.rewards, rollout.values, rollout.ended, rollout.last_values, recipe.gamma, recipe.gae_lambda
        )

        def evaluate(rows: Int64Array) -> tuple[FactoredPolicy, Tensor]:
            mask = None if legal is None else legal.reshape(-1, legal.shape[-1])[rows]
            with self._precision():
                return policy_and_values(self.model, rollout.states(rows), mask)

        return Experience(recipe, rollout._asdict(), advantages, rollout.statement_of, evaluate, self.device)

    def _precision(self) -> Any:
        is_worth_it = self.device.type == "cuda" or self.recipe.model in TRANSFORMERS
        return precision(self.device, reduced=self.recipe.reduced_precision and is_worth_it)

    def _progress(self, mean: Losses, start_seconds: float) -> PPOProgress:
        statistics = self._collector.statistics
        self._collector.statistics = EpisodeStatistics()
        count = statistics.ends.total()
        counters = self.counters
        counters.episodes += count
        seconds = self.seconds()
        return PPOProgress(
            steps=counters.steps,
            episodes=counters.episodes,
            cpu_seconds=round(seconds, 3),
            steps_per_second=round(self.recipe.rollout / max(1e-9, seconds - start_seconds), 1),
            accuracy=statistics.ends["success"] / count if count else None,
            mean_reward=statistics.reward / count if count else None,
            mean_length=statistics.steps / count if count else None,
            outcomes={end: statistics.ends[end] / count for end in FINAL_OUTCOMES} if count else {},
            forced=statistics.forced / self.recipe.rollout,
            policy_loss=round(float(mean.policy), 5),
            value_loss=round(float(mean.value), 5),
            entropy=round(float(mean.entropy), 5),
            clipped=round(float(mean.clipped), 5),
        )

    def state(self) -> AnyDict:
        return {
            **super().state(),
            "best": self.validation.best_weights,
            "validation": asdict(self.validation.state),
            "evaluated": None if self.curve is None else self.curve.last,
            "episodes": self._collector.to_json(),
            "random": json.dumps(self._rng.bit_generator.state),
        }

    def restore(self, state: AnyDict) -> None:
        super().restore(state)
        self.validation.state = ValidationState(**state["validation"])
        self.validation.best_weights = state["best"]
        if self.curve is not None:
            self.curve.last = state["evaluated"]
        self._rng.bit_generator.state = json.loads(state["random"])
        self._collector.restore_episodes(state["episodes"])

    def finish(self) -> PPOAgent:
        """Saves the agent: with the best validated weights, or the current ones without validation."""
        if self.curve is not None and not self.stop.requested:
            self.curve.add_point(self.model, self.counters.steps)
        counters = self.counters
        validated = self.validation.state
        best_weights = self.validation.best_weights
        if best_weights is not None:
            self.model.load_state_dict(best_weights)
            accuracy = f"{100 * (validated.best or 0):.1f} %"
            self.say(f"best checkpoint: after {validated.best_steps:,} steps, with a validation accuracy of {accuracy}")
        statistics = {
            "steps": counters.steps,
            "episodes": counters.episodes,
            "cpu_minutes": self.minutes(),
            "seed": self.recipe.seed,
            "trained_parameters": self.model.trained_parameters,
            "frozen_parameters": self.model.frozen_parameters,
            "validation_accuracy": validated.best,
            "validation_steps": validated.best_steps if best_weights is not None else None,
            "interrupted": self.stop.requested,
        }
        description = describe(
            self._settings, self.recipe, self._recipe_name, self.configurations, self.model, statistics
        )
        self._collector.close()
        return PPOAgent(description, self._settings, self.model.eval())


train_ppo = training(PPORun)
