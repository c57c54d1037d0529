"""A run of imitation: exploring, learning, checkpoints, and at the end the rule for when to stop."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import nn

from lilgym_mp.appearances import make_appearance
from lilgym_mp.corpus.faults import NoTasksError
from lilgym_mp.envs.registration import START_TITLES
from lilgym_mp.evaluation import Settings
from lilgym_mp.evaluation.settings import CONFIGURATIONS
from lilgym_mp.generator.training_pairs import training_pairs
from lilgym_mp.learning.devices import select_device
from lilgym_mp.learning.imitation.agent import KIND, ImitationAgent, Shape, describe
from lilgym_mp.learning.imitation.batches import BatchSampler, StatementTokenizer, vocabulary_of
from lilgym_mp.learning.imitation.box_features import BoxFeatureTable
from lilgym_mp.learning.imitation.cached_policy import Player, StopRule, best_rule, chooser, play, precision
from lilgym_mp.learning.imitation.dataset import (
    DataCollector,
    DatasetEntry,
    Pool,
    derived_entry,
    entries_from_tasks,
    generated_entries,
    held_out,
)
from lilgym_mp.learning.imitation.losses import Losses, losses
from lilgym_mp.learning.imitation.pretraining import GeometryPretraining, TextPretraining
from lilgym_mp.learning.imitation.recipe import ImitationRecipe
from lilgym_mp.learning.parsing.batches import evaluation_statements
from lilgym_mp.learning.training_run import TrainingError, TrainingRunError, begin_run
from lilgym_mp.rules import make_dynamics
from lilgym_mp.scene import Scene
from lilgym_mp.task import Task

SAVE_SECONDS = 30.0  # of processor time between checkpoints
REPORT_SECONDS = 10.0
ENTRIES_PER_COLLECTION = 32  # statements
GEOMETRY_SHARE = 0.2  # of the share of the run that pretraining takes; on top of it (Scatter)
ON_POLICY_AFTER = 0.2  # share of the budget after which the network's own states are collected
MOST_TASKS_FOR_RULE = 600
POOL_FIRST = 100  # further statements before learning begins
POOL_GROWTH = 8  # and whenever it explores
PAIRS_FOR_WORDS = 2000  # generated statements whose words are known


class Progress(NamedTuple):
    """How a run stands."""

    steps: int  # of the optimiser
    states: int  # learnt from so far
    cpu_seconds: float  # of this process and its children, over the whole run
    exploring_seconds: float  # of them, spent on scenes and optimal actions
    sets: int  # optimal sets asked of the expert since the run was begun or resumed
    text: float | None  # losses, means since the last report: of writing programs, while the text layers learn that
    truth: float | None  # of the statement's truth, and of the actions, after that
    actions: float | None
    truth_accuracy: float | None


@dataclass
class _Standing:
    """What a checkpoint holds beside the network and the optimiser."""

    steps: int = 0
    states: int = 0
    cpu_seconds: float = 0.0
    exploring_seconds: float = 0.0
    begun_at: float = 0.0  # share of the budget that was spent when imitation began


def cpu_seconds() -> float:
    """Processor time of this process and the children that it waited for."""
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
    others: Sequence[Task] = (),
    on_progress: Callable[[Progress], object] = lambda progress: None,
) -> ImitationAgent:
    """Trains, writes the agent to `out`/agent.safetensors, and gives it.

    The budget is either `minutes` of processor time, everything included, or `steps` of the optimiser; with `steps`
    equal arguments give equal agents. `others`: tasks of further statements, learnt from as well. `resume` goes on
    from `out`'s last checkpoint, with the recipe and seed that it was begun with.
    Raises ValueError for a budget or settings that cannot be, TrainingRunError for an `out` that cannot serve,
    TrainingError when the loss is no number, CorpusError for unusable data. KeyboardInterrupt leaves a checkpoint
    behind.
    """
    if (minutes is None) == (steps is None):
        raise ValueError("give a budget: either minutes or steps")
    if not 0 < (minutes or steps or 0) < math.inf:
        raise ValueError(f"the budget must be positive, not {minutes or steps}")
    run = _Run(settings, recipe, out, minutes, steps, seed, device, resume, others)
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
        others: Sequence[Task],
    ) -> None:
        self._began = cpu_seconds()
        self._settings, self._recipe, self._seed = settings, recipe, seed
        self._minutes, self._steps = minutes, steps
        self._device = select_device(device)
        self._standing = _Standing()
        tasks = settings.make("train").tasks
        identity = {
            "learner": KIND,
            "environment": settings.to_json(),
            "recipe": recipe.to_json(),
            "seed": seed,
            "tasks_sha256": tasks.provenance.sha256,
            "other_tasks": len(others),
        }
        self._run = begin_run(out, identity, resume=resume)
        appearance = make_appearance(settings.appearance)
        self._dynamics = make_dynamics(appearance, settings.rules, settings.horizon)
        entries, self._apart = held_out(entries_from_tasks(tasks), recipe.held_out, seed=0)
        self._entries = entries
        self._others = entries_from_tasks(others)
        played = {settings.configuration: tasks}
        if settings.start == "flipit" and recipe.empty_starts:
            scratch = f"{settings.appearance.capitalize()}{START_TITLES['scratch']}"
            with suppress(NoTasksError):
                played[scratch] = replace(settings, configuration=scratch).make("train").tasks
        self._tasks_apart = {name: _tasks_of(found, self._apart) for name, found in played.items()}
        self._other_scenes = sorted_scenes(entries) if settings.start == "flipit" else []
        self._rng = np.random.default_rng(seed)
        self._table = BoxFeatureTable()
        empty_starts = recipe.empty_starts if settings.start == "flipit" else 0.0
        self._collector = DataCollector(self._dynamics, self._table, self._rng, recipe.budget, empty_starts)
        self._pools = self._new_pools()
        vocabulary = vocabulary_of(self._statements())
        self._tokenizer = StatementTokenizer(vocabulary)
        self._shape = Shape.of(settings.appearance, vocabulary, recipe)
        torch.manual_seed(seed)
        self._network = self._shape.network(recipe.dropout).to(self._device)
        self._optimiser = torch.optim.AdamW(
            self._network.parameters(), recipe.learning_rate, weight_decay=recipe.weight_decay, fused=True
        )
        if resume and self._run.has_checkpoint:
            self._load_checkpoint()
        heads = self._collector.heads
        self._player = Player(self._network, self._table, heads, self._tokenizer)
        self._player.reduced_precision = recipe.reduced_precision
        self._batches = BatchSampler(
            self._table,
            heads,
            self._tokenizer,
            self._device,
            recolours=recipe.recolour,
            unknown_words=recipe.unknown_words,
            single_action=recipe.single_action,
        )

    def _new_pools(self) -> list[tuple[Pool, float]]:
        """Pools of further entries, and their shares of a batch."""
        recipe, rng = self._recipe, self._rng
        starts = self._other_scenes or [Scene.empty()]
        derived = (derived_entry(self._entries[rng.integers(len(self._entries))], rng) for _ in itertools.count())
        generated = generated_entries(self._settings.appearance, self._seed, starts, rng)
        pools = [(Pool(derived, recipe.pool), recipe.derived), (Pool(generated, recipe.pool), recipe.generated)]
        return [(pool, share) for pool, share in pools if share]

    def _statements(self) -> Iterator[str]:
        """Those whose words are to be known."""
        yield from (entry.statement for entry in (*self._entries, *self._others))
        if self._recipe.generated or self._recipe.pretraining:
            pairs = training_pairs(self._settings.appearance, self._seed, noise=False)
            yield from (pair.statement for pair in itertools.islice(pairs, PAIRS_FOR_WORDS))

    # The budget

    def _seconds(self) -> float:
        return self._standing.cpu_seconds + cpu_seconds() - self._began

    def _done(self) -> float:
        """Share of the budget that is spent."""
        if self._steps is not None:
            return self._standing.steps / self._steps
        assert self._minutes is not None
        return self._seconds() / (60 * self._minutes)

    # Learning

    def learn(self, on_progress: Callable[[Progress], object]) -> None:
        """Pretrains the text layers, then explores and learns by turns until the budget is spent."""
        recent: list[tuple[float, float, float]] = []
        try:
            self._pretrain_text(on_progress)
            self._collect_initial_data()
            if not self._standing.begun_at:
                self._pretrain_geometry()
                self._standing.begun_at = self._done()
            saved = reported = self._seconds()
            while self._done() < 1:
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
        heads, share = self._network.scatter, GEOMETRY_SHARE * self._recipe.pretraining
        if heads is None or not share:
            return
        geometry = GeometryPretraining(heads.geometry, self._table, self._recipe.warmup, self._rng)
        first = self._done()
        while (done := (self._done() - first) / share) < 1:
            loss = geometry.step(done)
            self._check_finite(loss, f"valid edits {loss:g}")
            self._standing.steps += 1

    def _pretrain_text(self, on_progress: Callable[[Progress], object]) -> None:
        share = self._recipe.pretraining
        if self._done() >= share:
            return
        statements = [*self._entries, *self._others]
        text = TextPretraining(
            self._network,
            self._tokenizer,
            statements,
            self._settings.appearance,
            evaluation_statements(self._settings.corpus),
            self._recipe,
            self._seed,
        )
        recent: list[float] = []
        reported = self._seconds()
        while (done := self._done() / share) < 1:
            recent.append(text.step(done))
            self._check_finite(recent[-1], f"text {recent[-1]:g}")
            self._standing.steps += 1
            if self._seconds() - reported > REPORT_SECONDS:
                self._tell(on_progress, text=round(float(np.mean(recent)), 4))
                recent, reported = [], self._seconds()
        self._save()

    def _check_finite(self, loss: float, shown: str) -> None:
        if not math.isfinite(loss):
            raise TrainingError(
                f"the loss is not finite at step {self._standing.steps} ({shown});"
                f" the last good checkpoint is kept in {self._run.path}; try a lower learning rate"
            )

    def _step(self) -> tuple[float, float, float]:
        """One step of the optimiser. Gives the losses of truth and actions, and how often the truth was right."""
        recipe = self._recipe
        batch = self._batches.batch(self._sample_entries(), recipe.solved, recipe.judged, self._rng)
        for group in self._optimiser.param_groups:
            group["lr"] = recipe.learning_rate * self._schedule()
        self._network.train()
        with precision(self._device, reduced=recipe.reduced_precision):
            outputs = self._network(batch.inputs, batch.targets)
        found = losses(outputs, batch)
        loss = self._weighted(found)
        self._check_finite(
            loss.item(), ", ".join(f"{name} {value.item():g}" for name, value in found._asdict().items())
        )
        self._optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(self._network.parameters(), recipe.gradient_norm)
        self._optimiser.step()
        self._standing.steps += 1
        self._standing.states += batch.truths.numel()
        right = ((outputs.truth.detach() > 0) == (batch.truths > 0.5)).float().mean()
        return float(found.truth.detach()), float(found.actions.detach()), float(right)

    def _weighted(self, found: Losses) -> torch.Tensor:
        recipe = self._recipe
        return recipe.truth * found.truth + found.actions + recipe.steps * found.steps + recipe.legal * found.legal

    def _schedule(self) -> float:
        begun_at = self._standing.begun_at
        done = min(1.0, (self._done() - begun_at) / (1 - begun_at))
        rising = min(1.0, (done + 1e-3) / self._recipe.warmup) if self._recipe.warmup else 1.0
        return rising * (0.02 + 0.98 * 0.5 * (1 + math.cos(math.pi * done)))

    def _sample_entries(self) -> list[DatasetEntry]:
        """TrainingData for a batch: of the pools and of other tasks by their shares, the rest of the training tasks."""
        sources: list[tuple[Sequence[DatasetEntry], float]] = [(pool.entries, share) for pool, share in self._pools]
        sources.append((self._ready(self._others), self._recipe.mixed_share))
        count = self._recipe.statements
        sample: list[DatasetEntry] = []
        for entries, share in sources:
            if entries:
                sample += self._some(entries, round(count * share))
        return [*sample, *self._some(self._ready(self._entries), count - len(sample))]

    def _some(self, entries: Sequence[DatasetEntry], count: int) -> list[DatasetEntry]:
        if not count:
            return []
        chosen = self._rng.choice(len(entries), count, replace=len(entries) < count)
        return [entries[index] for index in chosen]

    @staticmethod
    def _ready(entries: Sequence[DatasetEntry]) -> list[DatasetEntry]:
        return [entry for entry in entries if entry.with_actions]

    # Exploring

    def _collect_initial_data(self) -> None:
        began = self._seconds()
        for entry in (*self._entries, *self._others):
            if not entry.with_actions:
                self._collector.collect(entry, self._recipe.first_scenes, self._recipe.judged, self._other_scenes)
        for pool, _ in self._pools:
            self._grow(pool, POOL_FIRST)
        if not self._ready(self._entries):
            raise TrainingError("nothing to imitate: the expert solves no scene of any training statement")
        self._standing.exploring_seconds += self._seconds() - began

    def _grow(self, pool: Pool, count: int) -> None:
        pool.grow(self._collector, count, self._recipe.first_scenes, self._recipe.judged, self._other_scenes)

    def _is_collection_due(self) -> bool:
        if self._steps is not None:  # by steps, so that equal arguments give equal agents
            return self._standing.steps % max(1, round(2 / max(self._recipe.exploring, 1e-6))) == 0
        return self._standing.exploring_seconds < self._recipe.exploring * self._seconds()

    def _collect_more(self) -> None:
        began = self._seconds()
        for pool, _ in self._pools:
            self._grow(pool, POOL_GROWTH)
        entries = self._some([*self._entries, *self._others], ENTRIES_PER_COLLECTION)
        if self._done() > ON_POLICY_AFTER and self._rng.random() < self._recipe.own_states:
            self._collect_on_policy(entries)
        else:
            for entry in entries:
                self._collector.collect(entry, 1, 2, self._other_scenes)
        self._standing.exploring_seconds += self._seconds() - began

    def _collect_on_policy(self, entries: Sequence[DatasetEntry]) -> None:
        """Adds the scenes that the network comes to, from starts of the entries (DAgger)."""
        tasks: list[Task] = []
        for entry in entries:
            start = self._collector.start(entry)
            tasks.append(Task("", entry.statement, entry.program.source, not entry.program(start), start))
        rule = StopRule(never_first=self._settings.start == "flipit")
        rng = self._rng if self._rng.random() < 0.5 else None
        self._player.forget()
        choose = chooser(self._player, self._dynamics.horizon, rule, rng)
        for entry, episode in zip(entries, play(self._player, self._dynamics, tasks, choose), strict=True):
            for scene in dict.fromkeys(episode.scenes[-3:]):
                self._collector.add(entry, scene, solve=True)

    # What is left behind

    def _report(self, recent: Sequence[tuple[float, float, float]], on_progress: Callable[[Progress], object]) -> None:
        truth, actions, right = np.mean(recent, axis=0).round(4).tolist()
        self._tell(on_progress, truth=truth, actions=actions, truth_accuracy=right)

    def _tell(
        self,
        on_progress: Callable[[Progress], object],
        *,
        text: float | None = None,
        truth: float | None = None,
        actions: float | None = None,
        truth_accuracy: float | None = None,
    ) -> None:
        standing = self._standing
        progress = Progress(
            standing.steps,
            standing.states,
            round(self._seconds(), 1),
            round(standing.exploring_seconds, 1),
            self._collector.sets,
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
            "standing": {**vars(self._standing), "cpu_seconds": self._seconds()},
        }
        self._run.save_checkpoint(state)

    def _load_checkpoint(self) -> None:
        state = self._run.load_checkpoint(self._device)
        try:
            self._network.load_state_dict(state["network"])
            self._optimiser.load_state_dict(state["optimiser"])
            self._standing = _Standing(**state["standing"])
        except (KeyError, RuntimeError, ValueError, TypeError, AttributeError) as fault:
            reason = (str(fault).strip() or type(fault).__name__).splitlines()[0]
            raise TrainingRunError(f"the checkpoint in {self._run.path} is not of this run: {reason}") from None
        self._rng = np.random.default_rng([self._seed, self._standing.steps])
        self._collector.use(self._rng)

    def finish(self) -> ImitationAgent:
        """Chooses the rule for when to stop on the statements kept apart, and writes the agent."""
        self._save()
        self._player.forget()
        rules: dict[str, StopRule] = {}
        shares: dict[str, float | None] = {}
        for name, tasks in self._tasks_apart.items():
            rules[name], shares[name] = StopRule(never_first=CONFIGURATIONS[name][1] == "flipit"), None
            if tasks:
                chosen = tasks[:: max(1, len(tasks) // MOST_TASKS_FOR_RULE)]
                rules[name], shares[name] = best_rule(self._player, self._dynamics, chosen, self._rng)
        found = {
            "seed": self._seed,
            "steps": self._standing.steps,
            "states": self._standing.states,
            "cpu_minutes": round(self._seconds() / 60, 2),
            "exploring_cpu_minutes": round(self._standing.exploring_seconds / 60, 2),
            "held_out_tasks": {name: len(tasks) for name, tasks in self._tasks_apart.items()},
            "held_out_accuracy": shares,
            "other_statements": len(self._others),
            "generated_share": self._recipe.generated,
        }
        description = describe(self._settings, self._recipe, self._shape, rules, found)
        agent = ImitationAgent(self._network.eval(), self._shape, rules, description)
        agent.save(self._run.agent_file)
        return agent


def sorted_scenes(entries: Iterable[DatasetEntry]) -> list[Any]:
    """Every distinct start scene of the entries, in their order."""
    return list(dict.fromkeys(start for entry in entries for start in entry.starts))


def _tasks_of(tasks: Iterable[Task], entries: Sequence[DatasetEntry]) -> list[Task]:
    statements = {entry.statement for entry in entries}
    return [task for task in tasks if task.statement in statements]
