"""Imitation of sets of optimal actions with dataset aggregation (DAgger): a run from pretraining to the stop rule.

Start reading at `ImitationRun.learn`.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from statistics import fmean
from typing import NamedTuple, Unpack

import numpy as np
import torch

from lilgym_mp.corpus.generator import training_pairs
from lilgym_mp.corpus.held_out import digests_sha256, held_out_digests
from lilgym_mp.corpus.records import FLIPIT
from lilgym_mp.envs.batched import BatchedEnv
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.evaluation import CONFIGURATIONS
from lilgym_mp.evaluation.episodes import scenes
from lilgym_mp.evaluation.runs import play_tasks
from lilgym_mp.learning.common.model_file import precision
from lilgym_mp.learning.common.optimisation import cosine_decay, optimise, warm_up
from lilgym_mp.learning.common.run import Budget, Counters, Session, TrainingRun, training
from lilgym_mp.learning.common.run_directory import TrainingRunError
from lilgym_mp.learning.common.tasks import TRAINING_SPLIT, train_tasks
from lilgym_mp.learning.common.words import StatementTokenizer, vocabulary_of
from lilgym_mp.learning.imitation.agent import (
    ImitationAgent,
    NetworkPolicy,
    StopRule,
    StopRulePolicy,
    architecture,
    make_network,
    tune_stop_rule,
)
from lilgym_mp.learning.imitation.batches import BatchSampler, losses
from lilgym_mp.learning.imitation.box_features import BoxFeatureTable
from lilgym_mp.learning.imitation.dataset import DataCollector, DatasetEntry, entries_from_tasks, split_held_out
from lilgym_mp.learning.imitation.learner import ImitationOptions, ImitationRecipe
from lilgym_mp.learning.imitation.pretraining import TextPretraining, pretrain_geometry
from lilgym_mp.learning.imitation.teaching import TaughtCollector, open_teacher
from lilgym_mp.scene import Scene
from lilgym_mp.scene.appearances import RELEASED_GRID
from lilgym_mp.scene.arrays import AnyDict

ENTRIES_PER_COLLECTION = 32
ON_POLICY_AFTER = 0.2  # fraction of the budget after which the network's own states are collected
LAST_SCENES = 3  # of each of the network's episodes that are labelled
LOWEST_RATE = 0.02  # the last learning rate relative to the peak
GEOMETRY_UPDATES = 4  # of geometry pretraining (Scatter) per update of text pretraining; short, outside the budget
MAX_STOP_RULE_TASKS = 600
VOCABULARY_PAIRS = 2000  # generated statements whose words are in the vocabulary


class ImitationProgress(NamedTuple):
    """A line of progress.jsonl; losses are means since the last report."""

    updates: int  # optimiser steps
    states: int  # number of labelled states trained on so far
    cpu_seconds: float  # CPU time of this process and its children over the whole run
    sets: int  # expert queries since the run was started or resumed
    text: float | None = None  # loss of writing programs, during text pretraining only
    truth: float | None = None  # truth loss; None during pretraining, like the following
    actions: float | None = None  # loss of the sets of optimal actions
    truth_accuracy: float | None = None

    @property
    def note(self) -> str:
        """Losses of the phase in progress, for the line in the terminal."""
        if self.actions is None or self.truth_accuracy is None:
            return f"text layers, loss {self.text or 0:.2f}"
        return f"{self.states:,} states, loss {self.actions:.2f}, truth {100 * self.truth_accuracy:.1f} %"


@dataclass
class ImitationCounters(Counters):
    """Counts of an imitation run."""

    states: int = 0  # labelled states trained on
    begun_at: float = 0.0  # fraction of the budget spent when imitation began, after pretraining


class ImitationRun(TrainingRun):
    """Trains an agent by imitation.

    The budget is `updates` of the optimiser, or `minutes` of CPU time, everything included, whichever is spent first;
    with `updates` alone equal arguments give equal agents. With a `teacher`, the run of a reward model, its search is
    imitated instead of the expert: expert iteration, from rewards and the rules of editing. `out`, signals and errors
    as for PPO, but an interrupted run saves no agent.
    """

    def __init__(
        self,
        settings: EnvConfig,
        recipe: ImitationRecipe,
        out: Path,
        *,
        updates: int | None = None,
        minutes: float | None = None,
        seed: int = 0,
        teacher: Path | None = None,
        **session: Unpack[Session],
    ) -> None:
        super().__init__(out, Budget("updates", updates, minutes), session)
        self.counters: ImitationCounters = ImitationCounters()
        self._settings = settings
        self._recipe = recipe
        self._seed = seed
        self._is_taught = teacher is not None
        played = train_tasks(settings, scratch=recipe.empty_starts > 0)
        tasks = played[settings.configuration]
        self._excluded = held_out_digests(settings.corpus)
        identity = {
            "learner": ImitationAgent.kind,
            "environment": settings.to_json(),
            "recipe": recipe.to_json(),
            "seed": seed,
            "tasks_sha256": tasks.provenance.sha256,
            "held_out_sha256": digests_sha256(self._excluded),
            **({} if teacher is None else {"teacher": str(teacher)}),
        }
        planner = None if teacher is None else open_teacher(teacher).planner(settings)
        self.begin(identity)
        self._played = replace(settings, grid=RELEASED_GRID)  # the network's heads are those of that grid
        self._dynamics = self._played.dynamics()
        every = entries_from_tasks(tasks, reads_programs=teacher is None)
        if teacher is not None:  # episodes begin with the starts of every configuration
            others = [task for some in [*played.values()][1:] for task in some]
            for entry in every:
                entry.tasks += [task for task in others if task.statement == entry.statement]
        entries, held_out = split_held_out(every, recipe.held_out)
        tuned_on = {entry.statement for entry in held_out}
        self._held_out_tasks = {
            name: [task for task in some if task.statement in tuned_on] for name, some in played.items()
        }
        self._tokenizer = StatementTokenizer(vocabulary_of(self._statements(entries)))
        self._architecture = architecture(settings.appearance, self._tokenizer.vocabulary, recipe)
        torch.manual_seed(seed)
        self._network = network = make_network(self._architecture, recipe.dropout).to(self.device)
        self._entries = entries
        self._rng = np.random.default_rng(seed)
        table = BoxFeatureTable(settings.appearance)
        self._is_flipit = settings.start == FLIPIT  # no start is solved, and any statement is judged on all
        starts = dict.fromkeys(start for entry in entries for start in entry.starts)
        self._other_scenes: Sequence[Scene] = [*starts] if self._is_flipit else []
        empty_starts = recipe.empty_starts if self._is_flipit else 0.0
        self._collector = DataCollector(self._dynamics, table, self._rng, recipe.budget, empty_starts)
        if planner is not None:
            self._collector = TaughtCollector(planner, table, self._rng)
        heads = self._collector.heads
        self._policy = NetworkPolicy(network, table, heads, self._tokenizer, reduced_precision=True)
        self._batches = BatchSampler(table, heads, self._tokenizer, self.device, recipe)
        self._optimiser = torch.optim.AdamW(
            network.parameters(), recipe.learning_rate, weight_decay=recipe.weight_decay, fused=True
        )
        self.parts = {"network": network, "optimiser": self._optimiser}
        self.load()

    def _statements(self, entries: Sequence[DatasetEntry]) -> Iterator[str]:
        """The statements that make up the vocabulary."""
        yield from (entry.statement for entry in entries)
        if self._recipe.pretraining and not self._is_taught:
            pairs = training_pairs(self._settings.appearance, self._seed, noise=False)
            yield from (pair.statement for pair in itertools.islice(pairs, VOCABULARY_PAIRS))

    @cached_property
    def _envs(self) -> BatchedEnv:
        """Where the network plays to collect its own states."""
        return self._played.make_batch(TRAINING_SPLIT, ENTRIES_PER_COLLECTION)

    # Training

    def learn(self) -> None:
        """Pretrains, then alternates data collection and optimiser steps until the budget is spent."""
        self._pretrain_text()
        if self.stop.requested:
            return
        self._collect_first()
        if not self.counters.states:
            self._pretrain_geometry()
            self.counters.begun_at = self.progress()
        self.optimise()

    def step(self) -> dict[str, float]:
        """One optimiser step; returns losses of `ImitationProgress`."""
        recipe = self._recipe
        network = self._network
        counters = self.counters
        if counters.updates % recipe.collect_every == 0:
            self._collect_more(self.progress())
        done = max(0.0, (self.progress() - counters.begun_at) / (1 - counters.begun_at))  # since pretraining
        solvable = [entry for entry in self._entries if entry.with_actions]
        entries = self._sample(solvable, recipe.statements)
        batch = self._batches.batch(entries, recipe.solved, recipe.truth_only, self._rng)
        network.train()
        with precision(self.device):
            outputs = network(batch.inputs, batch.targets)
        parts = losses(outputs, batch)
        loss = recipe.truth * parts.truth + parts.actions + recipe.steps * parts.steps + recipe.legal * parts.legal
        rate = recipe.learning_rate * (warm_up(done, recipe.warmup) * cosine_decay(done, LOWEST_RATE))
        optimise(self._optimiser, loss, recipe.gradient_norm, rate, **parts._asdict())
        counters.updates += 1
        counters.states += batch.truths.numel()
        right = ((outputs.truth.detach() > 0) == (batch.truths > 0.5)).float().mean()
        return {"truth": parts.truth.item(), "actions": parts.actions.item(), "truth_accuracy": right.item()}

    def _sample(self, entries: Sequence[DatasetEntry], count: int) -> list[DatasetEntry]:
        chosen = self._rng.choice(len(entries), count, replace=len(entries) < count)
        return [entries[index] for index in chosen]

    # Data collection

    def _collect_first(self) -> None:
        """Labels scenes of every statement. Raises TrainingRunError if the expert solves none of them."""
        for entry in self._entries:
            if not entry.with_actions:
                self._collector.collect(entry, self._recipe.first_scenes, self._recipe.truth_only, self._other_scenes)
        if not any(entry.with_actions for entry in self._entries):
            raise TrainingRunError("nothing to imitate: the expert solves no scene of any training statement")

    def _collect_more(self, done: float) -> None:
        """Labels scenes of some statements: along the expert's solutions, or of the network's own episodes."""
        entries = self._sample(self._entries, ENTRIES_PER_COLLECTION)
        if done > ON_POLICY_AFTER and self._rng.random() < self._recipe.own_states:
            self._collect_on_policy(entries)
        else:
            for entry in entries:
                self._collector.collect(entry, 1, 2, self._other_scenes)

    def _collect_on_policy(self, entries: Sequence[DatasetEntry]) -> None:
        """Labels the last scenes of the network's episodes, half of the time sampled ones (DAgger)."""
        tasks = [self._collector.task(entry) for entry in entries]
        sampled = self._rng.random() < 0.5
        rule = StopRule(never_first=self._is_flipit)
        policy = StopRulePolicy(self._policy, self._dynamics, rule, sampled=sampled, needs_states=True)
        played = play_tasks(policy, self._envs, tasks, self._rng)
        for entry, task, episode in zip(entries, tasks, played, strict=True):
            visited = scenes(self._dynamics, task.start, episode.actions)[:-1]  # before each action
            self._collector.add_last_scenes(entry, task, visited, LAST_SCENES)

    # Pretraining

    def _pretrain_geometry(self) -> None:
        """Trains the prediction of legal edits, also where a teacher replaces text pretraining."""
        geometry = self._network.heads.geometry
        of_run = self.budget.amount or ImitationOptions().updates
        updates = round(GEOMETRY_UPDATES * self._recipe.pretraining * of_run)
        if geometry is not None and updates:
            pretrain_geometry(geometry, self._policy.table, updates, self._recipe.warmup, self._rng)

    def _pretrain_text(self) -> None:
        fraction = self._recipe.pretraining
        if self._is_taught or self.counters.states or self.progress() >= fraction:
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

        def step() -> dict[str, float]:
            loss = text.step(self.progress() / fraction)
            self.counters.updates += 1
            return {"text": loss}

        self.optimise(step, until=fraction)

    # Files

    def progress_line(self, recent: Sequence[dict[str, float]]) -> ImitationProgress:
        counters = self.counters
        return ImitationProgress(
            updates=counters.updates,
            states=counters.states,
            cpu_seconds=round(self.seconds(), 1),
            sets=self._collector.expert_queries,
            **{name: round(fmean(losses[name] for losses in recent), 4) for name in recent[0]},
        )

    def state(self) -> AnyDict:
        """For a checkpoint. The dataset is not part of it: a resumed run collects scenes again."""
        played = self._collector.played if isinstance(self._collector, TaughtCollector) else None
        return {**super().state(), "played": played and [played.stops, played.steps]}

    def restore(self, state: AnyDict) -> None:
        super().restore(state)
        if isinstance(self._collector, TaughtCollector) and state.get("played"):
            self._collector.played.stops, self._collector.played.steps = state["played"]
        self._rng = self._collector.rng = np.random.default_rng([self._seed, self.counters.updates])

    def finish(self) -> ImitationAgent:
        """The agent, with its stop rules tuned on the held-out statements."""
        rules: dict[str, StopRule] = {}
        accuracies: dict[str, float | None] = {}
        for name, tasks in self._held_out_tasks.items():
            rules[name] = StopRule(never_first=CONFIGURATIONS[name][1] == FLIPIT)
            accuracies[name] = None
            if tasks:
                chosen = tasks[:: max(1, len(tasks) // MAX_STOP_RULE_TASKS)]
                rules[name], accuracies[name] = tune_stop_rule(self._policy, self._played, chosen, self._rng)
        corpus = self._settings.corpus
        details = {
            "network": self._architecture,
            "stop_rules": {name: asdict(rule) for name, rule in rules.items()},
            "corpus": corpus,
            "seed": self._seed,
            "updates": self.counters.updates,
            "states": self.counters.states,
            "cpu_minutes": self.minutes(),
            "held_out_tasks": {name: len(tasks) for name, tasks in self._held_out_tasks.items()},
            "held_out_accuracy": accuracies,
        }
        supervision = f"programs of train statements (corpus {corpus}): truth of scenes, optimal actions"
        if isinstance(self._collector, TaughtCollector):
            played = self._collector.played
            details |= {"stops": played.stops, "steps": played.steps}
            supervision = f"rewards; search that knows the rules of editing, imitated (corpus {corpus})"
        elif self._recipe.pretraining:
            supervision += "; their programs and those of generated statements (pretraining)"
        description = ImitationAgent.describe(tuple(rules), supervision, self._recipe.to_json(), details)
        return ImitationAgent(description, self._network.eval(), rules)


train_imitation = training(ImitationRun)
