"""Training of the parser on statement-program pairs from a corpus and the generator."""

from __future__ import annotations

import hashlib
import math
import random
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import torch
from torch import nn
from torch.nn import functional

from lilgym_mp.corpus import NoTasksError, load_all_tasks
from lilgym_mp.corpus.held_out import digests_sha256, held_out_digests, statement_digest
from lilgym_mp.corpus.records import FLIPIT
from lilgym_mp.corpus.spelling import plain_words
from lilgym_mp.evaluation import CONFIGURATIONS, Settings
from lilgym_mp.generator.training_pairs import training_pairs
from lilgym_mp.learning.devices import select_device
from lilgym_mp.learning.interrupts import StopRequest, stop_on_signals
from lilgym_mp.learning.model_file import ModelDescription
from lilgym_mp.learning.parsing import batches
from lilgym_mp.learning.parsing.calibration import Forecast, fit_calibration
from lilgym_mp.learning.parsing.network import ParserNetwork, Sizes
from lilgym_mp.learning.parsing.pairs import APPEARANCE_WORDS, Pair, Variations
from lilgym_mp.learning.parsing.parser import UNKNOWN, Parser, tensors_of, truths
from lilgym_mp.learning.parsing.planning import Planner
from lilgym_mp.learning.parsing.recipe import ParserRecipe
from lilgym_mp.learning.parsing.symbols import COLOURS, TOKENS, SymbolTable
from lilgym_mp.learning.training_run import TrainingError, TrainingRun, begin_run
from lilgym_mp.rules import Outcome

KIND = "parse-and-plan"
VERSION = 1
MIN_WORD_COUNT = 2  # rarer words are not in the vocabulary
REPORT_EVERY = 50  # steps
TEMPERATURES = tuple(0.6 + 0.1 * step for step in range(20))
MAX_STARTS = 2  # start scenes planned from per held-out statement and target, for calibration
MIN_PROBABILITY = 1e-4  # probability of the correct program if the beam misses it


class Progress(NamedTuple):
    """A line of progress.jsonl."""

    step: int
    steps: int  # steps of the whole training
    loss: float  # mean since the last report
    cpu_seconds: float  # CPU time of this process since training began, including data preparation


class TrainingData(NamedTuple):
    """Training and held-out data."""

    corpus: batches.ExamplePool
    generated: batches.ExamplePool
    held_out: Sequence[batches.Example]
    vocabulary: SymbolTable
    sha256: str  # checksum of the corpus's statements and programs
    held_out_sha256: str  # checksum of the digests of the dev and test statements that are not generated


def train_parser(
    corpus: str,
    recipe: ParserRecipe,
    out: Path,
    *,
    device: str = "auto",
    resume: bool = False,
    save_every: int = 500,
    on_progress: Callable[[Progress], object] = lambda progress: None,
) -> TrainingRun:
    """Trains one parser for all appearances in the corpus, and saves its agent in `out`.

    Ctrl-C stops after the current step and saves a checkpoint; `resume` continues from the last one. Equal corpus,
    recipe and number of threads give equal agents; a resumed run draws different random numbers.
    Raises TrainingRunError for an unusable directory, CorpusError for an unusable corpus, TrainingError when the loss
    is not finite; the last checkpoint is kept.
    """
    start_cpu_seconds = time.process_time()
    torch_device = select_device(device)
    data = load_training_data(corpus, recipe)
    identity = {
        "learner": KIND,
        "corpus": corpus,
        "corpus_sha256": data.sha256,
        "held_out_sha256": data.held_out_sha256,
        "recipe": asdict(recipe),
    }
    run = begin_run(out, identity, resume=resume)
    torch.manual_seed(recipe.seed)
    sizes = Sizes(width=recipe.width, hidden=3 * recipe.width)
    network = ParserNetwork(len(data.vocabulary), len(TOKENS), sizes, recipe.dropout).to(torch_device)
    trainer = _Trainer(network, recipe, data, torch_device)
    if resume and run.has_checkpoint:
        trainer.restore(run)
    earlier = trainer.cpu_seconds
    losses: list[float] = []
    with stop_on_signals() as stop:
        while trainer.step < recipe.steps and not stop.requested:
            losses.append(trainer.train_step(run))
            trainer.cpu_seconds = earlier + time.process_time() - start_cpu_seconds
            if trainer.step % REPORT_EVERY == 0:
                progress = Progress(trainer.step, recipe.steps, sum(losses) / len(losses), trainer.cpu_seconds)
                losses.clear()
                run.record(progress._asdict())
                on_progress(progress)
            if trainer.step % save_every == 0:
                run.save_checkpoint(trainer.state())
        run.save_checkpoint(trainer.state())
        if trainer.step == recipe.steps:
            _finish(run, trainer, data, corpus, stop)
    return run


def _finish(run: TrainingRun, trainer: _Trainer, data: TrainingData, corpus: str, stop: StopRequest) -> None:
    """Calibrates the parser and saves the agent."""
    parser = Parser(trainer.network.eval(), data.vocabulary)
    parser.temperature = calibrated_temperature(parser, data.held_out)
    coverage = beam_coverage(parser, data.held_out)
    calibration = fit_calibration(forecasts(parser, corpus, data.held_out, trainer.recipe.objective))
    configurations = tuple(
        name for name, (appearance, _) in CONFIGURATIONS.items() if appearance in data.corpus.appearances
    )
    generated = ", generated statements" if data.generated else ""
    description = ModelDescription(
        KIND,
        VERSION,
        configurations,
        f"programs of train statements ({corpus}){generated}",
        {"corpus": corpus, **run.identity["recipe"]},
        {
            **parser.to_details(),
            "coverage": coverage,
            "calibration": asdict(calibration),
            "cpu_seconds": round(trainer.cpu_seconds, 1),
        },
    )
    run.save_agent(description, tensors_of(parser))


def load_training_data(corpus: str, recipe: ParserRecipe) -> TrainingData:
    """Splits off the held-out examples, generates further ones and collects the vocabulary."""
    examples = corpus_examples(corpus)
    digest = hashlib.sha256(repr(examples).encode()).hexdigest()
    shuffled = random.Random(f"held out {recipe.seed}").sample(examples, len(examples))
    held_out = shuffled[: min(recipe.held_out, len(examples) // 5)]
    kept = shuffled[len(held_out) :]
    rng = random.Random(f"generated {recipe.seed}")
    excluded = held_out_digests(corpus)
    generated = list(_generated(recipe, sorted({example.appearance for example in examples}), excluded, rng))
    counts = Counter(word for example in (*kept, *generated) for word in plain_words(example.statement))
    known = frozenset([*(word for word, count in counts.items() if count >= MIN_WORD_COUNT), *COLOURS])
    vocabulary = SymbolTable((*sorted({*known, *APPEARANCE_WORDS.values()}), UNKNOWN))
    pools = batches.ExamplePool(kept, known), batches.ExamplePool(generated, known)
    return TrainingData(*pools, held_out, vocabulary, digest, digests_sha256(excluded))


def corpus_examples(corpus: str) -> list[batches.Example]:
    """The distinct training examples of the corpus."""
    found: dict[batches.Example, None] = {}
    for tasks in load_all_tasks(corpus, splits=("train",)):
        appearance = tasks.provenance.appearance
        found |= dict.fromkeys(batches.Example(task.statement, task.program, appearance) for task in tasks)
    return list(found)


def _generated(
    recipe: ParserRecipe, appearances: Sequence[str], excluded: Collection[str], rng: random.Random
) -> Iterator[batches.Example]:
    needed = int(recipe.generated * (1 + batches.FINAL_GENERATED) / 2 * recipe.steps * recipe.batch_size)
    count = min(recipe.generated_pairs, needed) // len(appearances)
    for appearance in appearances:
        pairs = islice(training_pairs(appearance, rng.getrandbits(32)), count)
        yield from (
            batches.Example(pair.statement, pair.program, appearance)
            for pair in pairs
            if statement_digest(pair.statement) not in excluded
        )


class _Trainer:
    """Network, optimiser and training state."""

    def __init__(self, network: ParserNetwork, recipe: ParserRecipe, data: TrainingData, device: torch.device) -> None:
        self.network = network
        self.recipe = recipe
        self.step = 0
        self.cpu_seconds = 0.0
        self._data = data
        self._device = device
        self._optimiser = torch.optim.AdamW(
            network.parameters(), lr=recipe.learning_rate, weight_decay=recipe.weight_decay, fused=True
        )
        self._rng = random.Random(f"batches {recipe.seed}")
        self._batches = self._drawn()

    def train_step(self, run: TrainingRun) -> float:
        """One optimiser step; returns the loss. Raises TrainingError when it is not finite."""
        self.network.train()
        for group in self._optimiser.param_groups:
            group["lr"] = self.recipe.learning_rate * self._schedule()
        words, tokens, slots = next(self._batches)
        logits = self.network(words, tokens, slots)
        loss = functional.cross_entropy(
            logits.flatten(0, 1), tokens.flatten(), ignore_index=0, label_smoothing=self.recipe.smoothing
        )
        value = loss.item()
        if not math.isfinite(value):
            kept = f"the last checkpoint is kept in {run.path}" if run.has_checkpoint else "nothing was saved yet"
            raise TrainingError(f"the loss is {value} at step {self.step + 1}; {kept}; try a lower learning rate")
        self._optimiser.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)
        self._optimiser.step()
        self.step += 1
        return value

    def _schedule(self) -> float:
        """The learning rate relative to its peak: linear warm-up times cosine decay."""
        decay = 0.5 * (1 + math.cos(math.pi * self.step / self.recipe.steps))
        return decay * min(1.0, (self.step + 1) / self.recipe.warm_up)

    def _generated_fraction(self) -> float:
        return batches.generated_fraction(self.recipe.generated, self.step / self.recipe.steps)

    def _drawn(self) -> Iterator[batches.Batch]:
        recipe, data = self.recipe, self._data
        variations = Variations(recipe.shapes, recipe.numbers)
        sources = batches.PairSources(data.corpus, data.generated if len(data.generated) else None)
        return batches.sample_batches(
            sources, self._generated_fraction, variations, self._indices, recipe.batch_size, self._rng, self._device
        )

    def _indices(self, pair: Pair) -> tuple[list[int], list[int]]:
        vocabulary, rng = self._data.vocabulary, self._rng
        unknown = vocabulary.index(UNKNOWN)
        words = [
            unknown if position and rng.random() < self.recipe.unknown else vocabulary.index(word, unknown)
            for position, word in enumerate(pair.words)
        ]
        return words, [TOKENS.index(token) for token in pair.tokens]

    def state(self) -> dict[str, Any]:
        return {
            "network": self.network.state_dict(),
            "optimiser": self._optimiser.state_dict(),
            "step": self.step,
            "cpu_seconds": self.cpu_seconds,
        }

    def restore(self, run: TrainingRun) -> None:
        """Restores the run's checkpoint. Raises TrainingRunError."""
        with run.checkpoint() as state:
            self.network.load_state_dict(state["network"])
            self._optimiser.load_state_dict(state["optimiser"])
            self.step, self.cpu_seconds = int(state["step"]), float(state["cpu_seconds"])
        self._rng.seed(f"batches {self.recipe.seed} {self.step}")


# Calibration on held-out statements


def calibrated_temperature(parser: Parser, examples: Sequence[batches.Example]) -> float:
    """The temperature that maximises the likelihood of the examples' programs; 1 without examples."""
    if not examples:
        return 1.0
    predictions = [_candidate_probabilities(parser, example) for example in examples]
    scores = {
        temperature: sum(
            math.log(max(MIN_PROBABILITY, _tempered(*prediction, temperature))) for prediction in predictions
        )
        for temperature in TEMPERATURES
    }
    return max(scores, key=lambda temperature: scores[temperature])


def _candidate_probabilities(parser: Parser, example: batches.Example) -> tuple[list[float], int | None]:
    """The candidates' probabilities, and the index of the one equivalent to the example's program."""
    candidates = parser.parse(example.statement, example.appearance).candidates
    right = truths(example.program, example.appearance)
    correct = [index for index, found in enumerate(candidates) if truths(found.program, example.appearance) == right]
    return [candidate.probability for candidate in candidates], correct[0] if correct else None


def _tempered(probabilities: Sequence[float], index: int | None, temperature: float) -> float:
    """The probability at `index` after scaling by the temperature; 0 for None."""
    if index is None:
        return 0.0
    powers = [probability ** (1 / temperature) for probability in probabilities]
    return powers[index] / sum(powers)


def beam_coverage(parser: Parser, examples: Sequence[batches.Example]) -> float:
    """The fraction of examples with a correct program among the candidates; 1 without examples."""
    if not examples:
        return 1.0
    return sum(_candidate_probabilities(parser, example)[1] is not None for example in examples) / len(examples)


def forecasts(parser: Parser, corpus: str, examples: Sequence[batches.Example], objective: str) -> list[Forecast]:
    """Uncalibrated success probabilities and outcomes of plans for the examples' training tasks."""
    held_out = {(example.statement, example.appearance) for example in examples}
    found: list[Forecast] = []
    for name, (appearance, _) in CONFIGURATIONS.items():
        settings = Settings(name, corpus=corpus)
        try:
            tasks = settings.make("train").tasks
        except NoTasksError:
            continue
        planner = Planner(parser, settings.dynamics(), settings.start == FLIPIT, objective=objective)
        planned = Counter[tuple[str, bool]]()
        for task in tasks:
            planned[task.statement, task.target] += (task.statement, appearance) in held_out
            if 0 < planned[task.statement, task.target] <= MAX_STARTS and (task.statement, appearance) in held_out:
                plan = planner.plan(task.start, task.statement, task.target)
                success = planner.outcome(plan, task) is Outcome.SUCCESS
                found.append(Forecast(plan.success_probability, success))
    return found
