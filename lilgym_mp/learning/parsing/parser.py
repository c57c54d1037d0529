"""A trained parser: statements to their likely programs, with probabilities."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache
from typing import Any, NamedTuple

import torch
from torch import Tensor

from lilgym_mp.generator import ScenePool
from lilgym_mp.learning.devices import single_thread
from lilgym_mp.learning.parsing.beam import beam_search
from lilgym_mp.learning.parsing.network import ParserNetwork, Sizes
from lilgym_mp.learning.parsing.pairs import normalise_statement, program_of
from lilgym_mp.learning.parsing.symbols import TOKENS, SymbolTable, inverse, words_recoloured
from lilgym_mp.programs import ProgramError, ProgramRuntimeError, compile_program
from lilgym_mp.programs.prefix import PrefixError
from lilgym_mp.scene import Scene

UNKNOWN = "<unknown>"
BEAM_WIDTH = 20
KEPT_CANDIDATES = 12
PROBE_SCENES = 160  # on which candidates that agree are taken to mean the same
LEAST_BADLY_TYPED = 0.1  # of the beam's probability, that a program without generated code must have: it is slow to try
KEPT_STATEMENTS = 4096  # whose candidates are remembered


class ProgramCandidate(NamedTuple):
    """A program that a statement may mean."""

    program: str
    probability: float  # of the statement's candidates these add up to 1
    alternatives: int  # programs of the beam that agree with it on all probes, itself included


@dataclass(frozen=True)
class Parse:
    """What the parser makes of a statement."""

    words: tuple[str, ...]  # as read, misspelt ones repaired; the first tells the appearance
    unknown: int  # words that the parser does not know
    candidates: tuple[ProgramCandidate, ...]  # the likeliest first; none where the beam holds no program

    @property
    def is_guess(self) -> bool:
        """Whether most of the statement's words are unknown, or there are none."""
        return self.known_share <= 0.5

    @property
    def known_share(self) -> float:
        """Of the statement's words; 0 of none."""
        count = len(self.words) - 1
        return 1 - self.unknown / count if count else 0.0


@cache
def probe_scenes(appearance: str) -> Sequence[Scene]:
    """Scenes on which programs are compared: the same in every process."""
    rng = random.Random(f"probes {appearance}")
    stock = ScenePool.sample(appearance, rng, 1 + PROBE_SCENES // 8)
    scenes = rng.sample(stock.scenes, min(PROBE_SCENES, len(stock.scenes)))
    return (Scene.empty(), *scenes)


def truths(program: str, appearance: str) -> tuple[bool | None, ...]:
    """The program's truth on the probes; None where it raises an error."""
    evaluate = compile_program(program).evaluate

    def truth(scene: Scene) -> bool | None:
        try:
            return evaluate(scene)
        except ProgramRuntimeError:
            return None

    return tuple(map(truth, probe_scenes(appearance)))


@dataclass
class Parser:
    """A network with the words it knows."""

    network: ParserNetwork
    vocabulary: SymbolTable
    temperature: float = 1.0  # by which log-probabilities are divided
    _known: frozenset[str] = field(init=False, repr=False)
    _parses: dict[tuple[str, str, int], Parse] = field(init=False, repr=False, default_factory=dict)

    def __post_init__(self) -> None:
        self._known = frozenset(self.vocabulary.symbols)

    def parse(self, statement: str, appearance: str, beam_width: int = BEAM_WIDTH) -> Parse:
        """The likely programs of any text, such as an empty one: then they are what statements mean most often."""
        key = (statement, appearance, beam_width)
        found = self._parses.get(key)
        if found is None:
            if len(self._parses) >= KEPT_STATEMENTS:
                self._parses.clear()
            with single_thread():
                found = self._parse(statement, appearance, beam_width)
            self._parses[key] = found
        return found

    def _parse(self, statement: str, appearance: str, beam_width: int) -> Parse:
        normalised = normalise_statement(statement, appearance, self._known)
        unknown = self.vocabulary.index(UNKNOWN)
        words = [self.vocabulary.index(word, unknown) for word in normalised.words]
        scores: dict[tuple[bool | None, ...], list[float]] = {}
        programs: dict[tuple[bool | None, ...], str] = {}
        found = beam_search(self.network, words, beam_width)
        total = sum(math.exp(candidate.log_probability) for candidate in found)
        for candidate in found:
            try:
                program = program_of([TOKENS.symbol(token) for token in candidate.tokens], normalised.exchange)
            except (PrefixError, ProgramError):
                continue
            well_typed = compile_program(program).has_generated_code
            if not well_typed and math.exp(candidate.log_probability) < LEAST_BADLY_TYPED * total:
                continue
            meaning = truths(program, appearance)
            if all(truth is None for truth in meaning) or (len(set(meaning)) == 1 and not well_typed):
                continue
            programs.setdefault(meaning, program)  # the likeliest comes first
            scores.setdefault(meaning, []).append(candidate.log_probability / self.temperature)
        said = words_recoloured(normalised.words, inverse(normalised.exchange))
        return Parse(tuple(said), words.count(unknown), _ranked(programs, scores))

    def to_details(self) -> dict[str, Any]:
        """What `from_details` needs beside the tensors."""
        return {
            "words": list(self.vocabulary.symbols),
            "tokens": list(TOKENS.symbols),
            "sizes": asdict(self.network.sizes),
            "temperature": self.temperature,
        }

    @classmethod
    def from_details(cls, details: Mapping[str, Any]) -> Parser:
        """A parser whose network is still to be given its tensors. Raises ValueError, TypeError, KeyError."""
        if tuple(details["tokens"]) != TOKENS.symbols:
            raise ValueError("its program tokens are not those of this version of the language")
        words = details["words"]
        if not isinstance(words, list) or not all(isinstance(word, str) for word in words) or UNKNOWN not in words:
            raise ValueError("its vocabulary is not a list of words with one for unknown ones")
        vocabulary = SymbolTable(tuple(words))
        network = ParserNetwork(len(vocabulary), len(TOKENS), Sizes(**details["sizes"]))
        return cls(network.eval(), vocabulary, float(details["temperature"]))


def _ranked(
    programs: Mapping[tuple[bool | None, ...], str], scores: Mapping[tuple[bool | None, ...], Sequence[float]]
) -> tuple[ProgramCandidate, ...]:
    """The likeliest meanings with their shares of the probability."""
    if not scores:
        return ()
    highest = max(max(values) for values in scores.values())
    masses = {meaning: sum(math.exp(value - highest) for value in values) for meaning, values in scores.items()}
    ranked = sorted(masses, key=lambda meaning: -masses[meaning])[:KEPT_CANDIDATES]
    total = sum(masses[meaning] for meaning in ranked)
    return tuple(
        ProgramCandidate(programs[meaning], masses[meaning] / total, len(scores[meaning])) for meaning in ranked
    )


def tensors_of(parser: Parser) -> dict[str, Tensor]:
    return {name: tensor.detach() for name, tensor in parser.network.state_dict().items()}


def move(parser: Parser, device: torch.device) -> Parser:
    parser.network.to(device)
    return parser
