"""Training of a reward model: data collection, optimisation, checkpoints."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, Unpack

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812
from torch import Tensor
from torch.optim.swa_utils import get_ema_multi_avg_fn

from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.learning.common.labelled_scenes import Collector, LabelledStatement, entries_of, sample_scenes
from lilgym_mp.learning.common.optimisation import cosine_decay, optimise
from lilgym_mp.learning.common.run import Budget, Counters, Session, TrainingRun, training
from lilgym_mp.learning.common.run_directory import TrainingRunError
from lilgym_mp.learning.common.tasks import choose_held_out, train_tasks
from lilgym_mp.learning.common.words import vocabulary_of
from lilgym_mp.learning.reward_model.agent import RewardModelAgent, make_network
from lilgym_mp.learning.reward_model.features import BoxTable, Columns, InputReader
from lilgym_mp.learning.reward_model.learner import RewardModelRecipe
from lilgym_mp.learning.reward_model.network import ModulatedNetwork
from lilgym_mp.learning.reward_model.search import SearchPlanner
from lilgym_mp.scene import Scene
from lilgym_mp.scene.arrays import AnyDict, Float64Array, Int64Array

ENTRIES_PER_COLLECTION = 16
STOPS_PER_COLLECTION = 10  # for each of them
SEARCHES_PER_COLLECTION = 4
SEARCH_AFTER = 0.25  # fraction of the budget after which searched scenes are collected
HELD_OUT_STOPS = 150  # per held-out statement
JUDGED = 60  # scenes per held-out statement in a measurement of accuracy
LOWEST_RATE = 0.02  # the last learning rate relative to the peak
WARM_UP = 100  # optimiser steps of linear warm-up; cosine decay follows


class RewardModelProgress(NamedTuple):
    """A line of progress.jsonl; loss and accuracy are means since the last report."""

    updates: int  # optimiser steps
    labels: int  # labelled scenes trained on so far
    stops: int  # episodes played to label scenes, with those of held-out statements
    steps: int  # environment steps of these episodes
    cpu_seconds: float  # CPU time of the whole run
    loss: float
    accuracy: float
    held_out_accuracy: float | None  # of the averaged network, on balanced pairs of scenes one edit apart

    @property
    def note(self) -> str:
        """Labelled stops, loss and accuracies, for the line in the terminal."""
        held_out = self.held_out_accuracy
        known = "" if held_out is None else f", held out {100 * held_out:.1f} %"
        return f"{self.stops:,} stops, loss {self.loss:.2f}, truth {100 * self.accuracy:.1f} %{known}"


@dataclass
class RewardModelCounters(Counters):
    """Counts of a reward model's run."""

    labels: int = 0  # labelled scenes trained on


class RewardModelRun(TrainingRun):
    """Trains a reward model.

    The budget is `updates` of the optimiser, or `minutes` of CPU time, everything included, whichever is spent first;
    with `updates` alone equal arguments give equal agents. `out`, signals and errors as for PPO, but an interrupted run
    saves no agent.
    """

    def __init__(
        self,
        settings: EnvConfig,
        recipe: RewardModelRecipe,
        out: Path,
        *,
        updates: int | None = None,
        minutes: float | None = None,
        seed: int = 0,
        **session: Unpack[Session],
    ) -> None:
        if session.get("device") == "cuda":
            raise ValueError("a reward model is small, and its search runs on the CPU: choose device auto or cpu")
        super().__init__(out, Budget("updates", updates, minutes), {**session, "device": "cpu"})
        self.counters: RewardModelCounters = RewardModelCounters()
        self._settings = settings
        self._recipe = recipe
        self._seed = seed
        played = train_tasks(settings)
        self._configurations = tuple(played)
        identity = {
            "learner": RewardModelAgent.kind,
            "environment": settings.to_json(),
            "recipe": recipe.to_json(),
            "seed": seed,
            "tasks_sha256": played[settings.configuration].provenance.sha256,
        }
        self.begin(identity)
        entries = entries_of(list(played.values()))
        held_out = choose_held_out([entry.statement for entry in entries], recipe.held_out)
        self._entries = [entry for entry in entries if entry.statement not in held_out]
        self._held_out = [entry for entry in entries if entry.statement in held_out]
        self._rng = np.random.default_rng(seed)
        self._table = BoxTable(settings.appearance)
        self._collector = Collector(settings.dynamics(), self._table, self._rng)
        self._lost_stops = 0  # those before the run was resumed, whose scenes are not in the data
        vocabulary = vocabulary_of(entry.statement for entry in self._entries)
        self._reader = InputReader(vocabulary, self._table, self.device)
        # the search begins new tables as it goes
        self._search_reader = InputReader(vocabulary, BoxTable(settings.appearance), self.device)
        torch.manual_seed(seed)
        self._network = make_network(recipe, vocabulary, settings.appearance).to(self.device)
        self._averaged = copy.deepcopy(self._network).eval().requires_grad_(requires_grad=False)
        self._optimiser = torch.optim.AdamW(
            self._network.parameters(), recipe.learning_rate, weight_decay=recipe.weight_decay, fused=True
        )
        self.parts = {"network": self._network, "averaged": self._averaged, "optimiser": self._optimiser}
        self.load()

    # Training

    def learn(self) -> None:
        """Collects the first data, then alternates optimiser steps and data collection until the budget is spent."""
        self._collect_first()
        self.optimise()

    def step(self) -> tuple[float, float]:
        """One optimiser step, after a collection if one is due. Returns the loss and the accuracy."""
        recipe = self._recipe
        rng = self._rng
        if (self._collector.stops - self._lost_stops) * recipe.reuse < self.counters.labels:
            self._collect_more()
        chosen = rng.choice(len(self._entries), recipe.statements, replace=len(self._entries) < recipe.statements)
        entries = [self._entries[index] for index in chosen.tolist()]
        indices = [sample_scenes(entry, recipe.scenes, recipe.paired, rng) for entry in entries]
        kinds = [self._random_kind(entry.statement) for entry in entries]
        turn = self.counters.updates
        network = self._network.train()
        columns = self._reader.statements([entry.statement for entry in entries], kinds, recipe.unknown_words, rng)
        logits, truths = self._judged(network, columns, entries, indices)
        loss = F.binary_cross_entropy_with_logits(logits, truths)
        relative_rate = min(1.0, (turn + 1) / WARM_UP) * cosine_decay(self.progress(), LOWEST_RATE)
        optimise(self._optimiser, loss, 1.0, recipe.learning_rate * relative_rate)
        self.counters.updates += 1
        self.counters.labels += truths.numel()
        decay = min(recipe.averaging, (2 + turn) / (11 + turn))
        averaged: list[Any] = [*self._averaged.parameters()]
        get_ema_multi_avg_fn(decay)(averaged, [*network.parameters()], turn)
        return loss.item(), _accuracy(logits, truths)

    def _judged(
        self,
        network: ModulatedNetwork,
        columns: Columns,
        entries: Sequence[LabelledStatement],
        indices: Sequence[Int64Array],
    ) -> tuple[Tensor, Tensor]:
        """(S, N) logits, and truths 0.0 or 1.0, of these scenes of the entries."""
        rows = [(entry, row.tolist()) for entry, row in zip(entries, indices, strict=True)]
        scenes = np.array([[entry.scenes[at] for at in row] for entry, row in rows])
        truths = np.array([[entry.truths[at] for at in row] for entry, row in rows], np.float32)
        features, local = self._reader.scenes(scenes)
        logits = network(network.read(*columns), features, local)
        return logits, torch.from_numpy(truths).to(self.device)

    @torch.inference_mode()
    def _held_out_accuracy(self) -> float | None:
        entries = [entry for entry in self._held_out if entry.pairs]
        if not entries:
            return None
        rng = np.random.default_rng(0)
        indices = [sample_scenes(entry, JUDGED, 1.0, rng) for entry in entries]
        kinds = [self._reader.kinds(entry.statement)[0] for entry in entries]
        columns = self._reader.statements([entry.statement for entry in entries], kinds)
        logits, truths = self._judged(self._averaged, columns, entries, indices)
        return _accuracy(logits, truths)

    # Data collection

    def _collect_first(self) -> None:
        for entry in self._entries:
            self._collector.explore(entry, self._recipe.first_stops)
        for entry in self._held_out:
            self._collector.explore(entry, min(HELD_OUT_STOPS, 3 * self._recipe.first_stops))
        if not any(entry.pairs for entry in self._entries):
            raise TrainingRunError("nothing to learn: no edit changed the reward of a STOP")

    def _collect_more(self) -> None:
        rng = self._rng
        recipe = self._recipe
        chosen = rng.integers(len(self._entries), size=ENTRIES_PER_COLLECTION).tolist()
        entries = [self._entries[index] for index in chosen]
        if self.progress() < SEARCH_AFTER or rng.random() >= recipe.searching:
            for entry in entries:
                self._collector.explore(entry, STOPS_PER_COLLECTION)
        elif rng.random() < 0.5:
            self._climb(entries)
        else:
            for entry in entries[:SEARCHES_PER_COLLECTION]:
                self._search(entry)

    @torch.inference_mode()
    def _climb(self, entries: Sequence[LabelledStatement]) -> None:
        """Walks of the edits that the averaged model likes best."""
        reader = self._search_reader
        table = reader.renewed_table()
        kinds = [self._random_kind(entry.statement) for entry in entries]
        reading = self._averaged.read(*reader.statements([entry.statement for entry in entries], kinds))

        def judge(scenes: Sequence[Sequence[Scene]]) -> Float64Array:
            features, local = reader.scenes(np.array([[table.of(scene) for scene in row] for row in scenes]))
            return self._averaged(reading, features, local).double().numpy()

        self._collector.climb(entries, judge)

    def _random_kind(self, statement: str) -> int:
        kinds = self._reader.kinds(statement)
        return kinds[self._rng.integers(len(kinds))]

    def _search(self, entry: LabelledStatement) -> None:
        """Stops in the scene that the averaged model likes best for a random truth value, and in those on the way."""
        task_index = entry.random_task(self._rng)
        recipe = replace(self._recipe, averaged_exchanges=1)
        planner = SearchPlanner(self._averaged, self._search_reader, self._settings.dynamics(), recipe, is_flipit=False)
        target = bool(self._rng.integers(2))
        start = entry.tasks[task_index].start
        index = self._collector.stop(entry, task_index, start, 0)
        plan = planner.plan(start, entry.statement, target, entry.paths[index].edits)
        self._collector.follow(entry, index, plan.actions)

    # Files

    def progress_line(self, recent: Sequence[tuple[float, float]]) -> RewardModelProgress:
        counters = self.counters
        collector = self._collector
        loss, accuracy = np.mean(recent, axis=0).round(4).tolist()
        held_out = self._held_out_accuracy()
        return RewardModelProgress(
            counters.updates,
            counters.labels,
            collector.stops,
            collector.steps,
            round(self.seconds(), 1),
            loss,
            accuracy,
            None if held_out is None else round(held_out, 4),
        )

    def state(self) -> AnyDict:
        """For a checkpoint. The labelled scenes are not part of it: a resumed run collects scenes again."""
        return {**super().state(), "played": [self._collector.stops, self._collector.steps]}

    def restore(self, state: AnyDict) -> None:
        super().restore(state)
        self._collector.stops, self._collector.steps = state["played"]
        self._lost_stops = self._collector.stops
        self._rng = self._collector.rng = np.random.default_rng([self._seed, self.counters.updates])

    def finish(self) -> RewardModelAgent:
        """The averaged network as an agent."""
        corpus = self._settings.corpus
        vocabulary = self._reader.vocabulary
        supervision = f"rewards; knows the rules of editing (corpus {corpus})"
        details = {
            "vocabulary": list(vocabulary.words),
            "corpus": corpus,
            "seed": self._seed,
            "updates": self.counters.updates,
            "steps": self._collector.steps,
            "stops": self._collector.stops,
            "labels": self.counters.labels,
            "cpu_minutes": self.minutes(),
            "held_out_accuracy": self._held_out_accuracy(),
        }
        recipe = self._recipe
        description = RewardModelAgent.describe(self._configurations, supervision, recipe.to_json(), details)
        return RewardModelAgent(description, recipe, self._averaged.cpu(), vocabulary, self._settings.appearance)


train_reward_model = training(RewardModelRun)


def _accuracy(logits: Tensor, truths: Tensor) -> float:
    return float(((logits > 0) == (truths > 0.5)).float().mean())
