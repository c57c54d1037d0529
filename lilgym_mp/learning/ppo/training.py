"""A run of PPO: play, learn, and now and then save, validate and evaluate. `train_ppo` is read from top to bottom."""

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
from lilgym_mp.arrays import Int64Array
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
    """What happened in a rollout and in learning from it."""

    steps: int  # of the whole run
    episodes: int  # of the whole run
    seconds: float  # of training, of the whole run
    cpu_seconds: float  # of this process, of the whole run, evaluations included
    steps_per_second: float
    accuracy: float | None  # of the episodes that ended, those ended by stop forcing included; None if there were none
    mean_reward: float | None
    mean_length: float | None
    outcomes: dict[str, float]  # shares of those episodes
    forced: float  # share of the states in which STOP was forced
    policy_loss: float
    value_loss: float
    entropy: float
    clipped: float  # share of the probability ratios outside of the clip


@dataclass
class _Standing:
    """Where a run is: what a checkpoint holds beside networks, optimiser, episodes and random numbers."""

    steps: int = 0
    updates: int = 0  # of the optimiser
    episodes: int = 0
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    validated_at: int = 0
    best: float | None = None  # validation accuracy
    best_steps: int = 0
    without_better: int = 0  # validations since


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
    """Trains for `steps` actions in all, rounded up to whole rollouts; writes the agent into `out` and gives it.

    `out`: an empty or new directory, or with `resume` that of the run to go on with, which must have the settings,
    recipe and weights given. With `evaluate_every` dev is played at the beginning, after so many steps again and
    again, and at the end (`DevEvaluation`); what is learnt stays the same. Ctrl-C and SIGTERM end it saved, after the
    rollout under way; a second one at once. A run with the same seed and threads that was interrupted and resumed
    learns the same as one that was not. Raises ValueError for what cannot be, TrainingRunError for an `out` that
    cannot serve, TrainingError when the loss is no number, CorpusError for unusable data.
    """
    with _threads(threads), stop_on_signals() as stop:
        run = Run(settings, recipe, out, recipe_name, weights, device, resume=resume)
        if run.steps >= steps:
            raise TrainingRunError(f"the run in {out} has {run.steps:,} steps already; ask for more with --steps")
        evaluator = DevEvaluator(settings, recipe.seed) if evaluate_every else None
        on_begin(run)
        saved = run.steps
        while run.steps < steps and not stop.requested and not run.has_lost_patience:
            if evaluator is not None and run.is_evaluation_due(evaluate_every or 0):
                run.evaluate_on_dev(evaluator)
            on_progress(run.learn(share_done=run.steps / steps))
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
    """The parts of a run, and what is done with them."""

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
        self._standing = _Standing()
        self._player = RolloutCollector(settings, recipe, self.tasks)
        self._best: dict[str, Tensor] | None = None
        if resume and self.files.has_checkpoint:
            self._load()
        else:
            self._player.begin(self._rng)
        self._clock = TrainingClock(self._standing.seconds)
        self._cpu_before = self._standing.cpu_seconds - _cpu_seconds()

    @property
    def steps(self) -> int:
        return self._standing.steps

    @property
    def configurations(self) -> tuple[str, ...]:
        """What the agent plays: with episodes from the empty scene, its appearance's Scratch too."""
        own = self._settings.configuration
        if not plays_empty_starts(self.tasks):
            return (own,)
        return own, f"{self._settings.appearance.capitalize()}{START_TITLES[SCRATCH]}"

    def reported_parameters(self) -> str:
        """The paper's count of parameters beside this model's, where there is one."""
        count = REPORTED_PARAMETERS.get(self.recipe.model)
        return "" if count is None else f" ({count})"

    # Learning

    def learn(self, share_done: float) -> Progress:
        """Plays a rollout and learns from it."""
        recipe, began = self.recipe, self._clock.seconds
        self._set_learning_rate(share_done)
        entropy = recipe.entropy + (recipe.final_entropy - recipe.entropy) * min(1.0, share_done)
        self.model.eval()
        with self._precision():
            rollout = self._player.play(self.model, self._rng)
        learning = _RolloutTensors.of(rollout, recipe, self._device)
        self.model.train()
        self.model.clear_cache()
        found: list[Losses] = []
        for _ in range(recipe.epochs):
            for rows in learning.batches(recipe, self._rng):
                found.append(self._step(learning, rows, entropy))
        self._standing.steps += recipe.rollout
        return self._report(found, began)

    def _step(self, learning: _RolloutTensors, rows: Int64Array, entropy: float) -> Losses:
        """One step of the optimiser, its gradient summed over parts that fit into memory."""
        recipe = self.recipe
        self._optimiser.zero_grad()
        size = recipe.microbatch or len(rows)
        parts: list[Losses] = []
        for first in range(0, len(rows), size):
            some = rows[first : first + size]
            with self._precision():
                policy, values = policy_and_values(self.model, learning.rollout.states(some), learning.legal(some))
            actions = learning.actions[some]
            learnt = ActionEvaluation(*policy.evaluate_actions(actions), values)
            loss = losses(recipe, learnt, learning.experience(some), entropy)
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
        self._standing.updates += 1
        return Losses(*(torch.stack(values).mean() for values in zip(*parts, strict=True)))

    def _set_learning_rate(self, share_done: float) -> None:
        recipe = self.recipe
        left = 1 - min(1.0, share_done)
        falling = {"constant": 1.0, "linear": left, "cosine": 0.5 * (1 - math.cos(math.pi * left))}[recipe.schedule]
        rising = 1.0
        if recipe.warmup:  # the first rollout learns too
            rising = min(1.0, (share_done or recipe.warmup / 10) / recipe.warmup)
        for group in self._optimiser.param_groups:
            group["lr"] = recipe.learning_rate * falling * rising

    def _precision(self) -> Any:
        if self.recipe.reduced_precision and self._device.type == "cuda":
            return torch.autocast("cuda", torch.bfloat16)
        return nullcontext()

    def _report(self, found: list[Losses], began: float) -> Progress:
        statistics, self._player.statistics = self._player.statistics, EpisodeStatistics()
        count, standing = statistics.ends.total(), self._standing
        standing.episodes += count
        standing.seconds = self._clock.seconds
        standing.cpu_seconds = self._cpu_before + _cpu_seconds()
        mean = Losses(*(torch.stack(values).mean() for values in zip(*found, strict=True)))
        progress = Progress(
            steps=standing.steps,
            episodes=standing.episodes,
            seconds=round(standing.seconds, 3),
            cpu_seconds=round(standing.cpu_seconds, 3),
            steps_per_second=round(self.recipe.rollout / max(1e-9, standing.seconds - began), 1),
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
        return bool(self.tasks.validation) and self.steps - self._standing.validated_at >= self.recipe.validate_every

    @property
    def has_lost_patience(self) -> bool:
        return 0 < self.recipe.patience <= self._standing.without_better

    def validate(self) -> None:
        """Plays the tasks held out, unless that was done at this step; the best weights so far are kept."""
        standing = self._standing
        if not self.tasks.validation or (standing.best is not None and standing.validated_at == standing.steps):
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
        standing.validated_at = standing.steps
        standing.without_better += 1
        if standing.best is None or accuracy > standing.best:
            standing.best, standing.best_steps, standing.without_better = accuracy, standing.steps, 0
            self._best = _copied(self.model)
        told = {
            "steps": standing.steps,
            "tasks": len(episodes),
            "accuracy": accuracy,
            "best_steps": standing.best_steps,
        }
        with (self.files.path / VALIDATIONS_FILE).open("a", encoding="utf-8") as file:
            file.write(json.dumps(told) + "\n")

    def is_evaluation_due(self, every: int) -> bool:
        last = last_steps(self.files.path / EVALUATIONS_FILE)
        return last is None or self.steps - last >= every

    def evaluate_on_dev(self, evaluator: DevEvaluator) -> None:
        """Adds a point to the learning curve, unless it has one of this number of steps."""
        file = self.files.path / EVALUATIONS_FILE
        last = last_steps(file)
        if last is not None and self.steps <= last:
            return
        with self._clock.paused():
            found = evaluator(self._policy(sampled=True), self.steps, self._clock.seconds)
        self.model.clear_cache()  # so that what is learnt does not depend on what was evaluated, rounding included
        with file.open("a", encoding="utf-8") as lines:
            lines.write(json.dumps(found._asdict()) + "\n")

    def _policy(self, *, sampled: bool) -> ModelPolicy:
        self.model.eval()
        return ModelPolicy(self.model, mask=self.recipe.mask, sampled=sampled)

    # Files

    def save(self) -> None:
        """Writes the checkpoint of this moment."""
        self._standing.seconds = self._clock.seconds
        self._standing.cpu_seconds = self._cpu_before + _cpu_seconds()
        self.files.save_checkpoint(
            {
                "network": self.model.state_dict(),
                "best": self._best,
                "optimiser": self._optimiser.state_dict(),
                "standing": asdict(self._standing),
                "episodes": self._player.to_json(),
                "random": json.dumps(self._rng.bit_generator.state),
            }
        )

    def _load(self) -> None:
        state = self.files.load_checkpoint(self._device)
        try:
            broken = [name for name, tensor in state["network"].items() if not torch.isfinite(tensor).all()]
            if broken:
                raise ValueError(f"{broken[0]} holds values that are not finite")
            self.model.load_state_dict(state["network"])
            self._optimiser.load_state_dict(state["optimiser"])
            self._standing = _Standing(**state["standing"])
            self._best = state["best"]
            self._rng.bit_generator.state = json.loads(state["random"])
            self._player.restore_episodes(state["episodes"])
        except (KeyError, RuntimeError, ValueError, TypeError, AttributeError, IndexError) as error:
            reason = (str(error).strip() or type(error).__name__).splitlines()[0]
            raise TrainingRunError(f"the checkpoint in {self.files.path} is not of this run: {reason}") from None

    def finish(self, stop: StopRequest) -> PPOAgent:
        """Writes the agent: the best of the validations, or as it is where there were none."""
        standing = self._standing
        if self._best is not None:
            self.model.load_state_dict(self._best)
        found = {
            "steps": standing.steps,
            "episodes": standing.episodes,
            "seconds": round(standing.seconds, 1),
            "cpu_minutes": round(standing.cpu_seconds / 60, 2),
            "seed": self.recipe.seed,
            "trained_parameters": self.model.trained_parameters,
            "frozen_parameters": self.model.frozen_parameters,
            "validation_accuracy": standing.best,
            "validation_steps": standing.best_steps if self._best is not None else None,
            "interrupted": stop.requested,
        }
        description = describe(self._settings, self.recipe, self._recipe_name, self.configurations, self.model, found)
        self.files.save_agent(description, self.model.state_dict())
        self._player.close()
        return PPOAgent(description, self._settings, self.model.eval(), self.recipe.mask)


@dataclass(frozen=True)
class _RolloutTensors:
    """A rollout as tensors, row by row."""

    rollout: Rollout
    actions: Tensor  # (rows,)
    parts: tuple[Tensor, ...]  # the fields of `RolloutBatch`
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
        parts = tuple(torch.from_numpy(np.ascontiguousarray(array).reshape(-1)).to(device) for array in arrays)
        return cls(rollout, torch.from_numpy(rollout.actions.reshape(-1)).to(device), parts, device)

    def experience(self, rows: Int64Array) -> RolloutBatch:
        chosen = torch.from_numpy(rows).to(self.device)
        return RolloutBatch(*(part[chosen] for part in self.parts))

    def legal(self, rows: Int64Array) -> Any:
        legal = self.rollout.legal
        return None if legal is None else legal.reshape(-1, legal.shape[-1])[rows]

    def batches(self, recipe: PPORecipe, rng: np.random.Generator) -> Iterator[Int64Array]:
        """All rows in mini-batches: of few statements each where environments share theirs, else at random."""
        count = len(self.actions)
        order = rng.permutation(count)
        if recipe.same_statement > 1:
            statements = self.rollout.statement_of.reshape(-1)
            places = rng.permutation(int(statements.max()) + 1)
            order = order[np.argsort(places[statements[order]], kind="stable")]
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


def saved_arguments(out: Path, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Settings, recipe, its name and the weights of the run in a directory, as `train_ppo` takes them.

    `asked`: what the run must have, as its identity has it. Raises TrainingRunError naming both values otherwise.
    """
    run: TrainingRun = begin_run(out, asked, resume=True)
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
    trained = [weight for weight in model.parameters() if weight.requires_grad]
    betas = (0.9, recipe.beta2)
    if recipe.optimiser == "adamw":
        return torch.optim.AdamW(trained, recipe.learning_rate, betas, recipe.epsilon, recipe.weight_decay, fused=True)
    return torch.optim.Adam(trained, recipe.learning_rate, betas, recipe.epsilon, fused=True)


def _to(model: Model, device: torch.device) -> None:
    """Moves the model. Raises DeviceError saying how much it needs where it does not fit."""
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


def _copied(model: Model) -> dict[str, Tensor]:
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
