"""A trained parser: from statements to candidate programs with probabilities, by beam search over prefix tokens."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from typing import NamedTuple

import torch
from torch import Tensor

from lilgym_mp.corpus.scene_walks import ScenePool
from lilgym_mp.corpus.spelling import corrections, unread_words
from lilgym_mp.learning.common.model_file import torch_threads
from lilgym_mp.learning.common.program_network import ParserNetwork, Sizes, Slots
from lilgym_mp.learning.common.program_pairs import (
    TOKENS,
    Slot,
    SymbolTable,
    TokenTable,
    exchanged,
    inverse,
    normalise_statement,
    open_slots_of,
    program_of,
)
from lilgym_mp.learning.parsing.doubts import FUNCTION_WORDS, doubts
from lilgym_mp.programs import ProgramError, ProgramRuntimeError, compile_program
from lilgym_mp.programs.prefix import PrefixError
from lilgym_mp.programs.static_types import is_well_typed
from lilgym_mp.scene import Scene
from lilgym_mp.scene.arrays import AnyDict, AnyMapping, Strings

UNKNOWN = "<unknown>"
BEAM_WIDTH = 20
MAX_CANDIDATES = 12
PROBE_SCENES = 160  # candidates that agree on all of these count as equivalent
MIN_ILL_TYPED = 0.1  # fraction of the beam's probability below which ill-typed programs are dropped
MAX_CACHED_STATEMENTS = 4096
UNKNOWN_FACTOR = 1 / 3  # on the candidates' probabilities for each unknown word; docs/agents.md, "Invalid input"


class Candidate(NamedTuple):
    """A program, or the first tokens of one."""

    tokens: tuple[int, ...]
    log_probability: float
    open_slots: tuple[Slot, ...] = ()  # a stack, the next one last; empty if complete


@torch.inference_mode()
def beam_search(
    network: ParserNetwork, words: Sequence[int], width: int, table: TokenTable = TOKENS
) -> list[Candidate]:
    """At most `width` programs of one statement, the most probable first; may be empty."""
    device = network.logits.weight.device
    memories = network.encode(torch.tensor([words], device=device))
    caches: list[list[Tensor]] = [[memory.keys[:, :, :0], memory.values[:, :, :0]] for memory in memories]
    partials = [Candidate((), 0.0, (Slot(0, 0),))]
    done: list[Candidate] = []
    for length in range(network.sizes.longest_program):
        last = [(*(partial.tokens[-1:] or (0,)), *partial.open_slots[-1]) for partial in partials]
        before, *places = torch.tensor(last, device=device).split(1, 1)
        expanded = [memory.expanded(len(partials)) for memory in memories]
        logits = network.decode(expanded, before, Slots(*places), first=length, caches=caches)[:, 0]
        scores = (
            logits.log_softmax(1)
            + torch.tensor([partial.log_probability for partial in partials], device=device)[:, None]
        )
        scores[:, 0] = -torch.inf  # padding is not a token
        values, indices = scores.flatten().topk(min(width, scores.numel()))
        rows = (indices // scores.shape[1]).tolist()
        tokens = (indices % scores.shape[1]).tolist()
        grown: list[tuple[int, Candidate]] = []  # with the row of what each continues
        for value, row, token in zip(values.tolist(), rows, tokens, strict=True):
            if value == -float("inf"):
                continue
            partial = partials[row]
            open_slots = (*partial.open_slots[:-1], *open_slots_of(token, table))
            candidate = Candidate((*partial.tokens, token), value, open_slots)
            if open_slots:
                grown.append((row, candidate))
            else:
                done.append(candidate)
        done.sort(key=lambda candidate: -candidate.log_probability)
        best_done = done[width - 1].log_probability if len(done) >= width else -float("inf")
        alive = [(row, partial) for row, partial in grown if partial.log_probability > best_done]
        if not alive:
            break
        partials = [partial for _, partial in alive]
        order = torch.tensor([row for row, _ in alive], device=device)
        for past in caches:
            past[:] = [part[order] for part in past]
    return done[:width]


class ProgramCandidate(NamedTuple):
    """A possible program of a statement."""

    program: str
    probability: float  # those of all candidates add up to the parse's confidence


@dataclass(frozen=True)
class Parse:
    """The parser's result for a statement."""

    words: Strings  # the appearance word, then the statement with misspellings repaired
    unknown: Strings  # the words outside the vocabulary, with those left out, or a text without words
    corrections: Mapping[str, str]  # misspelt words, in lower case, and what was read for them
    candidates: tuple[ProgramCandidate, ...]  # the most probable first; may be empty
    doubts: Strings = ()  # why the first candidate may be wrong besides unknown words, a line each

    @property
    def is_understood(self) -> bool:
        """Whether a word was read that has a meaning of its own."""
        return not {*self.words[1:]} <= {*self.unknown} | FUNCTION_WORDS

    @property
    def confidence(self) -> float:
        """The probability of all candidates together: UNKNOWN_FACTOR for each unknown word."""
        return UNKNOWN_FACTOR ** len(self.unknown)

    @property
    def known_share(self) -> float:
        """The fraction of known words; 0 for a text without words."""
        return 1 - len(self.unknown) / self._count

    @property
    def _count(self) -> int:
        return max(len(self.words) - 1, len(self.unknown), 1)

    @property
    def uncertain(self) -> Strings:
        """Why the first candidate may be wrong, a line each; empty if nothing says so."""
        if not self.is_understood:
            return ("nothing was understood", *self._unknown_notes())
        return (*self._unknown_notes(), *self.doubts)

    def notes(self) -> list[str]:
        """A line about corrected words and one about unknown words, if there are any."""
        corrected = [
            f"{typed!r} as {read!r}" if read else f"nothing for {typed!r}" for typed, read in self.corrections.items()
        ]
        notes = [f"read {', '.join(corrected)}"] if corrected else []
        return [*notes, *self._unknown_notes()]

    def _unknown_notes(self) -> list[str]:
        listed = ", ".join(map(repr, self.unknown))
        return [f"unknown, {len(self.unknown)} of {self._count} words: {listed}"] if self.unknown else []


@cache
def probe_scenes(appearance: str) -> Sequence[Scene]:
    """Scenes on which programs are compared; identical in every process."""
    rng = random.Random(f"probes {appearance}")
    pool = ScenePool.sample(appearance, rng, 1 + PROBE_SCENES // 8)
    scenes = rng.sample(pool.scenes, min(PROBE_SCENES, len(pool.scenes)))
    return (Scene.empty(), *scenes)


def truths(program: str, appearance: str) -> tuple[bool | None, ...]:
    """The program's truth on the probe scenes; None where it raises an error."""
    evaluate = compile_program(program).evaluate

    def truth(scene: Scene) -> bool | None:
        try:
            return evaluate(scene)
        except ProgramRuntimeError:
            return None

    return tuple(map(truth, probe_scenes(appearance)))


@dataclass
class Parser:
    """A network with its vocabulary."""

    network: ParserNetwork
    vocabulary: SymbolTable
    temperature: float = 1.0  # divides log-probabilities
    tokens: TokenTable = TOKENS

    def __post_init__(self) -> None:
        self._known = frozenset(self.vocabulary.symbols)
        self._parses: dict[tuple[str, str], Parse] = {}

    def parse(self, statement: str, appearance: str) -> Parse:
        """The candidate programs of any text, the most probable first; for an empty one, the most common programs.

        `appearance`: "tower" or "scatter". Words are corrected first (`lilgym_mp.corpus.spelling`), and each word that
        stays unknown multiplies the probabilities by UNKNOWN_FACTOR. Equal texts are parsed once.
        """
        key = statement, appearance
        if key not in self._parses:
            if len(self._parses) >= MAX_CACHED_STATEMENTS:
                self._parses.clear()
            with torch_threads(1):  # networks as small as this run slower on several
                self._parses[key] = self._parse(statement, appearance)
        return self._parses[key]

    def _parse(self, statement: str, appearance: str) -> Parse:
        normalised = normalise_statement(statement, appearance, self._known)
        unknown = self.vocabulary.index(UNKNOWN)
        words = [self.vocabulary.index(word, unknown) for word in normalised.words]
        scores: dict[tuple[bool | None, ...], tuple[str, list[float]]] = {}  # by truth: the most probable program
        found = beam_search(self.network, words, BEAM_WIDTH, self.tokens)
        total = sum(math.exp(candidate.log_probability) for candidate in found)
        for candidate in found:
            try:
                program = program_of([self.tokens.symbol(token) for token in candidate.tokens], normalised.exchange)
            except (PrefixError, ProgramError):
                continue
            well_typed = is_well_typed(compile_program(program).tree)
            if not well_typed and math.exp(candidate.log_probability) < MIN_ILL_TYPED * total:
                continue
            truth_vector = truths(program, appearance)
            if all(truth is None for truth in truth_vector) or (len(set(truth_vector)) == 1 and not well_typed):
                continue
            scores.setdefault(truth_vector, (program, []))[1].append(candidate.log_probability / self.temperature)
        original_words = exchanged(normalised.words, inverse(normalised.exchange))
        unknown_words = [word for word in original_words if word not in self._known]
        unknown_words = unread_words(statement, self._known) + unknown_words
        ranked = _ranked([*scores.values()], UNKNOWN_FACTOR ** len(unknown_words))
        first_truths = next((truth for truth, (program, _) in scores.items() if ranked and program == ranked[0][0]), ())
        unsure = tuple(doubts(statement, original_words[1:], ranked, first_truths))
        return Parse(tuple(original_words), tuple(unknown_words), corrections(statement, self._known), ranked, unsure)

    def to_details(self) -> AnyDict:
        """The part of a model description that `of` reads."""
        return {
            "words": list(self.vocabulary.symbols),
            "tokens": list(self.tokens.symbols),
            "sizes": asdict(self.network.sizes),
            "temperature": self.temperature,
        }

    @classmethod
    def of(cls, details: AnyMapping) -> Parser:
        """A parser with an untrained network. Raises ValueError, TypeError, KeyError."""
        vocabulary = SymbolTable(tuple(details["words"]))
        tokens = TokenTable(tuple(details["tokens"]))
        network = ParserNetwork(len(vocabulary), len(tokens), Sizes(**details["sizes"]))
        return cls(network.eval(), vocabulary, float(details["temperature"]), tokens)


def _ranked(classes: Sequence[tuple[str, Sequence[float]]], probability: float) -> tuple[ProgramCandidate, ...]:
    """The most probable candidates, one of each class of equivalent programs; `probability`: of all together."""
    highest = max((max(scores) for _, scores in classes), default=0.0)
    masses = [(sum(math.exp(score - highest) for score in scores), program) for program, scores in classes]
    masses = sorted(masses, key=lambda mass: -mass[0])[:MAX_CANDIDATES]
    total = sum(mass for mass, _ in masses)
    return tuple(ProgramCandidate(program, probability * mass / total) for mass, program in masses)
