"""Imitation of sets of optimal actions with dataset aggregation (DAgger): the algorithm without its files and budget.

Start reading at `Imitation`: `collect_first`, then `step`, with `collect_more` in between. The loss is `losses`: the
negative log-probability of the set of optimal first actions, with auxiliary losses.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812
from torch import Tensor, nn

from lilgym_mp.envs.rules import Dynamics
from lilgym_mp.evaluation.episodes import scenes
from lilgym_mp.learning.common.run_directory import NotFiniteError, TrainingError
from lilgym_mp.learning.common.words import StatementTokenizer
from lilgym_mp.learning.imitation.batches import Batch, BatchSampler
from lilgym_mp.learning.imitation.dataset import DataCollector, DatasetEntry
from lilgym_mp.learning.imitation.network import ImitationNetwork, Outputs
from lilgym_mp.learning.imitation.policy import NetworkPolicy, StopRule, play_episodes, precision
from lilgym_mp.learning.imitation.recipe import ImitationRecipe
from lilgym_mp.scene import Scene

ENTRIES_PER_COLLECTION = 32
ON_POLICY_AFTER = 0.2  # fraction of the budget after which the network's own states are collected
LAST_SCENES = 3  # of each of the network's episodes that are labelled
MIN_PROBABILITY = 1e-13  # clamp; sets below it have no gradient
LOWEST_RATE = 0.02  # the last learning rate relative to the peak


class StepResult(NamedTuple):
    """Measurements of one optimiser step."""

    truth: float  # truth loss
    actions: float  # loss of the sets of optimal actions
    truth_accuracy: float
    states: int  # number of labelled states in the batch


class Imitation:
    """A network, and the dataset of labelled scenes that grows while it is trained."""

    def __init__(
        self,
        recipe: ImitationRecipe,
        network: ImitationNetwork,
        dynamics: Dynamics,
        tokenizer: StatementTokenizer,
        entries: Sequence[DatasetEntry],
        rng: np.random.Generator,
        collector: DataCollector,
        *,
        is_flipit: bool,
    ) -> None:
        """`entries`: the training statements. `is_flipit`: no start is solved, and any statement is judged on all."""
        self.recipe, self.network, self.dynamics, self.entries = recipe, network, dynamics, entries
        self.rng, self.collector, self._is_flipit = rng, collector, is_flipit
        starts = dict.fromkeys(start for entry in entries for start in entry.starts)
        self._other_scenes: Sequence[Scene] = [*starts] if is_flipit else []
        self.policy = NetworkPolicy(network, collector.table, collector.heads, tokenizer)
        self.policy.reduced_precision = recipe.reduced_precision
        self._batches = BatchSampler(collector.table, collector.heads, tokenizer, self.policy.device, recipe)
        self.optimiser = torch.optim.AdamW(
            network.parameters(), recipe.learning_rate, weight_decay=recipe.weight_decay, fused=True
        )

    def step(self, done: float) -> StepResult:
        """One optimiser step at a training progress `done`, 0 to 1. Raises NotFiniteError."""
        recipe, network = self.recipe, self.network
        solvable = [entry for entry in self.entries if entry.with_actions]
        entries = self._sample(solvable, recipe.statements)
        batch = self._batches.batch(entries, recipe.solved, recipe.truth_only, self.rng)
        for group in self.optimiser.param_groups:
            group["lr"] = recipe.learning_rate * learning_rate(recipe, done)
        network.train()
        with precision(self.policy.device, reduced=recipe.reduced_precision):
            outputs = network(batch.inputs, batch.targets)
        parts = losses(outputs, batch)
        loss = recipe.truth * parts.truth + parts.actions + recipe.steps * parts.steps + recipe.legal * parts.legal
        if not math.isfinite(loss.item()):
            raise NotFiniteError(", ".join(f"{name} {value.item():g}" for name, value in parts._asdict().items()))
        self.optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(network.parameters(), recipe.gradient_norm)
        self.optimiser.step()
        right = ((outputs.truth.detach() > 0) == (batch.truths > 0.5)).float().mean()
        return StepResult(
            float(parts.truth.detach()), float(parts.actions.detach()), float(right), batch.truths.numel()
        )

    def collect_first(self) -> None:
        """Labels scenes of every statement. Raises TrainingError if the expert solves none of them."""
        for entry in self.entries:
            if not entry.with_actions:
                self.collector.collect(entry, self.recipe.first_scenes, self.recipe.truth_only, self._other_scenes)
        if not any(entry.with_actions for entry in self.entries):
            raise TrainingError("nothing to imitate: the expert solves no scene of any training statement")

    def collect_more(self, done: float) -> None:
        """Labels scenes of some statements: along the expert's solutions, or of the network's own episodes."""
        entries = self._sample(self.entries, ENTRIES_PER_COLLECTION)
        if done > ON_POLICY_AFTER and self.rng.random() < self.recipe.own_states:
            self._collect_on_policy(entries)
        else:
            for entry in entries:
                self.collector.collect(entry, 1, 2, self._other_scenes)

    def _collect_on_policy(self, entries: Sequence[DatasetEntry]) -> None:
        """Labels the last scenes of the network's episodes, half of the time sampled ones (DAgger)."""
        tasks = [self.collector.task(entry) for entry in entries]
        rng = self.rng if self.rng.random() < 0.5 else None
        played = play_episodes(self.policy, self.dynamics, tasks, StopRule(never_first=self._is_flipit), rng)
        for entry, task, episode in zip(entries, tasks, played, strict=True):
            visited = scenes(self.dynamics, task.start, episode.actions)[:-1]  # before each action
            self.collector.add_last_scenes(entry, task, visited, LAST_SCENES)

    def _sample(self, entries: Sequence[DatasetEntry], count: int) -> list[DatasetEntry]:
        chosen = self.rng.choice(len(entries), count, replace=len(entries) < count)
        return [entries[index] for index in chosen]

    def state(self) -> dict[str, Any]:
        """For a checkpoint. The dataset is not part of it: a resumed run collects scenes anew."""
        return {"network": self.network.state_dict(), "optimiser": self.optimiser.state_dict()}

    def restore(self, state: Mapping[str, Any], rng: np.random.Generator) -> None:
        """Inverse of `state`; random numbers are drawn from `rng` from now on."""
        self.network.load_state_dict(state["network"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.rng = self.collector.rng = rng


class Losses(NamedTuple):
    """Means over the batch."""

    truth: Tensor  # binary cross-entropy of the statement's truth, which determines STOP
    actions: Tensor  # -log P(set | not STOP)
    steps: Tensor  # cross-entropy of the steps to go
    legal: Tensor  # binary cross-entropy of legal edits (Scatter)


def set_log_probabilities(outputs: Outputs, optimal: Tensor) -> Tensor:
    """(S, A) log P(set | not STOP) of the edits in the boolean mask `optimal` (S, A, logits)."""
    add_count = outputs.adds.shape[-1]
    types = outputs.types.log_softmax(-1)
    added = _log_masked_probability(outputs.adds, optimal[..., 1 : 1 + add_count])
    removed = _log_masked_probability(outputs.removes, optimal[..., 1 + add_count :])
    return torch.logaddexp(types[..., 0] + added, types[..., 1] + removed)


def _log_masked_probability(logits: Tensor, mask: Tensor) -> Tensor:
    """The log of the softmax probability inside the mask, clamped to MIN_PROBABILITY."""
    return (logits.softmax(-1) * mask).sum(-1).clamp(min=MIN_PROBABILITY).log()


def losses(outputs: Outputs, batch: Batch) -> Losses:
    truth = F.binary_cross_entropy_with_logits(outputs.truth, batch.truths)
    actions = -set_log_probabilities(outputs, batch.optimal).mean()
    steps = F.cross_entropy(outputs.steps.flatten(0, 1), batch.steps.flatten())
    legal = truth.new_zeros(())
    if outputs.legal is not None:
        each = F.binary_cross_entropy_with_logits(outputs.legal, batch.legal.float(), reduction="none")
        legal = each.mean((-1, -2))[batch.box_mask].mean()
    return Losses(truth, actions, steps, legal)


def learning_rate(recipe: ImitationRecipe, done: float) -> float:
    """The learning rate relative to its peak: linear warm-up, then cosine decay."""
    done = min(1.0, done)
    warm_up = min(1.0, (done + 1e-3) / recipe.warmup) if recipe.warmup else 1.0
    return warm_up * (LOWEST_RATE + (1 - LOWEST_RATE) * 0.5 * (1 + math.cos(math.pi * done)))
