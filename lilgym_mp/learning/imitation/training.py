"""Imitation runs: budget, pretraining, checkpoints, progress, and finally the stop rule.

The algorithm itself is in `update`.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple, Unpack

import numpy as np
import torch

from lilgym_mp.corpus.generator import training_pairs
from lilgym_mp.corpus.held_out import digests_sha256, held_out_digests
from lilgym_mp.corpus.records import FLIPIT
from lilgym_mp.envs.rules import make_dynamics
from lilgym_mp.evaluation import CONFIGURATIONS, Settings
from lilgym_mp.learning.common.model_file import ModelDescription
from lilgym_mp.learning.common.run import Budget, Counters, Session, TrainingRun
from lilgym_mp.learning.common.tasks import train_tasks
from lilgym_mp.learning.common.words import StatementTokenizer, vocabulary_of
from lilgym_mp.learning.imitation.agent import KIND, VERSION, ImitationAgent, architecture, make_network
from lilgym_mp.learning.imitation.box_features import BoxFeatureTable
from lilgym_mp.learning.imitation.dataset import DataCollector, DatasetEntry, entries_from_tasks, split_held_out
from lilgym_mp.learning.imitation.policy import StopRule, tune_stop_rule
from lilgym_mp.learning.imitation.pretraining import GeometryPretraining, TextPretraining
from lilgym_mp.learning.imitation.recipe import ImitationRecipe
from lilgym_mp.learning.imitation.teaching import TaughtCollector, open_teacher
from lilgym_mp.learning.imitation.update import Imitation, StepResult
from lilgym_mp.programs.task import Task
from lilgym_mp.scene.appearances import make_appearance

GEOMETRY_UPDATES = 4  # of geometry pretraining per update of text pretraining (Scatter); short, outside the budget
MAX_STOP_RULE_TASKS = 600
VOCABULARY_PAIRS = 2000  # generated statements whose words are in the vocabulary


class Progress(NamedTuple):
    """A line of progress.jsonl; losses are means since the last report."""

    updates: int  # optimiser steps
    states: int  # number of labelled states trained on so far
    cpu_seconds: float  # CPU time of this process and its children over the whole run
    collection_seconds: float  # part of `cpu_seconds` spent on data collection
    sets: int  # expert queries since the run was started or resumed
    text: float | None = None  # loss of writing programs, during text pretraining only
    truth: float | None = None  # truth loss; None during pretraining, like the following
    actions: float | None = None  # loss of the sets of optimal actions
    truth_accuracy: float | None = None

    @property
    def note(self) -> str:
        if self.actions is None or self.truth_accuracy is None:
            return f"text layers, loss {self.text or 0:.2f}"
        return f"{self.states:,} states, loss {self.actions:.2f}, truth {100 * self.truth_accuracy:.1f} %"


@dataclass
class ImitationCounters(Counters):
    """Counts of an imitation run."""

    states: int = 0  # labelled states trained on
    begun_at: float = 0.0  # fraction of the budget spent when imitation began, after pretraining


def train_imitation(
    settings: Settings,
    recipe: ImitationRecipe,
    out: Path,
    *,
    updates: int | None = None,
    minutes: float | None = None,
    seed: int = 0,
    teacher: Path | None = None,
    **session: Unpack[Session],
) -> ImitationAgent:
    """Trains an agent, saves it as `out`/agent.safetensors and returns it.

    The budget is `updates` of the optimiser, or `minutes` of CPU time, everything included, whichever is spent first;
    with `updates` alone equal arguments give equal agents. With a `teacher`, the run of a reward model, its search is
    imitated instead of the expert: expert iteration, from rewards and the rules of editing. `out`, signals and errors
    as for `train_ppo`, but an interrupted run saves no agent.
    """
    return _Run.trained(out, Budget("updates", updates, minutes), session, settings, recipe, seed, teacher)


class _Run(TrainingRun[StepResult]):
    def __init__(
        self,
        out: Path,
        budget: Budget,
        session: Session,
        settings: Settings,
        recipe: ImitationRecipe,
        seed: int,
        teacher: Path | None,
    ) -> None:
        super().__init__(out, budget, session)
        self.counters: ImitationCounters = ImitationCounters()
        self._settings, self._recipe, self._seed = settings, recipe, seed
        played = train_tasks(settings, scratch=recipe.empty_starts > 0)
        tasks = played[settings.configuration]
        self._excluded = held_out_digests(settings.corpus)
        identity = {
            "learner": KIND,
            "environment": settings.to_json(),
            "recipe": recipe.to_json(),
            "seed": seed,
            "tasks_sha256": tasks.provenance.sha256,
            "held_out_sha256": digests_sha256(self._excluded),
            **({} if teacher is None else {"teacher": str(teacher)}),
        }
        self._teacher = None if teacher is None else open_teacher(teacher)
        if self._teacher is not None:
            self._teacher.planner(settings)  # raises AgentError before the run begins
        self.begin(identity)
        self._dynamics = make_dynamics(make_appearance(settings.appearance), settings.rules, settings.horizon)
        entries, held_out = split_held_out(entries_from_tasks(tasks, reads_programs=teacher is None), recipe.held_out)
        self._held_out_tasks = {name: _tasks_of(some, held_out) for name, some in played.items()}
        self._tokenizer = StatementTokenizer(vocabulary_of(self._statements(entries)))
        self._architecture = architecture(settings.appearance, self._tokenizer.vocabulary, recipe)
        torch.manual_seed(seed)
        network = make_network(self._architecture, recipe.dropout).to(self.device)
        rng, table, is_flipit = np.random.default_rng(seed), BoxFeatureTable(), settings.start == FLIPIT
        empty_starts = recipe.empty_starts if is_flipit else 0.0
        collector = DataCollector(self._dynamics, table, rng, recipe.budget, empty_starts)
        if self._teacher is not None:
            collector = TaughtCollector(self._teacher.planner(settings), list(played.values()), table, rng)
        self._imitation = Imitation(
            recipe, network, self._dynamics, self._tokenizer, entries, rng, collector, is_flipit=is_flipit
        )
        self.load()

    def _statements(self, entries: Sequence[DatasetEntry]) -> Iterator[str]:
        """The statements that make up the vocabulary."""
        yield from (entry.statement for entry in entries)
        if self._recipe.pretraining and self._teacher is None:
            pairs = training_pairs(self._settings.appearance, self._seed, noise=False)
            yield from (pair.statement for pair in itertools.islice(pairs, VOCABULARY_PAIRS))

    # Training

    def learn(self) -> None:
        """Pretrains, then alternates data collection and optimiser steps until the budget is spent."""
        self._pretrain_text()
        if self.stop.requested:
            return
        with self.collecting():
            self._imitation.collect_first()
        if not self.counters.begun_at:
            with self.errors_located():
                self._pretrain_geometry()
            self.counters.begun_at = self.progress()
        self.optimise()

    def step(self) -> StepResult:
        counters, done = self.counters, self.progress()
        if counters.updates % self._recipe.collect_every == 0:
            with self.collecting():
                self._imitation.collect_more(done)
        result = self._imitation.step((self.progress() - counters.begun_at) / (1 - counters.begun_at))
        counters.updates += 1
        counters.states += result.states
        return result

    def _pretrain_geometry(self) -> None:
        imitation, updates = self._imitation, GEOMETRY_UPDATES * self.counters.updates
        heads = imitation.network.scatter
        if heads is None or not updates:
            return
        geometry = GeometryPretraining(heads.geometry, imitation.policy.table, self._recipe.warmup, imitation.rng)
        for update in range(updates):
            geometry.step(update / updates)

    def _pretrain_text(self) -> None:
        fraction = self._recipe.pretraining
        if self._teacher is not None or self.progress() >= fraction:
            return
        text = TextPretraining(
            self._imitation.network,
            self._tokenizer,
            self._imitation.entries,
            self._settings.appearance,
            self._excluded,
            self._recipe,
            self._seed,
        )

        def step() -> float:
            loss = text.step(self.progress() / fraction)
            self.counters.updates += 1
            return loss

        self.optimise(step, lambda recent: self._line(text=round(float(np.mean(recent)), 4)), fraction)

    # Files

    def progress_line(self, recent: Sequence[StepResult]) -> Progress:
        truth, actions, truth_accuracy, _ = np.mean(recent, axis=0).round(4).tolist()
        return self._line(truth=truth, actions=actions, truth_accuracy=truth_accuracy)

    def _line(self, **losses: float) -> Progress:
        counters = self.counters
        return Progress(
            updates=counters.updates,
            states=counters.states,
            cpu_seconds=round(self.seconds(), 1),
            collection_seconds=round(counters.collection_seconds, 1),
            sets=self._imitation.collector.expert_queries,
            **losses,
        )

    def state(self) -> dict[str, Any]:
        return self._imitation.state()

    def restore(self, state: dict[str, Any]) -> None:
        self._imitation.restore(state, np.random.default_rng([self._seed, self.counters.updates]))

    def finish(self) -> ImitationAgent:
        """Tunes the stop rules on the held-out statements, and saves the agent."""
        imitation = self._imitation
        rules: dict[str, StopRule] = {}
        accuracies: dict[str, float | None] = {}
        for name, tasks in self._held_out_tasks.items():
            rules[name], accuracies[name] = StopRule(never_first=CONFIGURATIONS[name][1] == FLIPIT), None
            if tasks:
                chosen = tasks[:: max(1, len(tasks) // MAX_STOP_RULE_TASKS)]
                rules[name], accuracies[name] = tune_stop_rule(imitation.policy, self._dynamics, chosen, imitation.rng)
        corpus = self._settings.corpus
        details = {
            "network": self._architecture,
            "stop_rules": {name: asdict(rule) for name, rule in rules.items()},
            "corpus": corpus,
            "seed": self._seed,
            "updates": self.counters.updates,
            "states": self.counters.states,
            **self.statistics(),
            "held_out_tasks": {name: len(tasks) for name, tasks in self._held_out_tasks.items()},
            "held_out_accuracy": accuracies,
        }
        supervision = f"programs of train statements (corpus {corpus}): truth of scenes, optimal actions"
        if isinstance(imitation.collector, TaughtCollector):
            played = imitation.collector.played
            details |= {"stops": played.stops, "steps": played.steps}
            supervision = f"rewards; search that knows the rules of editing, imitated (corpus {corpus})"
        elif self._recipe.pretraining:
            supervision += "; their programs and those of generated statements (pretraining)"
        description = ModelDescription(KIND, VERSION, tuple(rules), supervision, self._recipe.to_json(), details)
        self.files.save_agent(description, imitation.network.state_dict())
        return ImitationAgent(imitation.network.eval(), rules, description)


def _tasks_of(tasks: Iterable[Task], entries: Sequence[DatasetEntry]) -> list[Task]:
    statements = {entry.statement for entry in entries}
    return [task for task in tasks if task.statement in statements]
