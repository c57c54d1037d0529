"""PPO training: rollouts, updates, checkpoints, validation and evaluation. Start reading at `train_ppo`."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from lilgym_mp.appearances import make_appearance
from lilgym_mp.arrays import BoolArray, Int64Array
from lilgym_mp.corpus.records import SCRATCH
from lilgym_mp.envs.registration import START_TITLES
from lilgym_mp.evaluation import Settings, evaluate
from lilgym_mp.evaluation.metrics import FINAL_OUTCOMES
from lilgym_mp.learning.dev_evaluation import DevEvaluator, TrainingClock, last_steps
from lilgym_mp.learning.devices import DeviceError, select_device
from lilgym_mp.learning.interrupts import StopRequest, stop_on_signals
from lilgym_mp.learning.ppo.agent import KIND, ModelPolicy, PPOAgent, describe
from lilgym_mp.learning.ppo.models.factory import make_model
from lilgym_mp.learning.ppo.models.protocol import Model
from lilgym_mp.learning.ppo.models.weights import weights_digest
from lilgym_mp.learning.ppo.objective import (
    ActionEvaluation,
    Losses,
    RolloutBatch,
    generalised_advantages,
    losses,
    scale_advantages,
)
from lilgym_mp.learning.ppo.recipe import REPORTED_PARAMETERS, PPORecipe
from lilgym_mp.learning.ppo.rollout import EpisodeStatistics, Rollout, RolloutCollector, policy_and_values
from lilgym_mp.learning.ppo.tasks import TRAINING_SPLIT, TrainingTasks, plays_empty_starts, training_tasks
from lilgym_mp.learning.training_run import TrainingError, TrainingRun, TrainingRunError, begin_run

EVALUATIONS_FILE = "evaluations.jsonl"
VALIDATIONS_FILE = "validations.jsonl"


class Progress(NamedTuple):
    """A line of progress.jsonl: statistics of one rollout and its updates."""

    steps: int  # so far, like the next three fields
    episodes: int
    seconds: float  # training time
    cpu_seconds: float  # CPU time of this process, including evaluations
    steps_per_second: float
    accuracy: float | None  # accuracy of the episodes that ended, also by stop forcing; None without any
    mean_reward: float | None
    mean_length: float | None
    outcomes: dict[str, float]  # fractions of those episodes
    forced: float  # fraction of states with a forced STOP
    policy_loss: float
    value_loss: float
    entropy: float
    clipped: float  # fraction of probability ratios outside the clip range


@dataclass
class _TrainingState:
    """The counters in a checkpoint; field names are part of its format."""

    steps: int = 0
    updates: int = 0  # optimiser steps
    episodes: int = 0
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    validated_at: int = 0
    best: float | None = None  # validation accuracy
    best_steps: int = 0
    without_better: int = 0  # validations since the best one


def train_ppo(
    settings: Settings,
    recipe: PPORecipe,
    out: Path,
    *,
    steps: int,
    recipe_name: str = "ours",
    weights: Path | None = None,
    device: str = "auto",
    resume: bool = False,
    save_every: int = 100_000,
    evaluate_every: int | None = None,
    threads: int = 1,
    on_progress: Callable[[Progress], object] = lambda progress: None,
    on_begin: Callable[[Run], object] = lambda run: None,
) -> PPOAgent:
    """Trains for `steps` environment steps in total, rounded up to whole rollouts; saves and returns the agent.

    `out`: an empty or new directory, or with `resume` that of the run to continue, which must have the same settings,
    recipe and weights. With `evaluate_every` the agent is evaluated on dev (`DevEvaluation`) at the start, at intervals
    of that many steps, and at the end, without affecting training. Ctrl-C and SIGTERM save and stop after the current
    rollout, a second one immediately. With equal seed and threads an interrupted and resumed run trains the same agent
    as an uninterrupted one. Raises ValueError for invalid arguments, TrainingRunError for an unusable `out`,
    TrainingError when the loss is not finite, CorpusError for unusable data.
    """
    with _threads(threads), stop_on_signals() as stop:
        run = Run(settings, recipe, out, recipe_name, weights, device, resume=resume)
        if run.steps >= steps:
            raise TrainingRunError(f"the run in {out} already has {run.steps:,} steps; request more with --steps")
        evaluator = DevEvaluator(settings, recipe.seed) if evaluate_every else None
        on_begin(run)
        saved = run.steps
        while run.steps < steps and not stop.requested and not run.is_out_of_patience:
            if evaluator is not None and run.is_evaluation_due(evaluate_every or 0):
                run.evaluate_on_dev(evaluator)
            on_progress(run.update(done=run.steps / steps))
            if run.is_validation_due:
                run.validate()
            if run.steps - saved >= save_every:
                run.save()
                saved = run.steps
        if not stop.requested:
            run.validate()
        run.save()
        if evaluator is not None and not stop.requested:
            run.evaluate_on_dev(evaluator)
        return run.finish(stop)


class Run:
    """A run in memory."""

    def __init__(
        self,
        settings: Settings,
        recipe: PPORecipe,
        out: Path,
        recipe_name: str,
        weights: Path | None,
        device: str,
        *,
        resume: bool,
    ) -> None:
        self._settings, self.recipe, self._recipe_name = settings, recipe, recipe_name
        self._device = select_device(device)
        self.tasks = training_tasks(settings, recipe)
        appearance = make_appearance(settings.appearance, settings.grid)
        settings.make(TRAINING_SPLIT)
        torch.manual_seed(recipe.seed)
        self.model = make_model(recipe, appearance, statements=self.tasks.statements, weights=weights)
        self.files = begin_run(out, _identity(settings, recipe, recipe_name, self.tasks, weights), resume=resume)
        _to(self.model, self._device)
        self._optimiser = _optimiser(self.model, recipe)
        self._rng = np.random.default_rng(recipe.seed)
        self._state = _TrainingState()
        self._collector = RolloutCollector(settings, recipe, self.tasks)
        self._best_weights: dict[str, Tensor] | None = None
        if resume and self.files.has_checkpoint:
            self._load()
        else:
            self._collector.reset(self._rng)
        self._clock = TrainingClock(self._state.seconds)
        self._cpu_before = self._state.cpu_seconds - _cpu_seconds()

    @property
    def steps(self) -> int:
        return self._state.steps

    @property
    def configurations(self) -> tuple[str, ...]:
        """The configurations the agent plays: with empty starts, its appearance's Scratch too."""
        own = self._settings.configuration
        if not plays_empty_starts(self.tasks):
            return (own,)
        return own, f"{self._settings.appearance.capitalize()}{START_TITLES[SCRATCH]}"

    def reported_parameters(self) -> str:
        """The parameter count reported for this model by the paper or release, in parentheses; empty without one."""
        count = REPORTED_PARAMETERS.get(self.recipe.model)
        return "" if count is None else f" ({count})"

    # Optimisation

    def update(self, done: float) -> Progress:
        """Collects a rollout and optimises on it. `done`: training progress, 0 to 1."""
        recipe, start_seconds = self.recipe, self._clock.seconds
        self._set_learning_rate(done)
        entropy = recipe.entropy + (recipe.final_entropy - recipe.entropy) * min(1.0, done)
        self.model.eval()
        with self._precision():
            rollout = self._collector.collect(self.model, self._rng)
        tensors = _RolloutTensors.of(rollout, recipe, self._device)
        self.model.train()
        self.model.clear_cache()
        step_losses: list[Losses] = []
        for _ in range(recipe.epochs):
            for rows in tensors.mini_batches(recipe, self._rng):
                step_losses.append(self._step(tensors, rows, entropy))
        self._state.steps += recipe.rollout
        return self._report(step_losses, start_seconds)

    def _step(self, tensors: _RolloutTensors, rows: Int64Array, entropy: float) -> Losses:
        """One optimiser step, accumulating the gradient over micro-batches."""
        recipe = self.recipe
        self._optimiser.zero_grad()
        size = recipe.microbatch or len(rows)
        parts: list[Losses] = []
        for first in range(0, len(rows), size):
            some = rows[first : first + size]
            with self._precision():
                policy, values = policy_and_values(self.model, tensors.rollout.states(some), tensors.legal(some))
            current = ActionEvaluation(*policy.evaluate_actions(tensors.actions[some]), values)
            loss = losses(recipe, current, tensors.batch(some), entropy)
            if not torch.isfinite(loss.total):
                raise TrainingError(
                    f"the loss is not finite after {self.steps:,} steps (policy {loss.policy.item():g}, value"
                    f" {loss.value.item():g}); the last good checkpoint is kept in {self.files.path};"
                    " try a lower learning-rate"
                )
            (loss.total * (len(some) / len(rows))).backward()
            parts.append(loss._replace(total=loss.total.detach()))
        nn.utils.clip_grad_norm_(self.model.parameters(), recipe.gradient_norm)
        self._optimiser.step()
        self._state.updates += 1
        return Losses(*(torch.stack(values).mean() for values in zip(*parts, strict=True)))

    def _set_learning_rate(self, done: float) -> None:
        recipe = self.recipe
        left = 1 - min(1.0, done)
        decay = {"constant": 1.0, "linear": left, "cosine": 0.5 * (1 - math.cos(math.pi * left))}[recipe.schedule]
        warm_up = 1.0
        if recipe.warmup:  # above 0 in the first rollout
            warm_up = min(1.0, (done or recipe.warmup / 10) / recipe.warmup)
        for group in self._optimiser.param_groups:
            group["lr"] = recipe.learning_rate * decay * warm_up

    def _precision(self) -> Any:
        if self.recipe.reduced_precision and self._device.type == "cuda":
            return torch.autocast("cuda", torch.bfloat16)
        return nullcontext()

    def _report(self, step_losses: list[Losses], start_seconds: float) -> Progress:
        statistics, self._collector.statistics = self._collector.statistics, EpisodeStatistics()
        count, state = statistics.ends.total(), self._state
        state.episodes += count
        state.seconds = self._clock.seconds
        state.cpu_seconds = self._cpu_before + _cpu_seconds()
        mean = Losses(*(torch.stack(values).mean() for values in zip(*step_losses, strict=True)))
        progress = Progress(
            steps=state.steps,
            episodes=state.episodes,
            seconds=round(state.seconds, 3),
            cpu_seconds=round(state.cpu_seconds, 3),
            steps_per_second=round(self.recipe.rollout / max(1e-9, state.seconds - start_seconds), 1),
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
        self.files.record(progress._asdict())
        return progress

    # Validation and evaluation

    @property
    def is_validation_due(self) -> bool:
        return bool(self.tasks.validation) and self.steps - self._state.validated_at >= self.recipe.validate_every

    @property
    def is_out_of_patience(self) -> bool:
        return 0 < self.recipe.patience <= self._state.without_better

    def validate(self) -> None:
        """Plays the held-out tasks, unless done at this step already, and keeps the best weights."""
        state = self._state
        if not self.tasks.validation or (state.best is not None and state.validated_at == state.steps):
            return
        with self._clock.paused():
            episodes = evaluate(
                self._policy(sampled=self.recipe.sampled),
                self._settings,
                TRAINING_SPLIT,
                seed=self.recipe.seed,
                task_ids=self.tasks.validation,
            )
        self.model.clear_cache()
        accuracy = sum(episode.is_success for episode in episodes) / len(episodes)
        state.validated_at = state.steps
        state.without_better += 1
        if state.best is None or accuracy > state.best:
            state.best, state.best_steps, state.without_better = accuracy, state.steps, 0
            self._best_weights = _copy_weights(self.model)
        line = {
            "steps": state.steps,
            "tasks": len(episodes),
            "accuracy": accuracy,
            "best_steps": state.best_steps,
        }
        with (self.files.path / VALIDATIONS_FILE).open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")

    def is_evaluation_due(self, every: int) -> bool:
        last = last_steps(self.files.path / EVALUATIONS_FILE)
        return last is None or self.steps - last >= every

    def evaluate_on_dev(self, evaluator: DevEvaluator) -> None:
        """Appends a point to the learning curve, unless it has one at this step already."""
        file = self.files.path / EVALUATIONS_FILE
        last = last_steps(file)
        if last is not None and self.steps <= last:
            return
        with self._clock.paused():
            point = evaluator(self._policy(sampled=True), self.steps, self._clock.seconds)
        self.model.clear_cache()  # cached values differ by rounding; training must not depend on evaluations
        with file.open("a", encoding="utf-8") as lines:
            lines.write(json.dumps(point._asdict()) + "\n")

    def _policy(self, *, sampled: bool) -> ModelPolicy:
        self.model.eval()
        return ModelPolicy(self.model, mask=self.recipe.mask, sampled=sampled)

    # Files

    def save(self) -> None:
        """Saves a checkpoint."""
        self._state.seconds = self._clock.seconds
        self._state.cpu_seconds = self._cpu_before + _cpu_seconds()
        self.files.save_checkpoint(
            {
                "network": self.model.state_dict(),
                "best": self._best_weights,
                "optimiser": self._optimiser.state_dict(),
                "standing": asdict(self._state),
                "episodes": self._collector.to_json(),
                "random": json.dumps(self._rng.bit_generator.state),
            }
        )

    def _load(self) -> None:
        state = self.files.load_checkpoint(self._device)
        try:
            non_finite = [name for name, tensor in state["network"].items() if not torch.isfinite(tensor).all()]
            if non_finite:
                raise ValueError(f"{non_finite[0]} holds non-finite values")
            self.model.load_state_dict(state["network"])
            self._optimiser.load_state_dict(state["optimiser"])
            self._state = _TrainingState(**state["standing"])
            self._best_weights = state["best"]
            self._rng.bit_generator.state = json.loads(state["random"])
            self._collector.restore_episodes(state["episodes"])
        except (KeyError, RuntimeError, ValueError, TypeError, AttributeError, IndexError) as error:
            reason = (str(error).strip() or type(error).__name__).splitlines()[0]
            raise TrainingRunError(f"the checkpoint in {self.files.path} is not of this run: {reason}") from None

    def finish(self, stop: StopRequest) -> PPOAgent:
        """Saves the agent: with the best validated weights, or the current ones without validation."""
        state = self._state
        if self._best_weights is not None:
            self.model.load_state_dict(self._best_weights)
        statistics = {
            "steps": state.steps,
            "episodes": state.episodes,
            "seconds": round(state.seconds, 1),
            "cpu_minutes": round(state.cpu_seconds / 60, 2),
            "seed": self.recipe.seed,
            "trained_parameters": self.model.trained_parameters,
            "frozen_parameters": self.model.frozen_parameters,
            "validation_accuracy": state.best,
            "validation_steps": state.best_steps if self._best_weights is not None else None,
            "interrupted": stop.requested,
        }
        description = describe(
            self._settings, self.recipe, self._recipe_name, self.configurations, self.model, statistics
        )
        self.files.save_agent(description, self.model.state_dict())
        self._collector.close()
        return PPOAgent(description, self._settings, self.model.eval(), self.recipe.mask)


@dataclass(frozen=True)
class _RolloutTensors:
    """A rollout as flat tensors with advantages and returns."""

    rollout: Rollout
    actions: Tensor  # (T * N,)
    columns: RolloutBatch  # all T * N transitions
    device: torch.device = field(repr=False)

    @classmethod
    def of(cls, rollout: Rollout, recipe: PPORecipe, device: torch.device) -> _RolloutTensors:
        advantages = generalised_advantages(
            rollout.rewards, rollout.values, rollout.ended, rollout.last_values, recipe.gamma, recipe.gae_lambda
        )
        returns = advantages + rollout.values
        if not recipe.forced_baseline:
            advantages = np.where(rollout.forced, returns, advantages)
        arrays = (
            rollout.log_probabilities,
            rollout.values,
            scale_advantages(advantages, recipe.advantages).astype(np.float32),
            returns,
            rollout.forced,
        )
        columns = (torch.from_numpy(np.ascontiguousarray(array).reshape(-1)).to(device) for array in arrays)
        actions = torch.from_numpy(rollout.actions.reshape(-1)).to(device)
        return cls(rollout, actions, RolloutBatch(*columns), device)

    def batch(self, rows: Int64Array) -> RolloutBatch:
        chosen = torch.from_numpy(rows).to(self.device)
        return RolloutBatch(*(column[chosen] for column in self.columns))

    def legal(self, rows: Int64Array) -> BoolArray | None:
        legal = self.rollout.legal
        return None if legal is None else legal.reshape(-1, legal.shape[-1])[rows]

    def mini_batches(self, recipe: PPORecipe, rng: np.random.Generator) -> Iterator[Int64Array]:
        """All rows in shuffled mini-batches; with grouped environments each has few distinct statements, for speed."""
        count = len(self.actions)
        order = rng.permutation(count)
        if recipe.same_statement > 1:
            statements = self.rollout.statement_of.reshape(-1)
            ranks = rng.permutation(int(statements.max()) + 1)
            order = order[np.argsort(ranks[statements[order]], kind="stable")]
        starts = list(range(0, count, recipe.batch_size))
        for start in rng.permutation(len(starts)).tolist() if recipe.same_statement > 1 else range(len(starts)):
            yield order[starts[start] : starts[start] + recipe.batch_size]


def _identity(
    settings: Settings, recipe: PPORecipe, recipe_name: str, tasks: TrainingTasks, weights: Path | None
) -> Mapping[str, Any]:
    return {
        "learner": KIND,
        "environment": settings.to_json(),
        "recipe_name": recipe_name,
        "recipe": recipe.to_json(),
        "tasks_sha256": tasks.sha256,
        "weights": None if weights is None else str(weights),
        "weights_sha256": None if weights is None else weights_digest(weights),
    }


def saved_arguments(out: Path, required: Mapping[str, Any]) -> dict[str, Any]:
    """Settings, recipe, recipe name and weights of the run in a directory, as arguments of `train_ppo`.

    `required`: values the run's identity must have. Raises TrainingRunError naming both values otherwise.
    """
    run: TrainingRun = begin_run(out, required, resume=True)
    identity = run.identity
    try:
        if identity["learner"] != KIND:
            raise ValueError(f"a run of {identity['learner']}, not of {KIND}")
        weights = identity["weights"]
        return {
            "settings": Settings.from_json(identity["environment"]),
            "recipe": PPORecipe.from_json(identity["recipe"]),
            "recipe_name": str(identity["recipe_name"]),
            "weights": None if weights is None else Path(weights),
        }
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise TrainingRunError(f"{out / 'run.json'}: cannot be used: {error}") from None


def _optimiser(model: Model, recipe: PPORecipe) -> torch.optim.Optimizer:
    trained = [parameter for parameter in model.parameters() if parameter.requires_grad]
    betas = (0.9, recipe.beta2)
    if recipe.optimiser == "adamw":
        return torch.optim.AdamW(trained, recipe.learning_rate, betas, recipe.epsilon, recipe.weight_decay, fused=True)
    return torch.optim.Adam(trained, recipe.learning_rate, betas, recipe.epsilon, fused=True)


def _to(model: Model, device: torch.device) -> None:
    """Moves the model. Raises DeviceError with the memory needed if it does not fit."""
    if device.type == "cuda":
        weight, moments = 4, 8  # bytes of a parameter and its gradient, and of Adam's two moments
        needed = model.trained_parameters * (2 * weight + moments) + model.frozen_parameters * weight
        free, _ = torch.cuda.mem_get_info(device)
        if needed > free:
            raise DeviceError(
                f"the model needs {needed / 2**30:.1f} GiB on {device} for weights, gradients and optimiser alone,"
                f" but {free / 2**30:.1f} GiB are free; choose a smaller model or another device"
            )
    model.to(device)


def _copy_weights(model: Model) -> dict[str, Tensor]:
    return {name: tensor.detach().clone() for name, tensor in model.state_dict().items()}


def _cpu_seconds() -> float:
    times = os.times()
    return times.user + times.system


@contextmanager
def _threads(count: int) -> Generator[None, None, None]:
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


__all__ = ["Progress", "Run", "saved_arguments", "train_ppo"]
