"""Training by imitation: data collection, optimisation, checkpoints, and finally the stop rule."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import nn

from lilgym_mp.appearances import make_appearance
from lilgym_mp.corpus.faults import NoTasksError
from lilgym_mp.corpus.held_out import digests_sha256, held_out_digests
from lilgym_mp.envs.registration import configuration_name
from lilgym_mp.evaluation import Settings
from lilgym_mp.evaluation.settings import CONFIGURATIONS
from lilgym_mp.generator.training_pairs import training_pairs
from lilgym_mp.learning.devices import select_device
from lilgym_mp.learning.imitation.agent import KIND, Architecture, ImitationAgent, describe
from lilgym_mp.learning.imitation.batches import BatchSampler, StatementTokenizer, vocabulary_of
from lilgym_mp.learning.imitation.box_features import BoxFeatureTable
from lilgym_mp.learning.imitation.cached_policy import (
    CachedPolicy,
    StopRule,
    action_chooser,
    play_episodes,
    precision,
    tune_stop_rule,
)
from lilgym_mp.learning.imitation.dataset import (
    DataCollector,
    DatasetEntry,
    entries_from_tasks,
    split_held_out,
)
from lilgym_mp.learning.imitation.losses import Losses, losses
from lilgym_mp.learning.imitation.pretraining import GeometryPretraining, TextPretraining
from lilgym_mp.learning.imitation.recipe import ImitationRecipe
from lilgym_mp.learning.training_run import TrainingError, TrainingRunError, begin_run
from lilgym_mp.rules import make_dynamics
from lilgym_mp.task import Task

SAVE_SECONDS = 30.0  # CPU time between checkpoints
REPORT_SECONDS = 10.0
ENTRIES_PER_COLLECTION = 32
GEOMETRY_FRACTION = 0.2  # duration of geometry pretraining relative to text pretraining, in addition to it (Scatter)
ON_POLICY_AFTER = 0.2  # fraction of the budget after which the network's own states are collected
MAX_STOP_RULE_TASKS = 600
VOCABULARY_PAIRS = 2000  # generated statements whose words are in the vocabulary


class Progress(NamedTuple):
    """A line of progress.jsonl; losses are means since the last report."""

    steps: int  # optimiser steps
    states: int  # number of labelled states trained on so far
    cpu_seconds: float  # CPU time of this process and its children over the whole run
    exploring_seconds: float  # part of `cpu_seconds` spent on data collection
    sets: int  # expert queries since the run was started or resumed
    text: float | None  # loss of writing programs, during text pretraining only
    truth: float | None  # truth loss; None during pretraining, like the following
    actions: float | None  # loss of the sets of optimal actions
    truth_accuracy: float | None


@dataclass
class _TrainingState:
    """The counters in a checkpoint; field names are part of its format."""

    steps: int = 0
    states: int = 0
    cpu_seconds: float = 0.0
    exploring_seconds: float = 0.0
    begun_at: float = 0.0  # fraction of the budget spent when imitation began, after pretraining


def cpu_seconds() -> float:
    """CPU time of this process and its terminated children."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def train_imitation(
    settings: Settings,
    recipe: ImitationRecipe,
    out: Path,
    *,
    minutes: float | None = None,
    steps: int | None = None,
    seed: int = 0,
    device: str = "auto",
    resume: bool = False,
    on_progress: Callable[[Progress], object] = lambda progress: None,
) -> ImitationAgent:
    """Trains an agent, saves it as `out`/agent.safetensors and returns it.

    The budget is either `minutes` of CPU time, everything included, or `steps` of the optimiser; with `steps` equal
    arguments give equal agents. `resume` continues from the
    last checkpoint in `out`, which must have the same recipe and seed.
    Raises ValueError for an invalid budget or settings, TrainingRunError for an unusable `out`, TrainingError when the
    loss is not finite, CorpusError for unusable data. KeyboardInterrupt saves a checkpoint first.
    """
    if (minutes is None) == (steps is None):
        raise ValueError("give a budget: either minutes or steps")
    if not 0 < (minutes or steps or 0) < math.inf:
        raise ValueError(f"the budget must be positive, not {minutes or steps}")
    run = _Run(settings, recipe, out, minutes, steps, seed, device, resume)
    run.learn(on_progress)
    return run.finish()


class _Run:
    def __init__(
        self,
        settings: Settings,
        recipe: ImitationRecipe,
        out: Path,
        minutes: float | None,
        steps: int | None,
        seed: int,
        device: str,
        resume: bool,
    ) -> None:
        self._start_cpu_seconds = cpu_seconds()
        self._settings, self._recipe, self._seed = settings, recipe, seed
        self._minutes, self._steps = minutes, steps
        self._device = select_device(device)
        self._state = _TrainingState()
        tasks = settings.make("train").tasks
        self._excluded = held_out_digests(settings.corpus)
        identity = {
            "learner": KIND,
            "environment": settings.to_json(),
            "recipe": recipe.to_json(),
            "seed": seed,
            "tasks_sha256": tasks.provenance.sha256,
            "held_out_sha256": digests_sha256(self._excluded),
        }
        defaults = {"recipe": asdict(ImitationRecipe()), "held_out_sha256": identity["held_out_sha256"]}
        self._run = begin_run(out, identity, resume=resume, defaults=defaults)
        self._run.remember(minutes=minutes, steps=steps)
        appearance = make_appearance(settings.appearance)
        self._dynamics = make_dynamics(appearance, settings.rules, settings.horizon)
        entries, self._held_out = split_held_out(entries_from_tasks(tasks), recipe.held_out, seed=0)
        self._entries = entries
        played = {settings.configuration: tasks}
        if settings.start == "flipit" and recipe.empty_starts:
            scratch = configuration_name(settings.appearance, "scratch")
            with suppress(NoTasksError):
                played[scratch] = replace(settings, configuration=scratch).make("train").tasks
        self._held_out_tasks = {name: _tasks_of(task_set, self._held_out) for name, task_set in played.items()}
        self._other_scenes = distinct_starts(entries) if settings.start == "flipit" else []
        self._rng = np.random.default_rng(seed)
        self._table = BoxFeatureTable()
        empty_starts = recipe.empty_starts if settings.start == "flipit" else 0.0
        self._collector = DataCollector(self._dynamics, self._table, self._rng, recipe.budget, empty_starts)
        vocabulary = vocabulary_of(self._statements())
        self._tokenizer = StatementTokenizer(vocabulary)
        self._architecture = Architecture.of(settings.appearance, vocabulary, recipe)
        torch.manual_seed(seed)
        self._network = self._architecture.network(recipe.dropout).to(self._device)
        self._optimiser = torch.optim.AdamW(
            self._network.parameters(), recipe.learning_rate, weight_decay=recipe.weight_decay, fused=True
        )
        if resume and self._run.has_checkpoint:
            self._load_checkpoint()
        heads = self._collector.heads
        self._policy = CachedPolicy(self._network, self._table, heads, self._tokenizer)
        self._policy.reduced_precision = recipe.reduced_precision
        self._batches = BatchSampler(
            self._table,
            heads,
            self._tokenizer,
            self._device,
            recolours=recipe.recolour,
            word_dropout=recipe.unknown_words,
            single_action=recipe.single_action,
        )

    def _statements(self) -> Iterator[str]:
        """The statements that make up the vocabulary."""
        yield from (entry.statement for entry in self._entries)
        if self._recipe.pretraining:
            pairs = training_pairs(self._settings.appearance, self._seed, noise=False)
            yield from (pair.statement for pair in itertools.islice(pairs, VOCABULARY_PAIRS))

    # The budget

    def _seconds(self) -> float:
        return self._state.cpu_seconds + cpu_seconds() - self._start_cpu_seconds

    def _progress(self) -> float:
        """The fraction of the budget spent."""
        if self._steps is not None:
            return self._state.steps / self._steps
        assert self._minutes is not None
        return self._seconds() / (60 * self._minutes)

    # Training

    def learn(self, on_progress: Callable[[Progress], object]) -> None:
        """Pretrains, then alternates data collection and optimiser steps until the budget is spent."""
        recent: list[tuple[float, float, float]] = []
        try:
            self._pretrain_text(on_progress)
            self._collect_initial_data()
            if not self._state.begun_at:
                self._pretrain_geometry()
                self._state.begun_at = self._progress()
            saved = reported = self._seconds()
            while self._progress() < 1:
                if self._is_collection_due():
                    self._collect_more()
                recent.append(self._step())
                now = self._seconds()
                if now - reported > REPORT_SECONDS:
                    self._report(recent, on_progress)
                    recent, reported = [], now
                if now - saved > SAVE_SECONDS:
                    self._save()
                    saved = now
        except KeyboardInterrupt:
            self._save()
            raise
        if recent:
            self._report(recent, on_progress)

    def _pretrain_geometry(self) -> None:
        heads, fraction = self._network.scatter, GEOMETRY_FRACTION * self._recipe.pretraining
        if heads is None or not fraction:
            return
        geometry = GeometryPretraining(heads.geometry, self._table, self._recipe.warmup, self._rng)
        first = self._progress()
        while (done := (self._progress() - first) / fraction) < 1:
            loss = geometry.step(done)
            self._check_finite(loss, f"legal edits {loss:g}")
            self._state.steps += 1

    def _pretrain_text(self, on_progress: Callable[[Progress], object]) -> None:
        fraction = self._recipe.pretraining
        if self._progress() >= fraction:
            return
        text = TextPretraining(
            self._network,
            self._tokenizer,
            self._entries,
            self._settings.appearance,
            self._excluded,
            self._recipe,
            self._seed,
        )
        recent: list[float] = []
        reported = self._seconds()
        while (done := self._progress() / fraction) < 1:
            recent.append(text.step(done))
            self._check_finite(recent[-1], f"text {recent[-1]:g}")
            self._state.steps += 1
            if self._seconds() - reported > REPORT_SECONDS:
                self._report_progress(on_progress, text=round(float(np.mean(recent)), 4))
                recent, reported = [], self._seconds()
        self._save()

    def _check_finite(self, loss: float, parts: str) -> None:
        if not math.isfinite(loss):
            raise TrainingError(
                f"the loss is not finite at step {self._state.steps} ({parts});"
                f" the last good checkpoint is kept in {self._run.path}; try a lower learning rate"
            )

    def _step(self) -> tuple[float, float, float]:
        """One optimiser step. Returns the truth loss, the action loss and the truth accuracy."""
        recipe = self._recipe
        entries = self._sample(self._solvable(self._entries), recipe.statements)
        batch = self._batches.batch(entries, recipe.solved, recipe.truth_only, self._rng)
        for group in self._optimiser.param_groups:
            group["lr"] = recipe.learning_rate * self._schedule()
        self._network.train()
        with precision(self._device, reduced=recipe.reduced_precision):
            outputs = self._network(batch.inputs, batch.targets)
        parts = losses(outputs, batch)
        loss = self._weighted(parts)
        self._check_finite(
            loss.item(), ", ".join(f"{name} {value.item():g}" for name, value in parts._asdict().items())
        )
        self._optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(self._network.parameters(), recipe.gradient_norm)
        self._optimiser.step()
        self._state.steps += 1
        self._state.states += batch.truths.numel()
        accuracy = ((outputs.truth.detach() > 0) == (batch.truths > 0.5)).float().mean()
        return float(parts.truth.detach()), float(parts.actions.detach()), float(accuracy)

    def _weighted(self, parts: Losses) -> torch.Tensor:
        recipe = self._recipe
        return recipe.truth * parts.truth + parts.actions + recipe.steps * parts.steps + recipe.legal * parts.legal

    def _schedule(self) -> float:
        """The learning rate relative to its peak: linear warm-up, then cosine decay."""
        begun_at = self._state.begun_at
        done = min(1.0, (self._progress() - begun_at) / (1 - begun_at))
        warm_up = min(1.0, (done + 1e-3) / self._recipe.warmup) if self._recipe.warmup else 1.0
        return warm_up * (0.02 + 0.98 * 0.5 * (1 + math.cos(math.pi * done)))

    def _sample(self, entries: Sequence[DatasetEntry], count: int) -> list[DatasetEntry]:
        chosen = self._rng.choice(len(entries), count, replace=len(entries) < count)
        return [entries[index] for index in chosen]

    @staticmethod
    def _solvable(entries: Sequence[DatasetEntry]) -> list[DatasetEntry]:
        return [entry for entry in entries if entry.with_actions]

    # Data collection

    def _collect_initial_data(self) -> None:
        began = self._seconds()
        for entry in self._entries:
            if not entry.with_actions:
                self._collector.collect(entry, self._recipe.first_scenes, self._recipe.truth_only, self._other_scenes)
        if not self._solvable(self._entries):
            raise TrainingError("nothing to imitate: the expert solves no scene of any training statement")
        self._state.exploring_seconds += self._seconds() - began

    def _is_collection_due(self) -> bool:
        if self._steps is not None:  # deterministic
            return self._state.steps % max(1, round(2 / max(self._recipe.exploring, 1e-6))) == 0
        return self._state.exploring_seconds < self._recipe.exploring * self._seconds()

    def _collect_more(self) -> None:
        began = self._seconds()
        entries = self._sample(self._entries, ENTRIES_PER_COLLECTION)
        if self._progress() > ON_POLICY_AFTER and self._rng.random() < self._recipe.own_states:
            self._collect_on_policy(entries)
        else:
            for entry in entries:
                self._collector.collect(entry, 1, 2, self._other_scenes)
        self._state.exploring_seconds += self._seconds() - began

    def _collect_on_policy(self, entries: Sequence[DatasetEntry]) -> None:
        """Adds the last scenes of the network's own episodes (DAgger)."""
        tasks: list[Task] = []
        for entry in entries:
            start = self._collector.start(entry)
            tasks.append(Task("", entry.statement, entry.program.source, not entry.program(start), start))
        rule = StopRule(never_first=self._settings.start == "flipit")
        rng = self._rng if self._rng.random() < 0.5 else None
        self._policy.clear_cache()
        choose = action_chooser(self._policy, self._dynamics.horizon, rule, rng)
        for entry, episode in zip(entries, play_episodes(self._policy, self._dynamics, tasks, choose), strict=True):
            for scene in dict.fromkeys(episode.scenes[-3:]):
                self._collector.add(entry, scene, solve=True)

    # Files

    def _report(self, recent: Sequence[tuple[float, float, float]], on_progress: Callable[[Progress], object]) -> None:
        truth, actions, right = np.mean(recent, axis=0).round(4).tolist()
        self._report_progress(on_progress, truth=truth, actions=actions, truth_accuracy=right)

    def _report_progress(
        self,
        on_progress: Callable[[Progress], object],
        *,
        text: float | None = None,
        truth: float | None = None,
        actions: float | None = None,
        truth_accuracy: float | None = None,
    ) -> None:
        state = self._state
        progress = Progress(
            state.steps,
            state.states,
            round(self._seconds(), 1),
            round(state.exploring_seconds, 1),
            self._collector.expert_queries,
            text,
            truth,
            actions,
            truth_accuracy,
        )
        self._run.record(progress._asdict())
        on_progress(progress)

    def _save(self) -> None:
        state = {
            "network": self._network.state_dict(),
            "optimiser": self._optimiser.state_dict(),
            "counters": {**vars(self._state), "cpu_seconds": self._seconds()},
        }
        self._run.save_checkpoint(state)

    def _load_checkpoint(self) -> None:
        state = self._run.load_checkpoint(self._device)
        try:
            self._network.load_state_dict(state["network"])
            self._optimiser.load_state_dict(state["optimiser"])
            self._state = _TrainingState(**state["counters"])
        except (KeyError, RuntimeError, ValueError, TypeError, AttributeError) as error:
            reason = (str(error).strip() or type(error).__name__).splitlines()[0]
            raise TrainingRunError(f"the checkpoint in {self._run.path} is not of this run: {reason}") from None
        self._rng = np.random.default_rng([self._seed, self._state.steps])
        self._collector.rng = self._rng

    def finish(self) -> ImitationAgent:
        """Tunes the stop rules on the held-out statements, and saves the agent."""
        self._save()
        self._policy.clear_cache()
        rules: dict[str, StopRule] = {}
        accuracies: dict[str, float | None] = {}
        for name, tasks in self._held_out_tasks.items():
            rules[name], accuracies[name] = StopRule(never_first=CONFIGURATIONS[name][1] == "flipit"), None
            if tasks:
                chosen = tasks[:: max(1, len(tasks) // MAX_STOP_RULE_TASKS)]
                rules[name], accuracies[name] = tune_stop_rule(self._policy, self._dynamics, chosen, self._rng)
        statistics = {
            "seed": self._seed,
            "steps": self._state.steps,
            "states": self._state.states,
            "cpu_minutes": round(self._seconds() / 60, 2),
            "exploring_cpu_minutes": round(self._state.exploring_seconds / 60, 2),
            "held_out_tasks": {name: len(tasks) for name, tasks in self._held_out_tasks.items()},
            "held_out_accuracy": accuracies,
        }
        description = describe(self._settings, self._recipe, self._architecture, rules, statistics)
        agent = ImitationAgent(self._network.eval(), self._architecture, rules, description)
        agent.save(self._run.agent_file)
        return agent


def distinct_starts(entries: Iterable[DatasetEntry]) -> list[Any]:
    """The distinct start scenes of the entries, in order."""
    return list(dict.fromkeys(start for entry in entries for start in entry.starts))


def _tasks_of(tasks: Iterable[Task], entries: Sequence[DatasetEntry]) -> list[Task]:
    statements = {entry.statement for entry in entries}
    return [task for task in tasks if task.statement in statements]
