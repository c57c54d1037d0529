"""Training of the parser on statement-program pairs from a corpus and the generator."""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from random import Random
from typing import NamedTuple, Unpack

import torch

from lilgym_mp.corpus import NoTasksError, load_all_tasks
from lilgym_mp.corpus.held_out import digests_sha256, held_out_digests
from lilgym_mp.corpus.records import FLIPIT
from lilgym_mp.corpus.spelling import plain_words
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.envs.rules import Outcome
from lilgym_mp.evaluation import CONFIGURATIONS
from lilgym_mp.evaluation.files import writable_directory
from lilgym_mp.learning.common.optimisation import cosine_decay
from lilgym_mp.learning.common.program_batches import (
    FINAL_GENERATED,
    Example,
    ExamplePool,
    ProgramTrainer,
    generated_examples,
)
from lilgym_mp.learning.common.program_network import ParserNetwork, Sizes
from lilgym_mp.learning.common.program_pairs import APPEARANCE_WORDS, COLOURS, TOKENS, Pair, SymbolTable
from lilgym_mp.learning.common.run import Budget, Counters, Session, TrainingRun, training
from lilgym_mp.learning.parsing.agent import ParseAndPlanAgent
from lilgym_mp.learning.parsing.learner import ParserRecipe
from lilgym_mp.learning.parsing.parser import UNKNOWN, Parser, truths
from lilgym_mp.learning.parsing.planning import ProgramPlanner, fit_calibration
from lilgym_mp.scene.arrays import AnyDict

MIN_WORD_COUNT = 2  # rarer words are not in the vocabulary
TEMPERATURES = tuple(0.6 + 0.1 * step for step in range(20))
MAX_STARTS = 2  # start scenes planned from per held-out statement and target, for calibration
MIN_PROBABILITY = 1e-4  # probability of the correct program if the beam misses it


class ParserProgress(NamedTuple):
    """A line of progress.jsonl."""

    updates: int
    loss: float  # mean since the last report
    cpu_seconds: float  # CPU time of this process since training began, including data preparation

    @property
    def note(self) -> str:
        """Loss and CPU time, for the line in the terminal."""
        return f"loss {self.loss:.3f}, {self.cpu_seconds / 60:.1f} CPU minutes"


class TrainingData(NamedTuple):
    """Training and held-out data."""

    corpus: ExamplePool
    generated: ExamplePool
    held_out: Sequence[Example]
    vocabulary: SymbolTable
    sha256: str  # checksum of the corpus's statements and programs
    held_out_sha256: str  # checksum of the digests of the dev and test statements that are not generated


def load_training_data(corpus: str, recipe: ParserRecipe) -> TrainingData:
    """Splits off the held-out examples, generates further ones and collects the vocabulary."""
    examples = corpus_examples(corpus)
    digest = hashlib.sha256(repr(examples).encode()).hexdigest()
    shuffled = Random(f"held out {recipe.seed}").sample(examples, len(examples))
    held_out = shuffled[: min(recipe.held_out, len(examples) // 5)]
    kept = shuffled[len(held_out) :]
    rng = Random(f"generated {recipe.seed}")
    excluded = held_out_digests(corpus)
    needed = int(recipe.generated * (1 + FINAL_GENERATED) / 2 * recipe.updates * recipe.batch_size)
    appearances = sorted({example.appearance for example in examples})
    most = min(recipe.generated_pairs, needed) // len(appearances)
    generated: list[Example] = []
    for appearance in appearances:
        generated += generated_examples(appearance, rng.getrandbits(32), excluded, most)
    counts = Counter(word for example in (*kept, *generated) for word in plain_words(example.statement))
    known = frozenset([*(word for word, count in counts.items() if count >= MIN_WORD_COUNT), *COLOURS])
    vocabulary = SymbolTable((*sorted({*known, *APPEARANCE_WORDS.values()}), UNKNOWN))
    pools = ExamplePool(kept, known), ExamplePool(generated, known)
    return TrainingData(*pools, held_out, vocabulary, digest, digests_sha256(excluded))


def corpus_examples(corpus: str) -> list[Example]:
    """The distinct training examples of the corpus."""
    found: dict[Example, None] = {}
    for tasks in load_all_tasks(corpus, splits=("train",)):
        appearance = tasks.provenance.appearance
        found |= dict.fromkeys(Example(task.statement, task.program, appearance) for task in tasks)
    return list(found)


class ParserRun(TrainingRun):
    """Trains one parser for all appearances in a corpus.

    Equal corpus, recipe and number of threads give equal agents; a resumed run draws different random numbers. `out`,
    signals and errors as for PPO, but an interrupted run saves no agent.
    """

    def __init__(self, corpus: str, recipe: ParserRecipe, out: Path, **session: Unpack[Session]) -> None:
        super().__init__(out, Budget("updates", recipe.updates), session)
        self.counters = Counters()
        self._corpus = corpus
        self._recipe = recipe
        if not self.resume:
            writable_directory(out)  # before the data takes its time
        self._data = data = load_training_data(corpus, recipe)
        identity = {
            "learner": ParseAndPlanAgent.kind,
            "corpus": corpus,
            "corpus_sha256": data.sha256,
            "held_out_sha256": data.held_out_sha256,
            "recipe": recipe.to_json(),
        }
        self.begin(identity)
        torch.manual_seed(recipe.seed)
        sizes = Sizes(width=recipe.width, hidden=3 * recipe.width)
        self._network = ParserNetwork(len(data.vocabulary), len(TOKENS), sizes, recipe.dropout).to(self.device)
        self._rng = Random(f"batches {recipe.seed}")
        generated = data.generated.sample if len(data.generated) else None
        self._trainer = ProgramTrainer(self._network, recipe, data.corpus.sample, generated, self._indices, self._rng)
        self.parts = {"network": self._network, "optimiser": self._trainer.optimiser}
        self.load()

    def step(self) -> float:
        """One optimiser step; returns the loss. Raises TrainingRunError."""
        done = self.progress()
        counters = self.counters
        relative_rate = cosine_decay(done) * min(1.0, (counters.updates + 1) / self._recipe.warm_up)
        loss = self._trainer.step(done, self._recipe.learning_rate * relative_rate)
        counters.updates += 1
        return loss

    def _indices(self, pair: Pair) -> tuple[list[int], list[int]]:
        vocabulary = self._data.vocabulary
        rng = self._rng
        unknown = vocabulary.index(UNKNOWN)
        words = [
            unknown if position and rng.random() < self._recipe.unknown else vocabulary.index(word, unknown)
            for position, word in enumerate(pair.words)
        ]
        return words, [TOKENS.index(token) for token in pair.tokens]

    def progress_line(self, recent: Sequence[float]) -> ParserProgress:
        return ParserProgress(self.counters.updates, sum(recent) / len(recent), self.seconds())

    def restore(self, state: AnyDict) -> None:
        super().restore(state)
        self._rng.seed(f"batches {self._recipe.seed} {self.counters.updates}")

    def finish(self) -> ParseAndPlanAgent:
        """The agent, with its parser calibrated."""
        data = self._data
        recipe = self._recipe
        corpus = self._corpus
        uncalibrated = Parser(self._network.eval(), data.vocabulary)
        predictions = [_prediction(uncalibrated, example) for example in data.held_out]
        parser = Parser(self._network, data.vocabulary, calibrated_temperature(predictions))
        calibration = fit_calibration(forecasts(parser, corpus, data.held_out))
        appearances = data.corpus.appearances
        configurations = tuple(name for name, (appearance, _) in CONFIGURATIONS.items() if appearance in appearances)
        supervision = f"programs of train statements ({corpus}){', generated statements' if data.generated else ''}"
        details = {
            **parser.to_details(),
            "calibration": asdict(calibration),
            "cpu_seconds": round(self.seconds(), 1),
        }
        recorded = {"corpus": corpus, **recipe.to_json()}
        description = ParseAndPlanAgent.describe(configurations, supervision, recorded, details)
        return ParseAndPlanAgent(description, parser)


train_parser = training(ParserRun)


# Calibration on held-out statements


def _prediction(parser: Parser, example: Example) -> tuple[list[float], int | None]:
    """The candidates' probabilities, and the index of the one equivalent to the example's program."""
    candidates = parser.parse(example.statement, example.appearance).candidates
    right = truths(example.program, example.appearance)
    correct = [index for index, found in enumerate(candidates) if truths(found.program, example.appearance) == right]
    return [candidate.probability for candidate in candidates], correct[0] if correct else None


def calibrated_temperature(predictions: Sequence[tuple[list[float], int | None]]) -> float:
    """The temperature that maximises the likelihood of the correct programs; 1 without predictions."""

    def likelihood(temperature: float) -> float:
        total = 0.0
        for probabilities, correct in predictions:
            powers = [probability ** (1 / temperature) for probability in probabilities]
            total += math.log(max(MIN_PROBABILITY, 0.0 if correct is None else powers[correct] / sum(powers)))
        return total

    return max(TEMPERATURES, key=likelihood) if predictions else 1.0


def forecasts(parser: Parser, corpus: str, examples: Sequence[Example]) -> list[tuple[float, bool]]:
    """Uncalibrated success probabilities and outcomes of plans for the examples' training tasks."""
    held_out = {(example.statement, example.appearance) for example in examples}
    found: list[tuple[float, bool]] = []
    for name, (appearance, _) in CONFIGURATIONS.items():
        settings = EnvConfig(name, corpus=corpus)
        try:
            tasks = settings.tasks("train")
        except NoTasksError:
            continue
        planner = ProgramPlanner(parser, settings.dynamics(), settings.start == FLIPIT)
        planned = Counter[tuple[str, bool]]()
        for task in tasks:
            planned[task.statement, task.target] += (task.statement, appearance) in held_out
            if 0 < planned[task.statement, task.target] <= MAX_STARTS and (task.statement, appearance) in held_out:
                plan = planner.plan(task.start, task.statement, task.target)
                found.append((plan.success_probability, planner.outcome(plan, task) is Outcome.SUCCESS))
    return found
