"""What the parser learns from: statements with programs, as indices, and their variations."""

from __future__ import annotations

import random
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from lilgym_mp.corpus.spelling import normalised_words
from lilgym_mp.learning.parsing.symbols import (
    TOKENS,
    inverse,
    standard_colours,
    tokens_recoloured,
    words_recoloured,
)
from lilgym_mp.programs import compile_program
from lilgym_mp.programs.canonical import canonical_form
from lilgym_mp.programs.prefix import PrefixError, prefix_tokens, token_arities, tree_from_tokens
from lilgym_mp.programs.printing import source_of
from lilgym_mp.programs.syntax import parse

APPEARANCE_WORDS = {"tower": "<tower>", "scatter": "<scatter>"}  # before the words of each statement
LARGEST_NUMBER = 7  # that a number is exchanged for
MOST_WORDS = 64  # of a statement, the appearance's word included; what follows is not read
SHAPES = ("circle", "square", "triangle")


class Pair(NamedTuple):
    """A statement and its program in the parser's terms, colours in standard order."""

    words: tuple[str, ...]
    tokens: tuple[str, ...]


class NormalisedStatement(NamedTuple):
    """A statement as the parser reads it."""

    words: tuple[str, ...]  # the appearance's word first, colours in standard order
    exchange: Mapping[str, str]  # by colour as it was said, the one that stands for it


def normalise_statement(statement: str, appearance: str, known: Collection[str]) -> NormalisedStatement:
    """`known`: the words that misspelt ones are repaired to; colours and numbers are always known."""
    words = normalised_words(statement, known)[: MOST_WORDS - 1]
    exchange = standard_colours(words)
    return NormalisedStatement((APPEARANCE_WORDS[appearance], *words_recoloured(words, exchange)), exchange)


def pair_of(normalised: NormalisedStatement, program: str, *, most_tokens: int) -> Pair | None:
    """The normalised with its program in the same colours; None where the program has no tokens, or too many."""
    try:
        tokens = prefix_tokens(canonical_form(parse(program)))
        tokens = prefix_tokens(canonical_form(tree_from_tokens(tokens_recoloured(tokens, normalised.exchange))))
    except PrefixError:
        return None
    return Pair(normalised.words, tuple(tokens)) if len(tokens) <= most_tokens else None


def program_of(tokens: Sequence[str], exchange: Mapping[str, str]) -> str:
    """The source of the program that the parser wrote for a normalised. Raises PrefixError, ProgramError."""
    tree = canonical_form(tree_from_tokens(tokens_recoloured(tokens, inverse(exchange))))
    return compile_program(source_of(tree)).source


@dataclass(frozen=True)
class Variations:
    """Random exchanges of shapes and numbers, made where words and program name the same ones."""

    shapes: float = 0.5  # share of the pairs
    numbers: float = 0.5

    def of(self, pair: Pair, rng: random.Random) -> Pair:
        if rng.random() < self.shapes:
            pair = _with_other_shapes(pair, rng)
        if rng.random() < self.numbers:
            pair = _with_other_numbers(pair, rng)
        return pair


def _with_other_shapes(pair: Pair, rng: random.Random) -> Pair:
    said = {shape for shape in SHAPES if shape in pair.words or f"{shape}s" in pair.words}
    meant = {shape for shape in SHAPES for token in pair.tokens if token in _shape_tokens(shape)}
    if said != meant or not said:
        return pair
    exchange: dict[str, str] = {}
    for old, new in zip(SHAPES, rng.sample(SHAPES, len(SHAPES)), strict=True):
        exchange |= {old: new, f"{old}s": f"{new}s"} | dict(zip(_shape_tokens(old), _shape_tokens(new), strict=True))
    return _exchanged(pair, exchange)


def _shape_tokens(shape: str) -> tuple[str, str]:
    return f"is_{shape}(1)", f"Shape.{shape.upper()}"


def _with_other_numbers(pair: Pair, rng: random.Random) -> Pair:
    said = {word for word in pair.words if word.isdigit()}
    meant = {token[1:] for token in pair.tokens if token.startswith("#")}
    if said != meant or not said or "1" in said or "0" in said:
        return pair
    new = rng.sample(range(2, LARGEST_NUMBER + 1), min(len(said), LARGEST_NUMBER - 1))
    if len(new) < len(said):
        return pair
    ordered = sorted(new)
    exchange: dict[str, str] = {}
    for old, number in zip(sorted(said, key=int), ordered, strict=True):
        exchange |= {old: str(number), f"#{old}": f"#{number}"}
    return _exchanged(pair, exchange)


def _exchanged(pair: Pair, exchange: Mapping[str, str]) -> Pair:
    return Pair(
        tuple([exchange.get(word, word) for word in pair.words]),
        tuple([exchange.get(token, token) for token in pair.tokens]),
    )


class Slot(NamedTuple):
    """Where a token stands in its tree."""

    parent: int  # index of the token that it is a part of; 0 for the first
    part: int


_ARITY = [0, *(token_arities()[text] for text in TOKENS.symbols)]  # by index


def slots_of(tokens: Sequence[int]) -> Iterator[Slot]:
    """Of each token of a whole program."""
    open_slots = [Slot(0, 0)]
    for token in tokens:
        yield open_slots.pop()
        open_slots.extend(parts_of(token))


def parts_of(token: int) -> Iterable[Slot]:
    """The slots that a token opens, the last part first, as a stack has them."""
    return [Slot(token, part) for part in reversed(range(_ARITY[token]))]
