"""Training pairs of normalised statements and program tokens, their indices, and their augmentation.

Colours are permuted in statement and program alike so that every statement names them in the same order: the rules and
the program language are symmetric in the colours, so the parser need not learn each permutation.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from random import Random
from typing import NamedTuple

from lilgym_mp.corpus.spelling import normalised_words
from lilgym_mp.programs import compile_program
from lilgym_mp.programs.canonical import canonical_form
from lilgym_mp.programs.prefix import PrefixError, prefix_tokens, token_arities, tree_from_tokens
from lilgym_mp.programs.printing import source_of
from lilgym_mp.programs.syntax import parse
from lilgym_mp.scene import Colour
from lilgym_mp.scene.arrays import Strings

APPEARANCE_WORDS = {"tower": "<tower>", "scatter": "<scatter>"}  # first word of each normalised statement
MAX_NUMBER = 7  # largest number in an augmented statement
MAX_WORDS = 64  # including the appearance word; longer statements are truncated
SHAPES = ("circle", "square", "triangle")
COLOURS = tuple(colour.name.lower() for colour in Colour)

Exchange = Mapping[str, str]  # colour name in lower case, or another symbol -> its replacement


def standard_colours(words: Iterable[str]) -> dict[str, str]:
    """The permutation that puts the named colours in the order of `Colour`, followed by the unnamed ones."""
    named = dict.fromkeys([*(word for word in words if word in COLOURS), *COLOURS])
    return dict(zip(named, COLOURS, strict=True))


def exchanged(symbols: Sequence[str], exchange: Exchange) -> list[str]:
    """The symbols after the exchange; those that it does not name stay."""
    return [exchange.get(symbol, symbol) for symbol in symbols]


def inverse(exchange: Exchange) -> dict[str, str]:
    """The exchange that undoes this one."""
    return {new: old for old, new in exchange.items()}


def tokens_recoloured(tokens: Sequence[str], exchange: Exchange) -> list[str]:
    """Program tokens with their colours replaced."""
    return exchanged(tokens, _exchange_of_tokens("Color", exchange))


def _exchange_of_tokens(kind: str, exchange: Exchange) -> dict[str, str]:
    """The exchange of the tokens that name colours or shapes; `kind`: "Color" or "Shape"."""
    names = exchange.items()
    constants = {f"{kind}.{old.upper()}": f"{kind}.{new.upper()}" for old, new in names}
    return {**{f"is_{old}(1)": f"is_{new}(1)" for old, new in names}, **constants}


@dataclass(frozen=True)
class SymbolTable:
    """Indices of symbols, from 1; 0 is padding."""

    symbols: Strings

    @cached_property
    def _indices(self) -> dict[str, int]:
        return {symbol: index for index, symbol in enumerate(self.symbols, start=1)}

    def __len__(self) -> int:
        """Padding included."""
        return 1 + len(self.symbols)

    def index(self, symbol: str, default: int | None = None) -> int:
        """The index of a symbol. Raises KeyError for an unknown one unless `default` is given."""
        return self._indices[symbol] if default is None else self._indices.get(symbol, default)

    def symbol(self, index: int) -> str:
        """The symbol of an index; indices start at 1, as 0 is padding."""
        return self.symbols[index - 1]


@dataclass(frozen=True)
class TokenTable(SymbolTable):
    """Indices of program tokens. A parser keeps the table it was trained with, so new words do not affect it."""

    def __post_init__(self) -> None:
        """Raises ValueError for a token that the program language lacks."""
        unknown = [symbol for symbol in self.symbols if symbol not in token_arities()]
        if unknown:
            raise ValueError(f"this version of the program language has no {', '.join(map(repr, unknown[:3]))}")

    @cached_property
    def arities(self) -> tuple[int, ...]:
        """By index; 0 for padding."""
        return (0, *(token_arities()[symbol] for symbol in self.symbols))


TOKENS = TokenTable(tuple(token_arities()))  # of newly trained networks


class Pair(NamedTuple):
    """A normalised statement and the tokens of its program, with colours in standard order."""

    words: Strings
    tokens: Strings


class NormalisedStatement(NamedTuple):
    """The parser's input."""

    words: Strings  # the appearance word, then the statement with colours in standard order
    exchange: Mapping[str, str]  # original colour -> standard colour


def normalise_statement(statement: str, appearance: str, known: Collection[str]) -> NormalisedStatement:
    """`known`: candidate corrections of misspelt words; colours and numbers are always known."""
    words = normalised_words(statement, known)[: MAX_WORDS - 1]
    exchange = standard_colours(words)
    return NormalisedStatement((APPEARANCE_WORDS[appearance], *exchanged(words, exchange)), exchange)


def pair_of(normalised: NormalisedStatement, program: str, *, most_tokens: int) -> Pair | None:
    """The statement with its recoloured program; None if the program has no prefix form, or too many tokens."""
    try:
        tokens = prefix_tokens(canonical_form(parse(program)))
        tokens = prefix_tokens(canonical_form(tree_from_tokens(tokens_recoloured(tokens, normalised.exchange))))
    except PrefixError:
        return None
    return Pair(normalised.words, tuple(tokens)) if len(tokens) <= most_tokens else None


def program_of(tokens: Sequence[str], exchange: Mapping[str, str]) -> str:
    """The source of a predicted program, in the original colours. Raises PrefixError, ProgramError."""
    tree = canonical_form(tree_from_tokens(tokens_recoloured(tokens, inverse(exchange))))
    return compile_program(source_of(tree)).source


def varied(pair: Pair, shapes: float, numbers: float, rng: Random) -> Pair:
    """Augmentation: exchanges shapes and numbers at random where statement and program name the same ones.

    `shapes`, `numbers`: the fractions of the pairs in which they are exchanged.
    """
    if rng.random() < shapes:
        pair = _with_other_shapes(pair, rng)
    if rng.random() < numbers:
        pair = _with_other_numbers(pair, rng)
    return pair


def _with_other_shapes(pair: Pair, rng: Random) -> Pair:
    in_words = {shape for shape in SHAPES if shape in pair.words or f"{shape}s" in pair.words}
    in_program = {shape for shape in SHAPES if {f"is_{shape}(1)", f"Shape.{shape.upper()}"} & {*pair.tokens}}
    if in_words != in_program or not in_words:
        return pair
    names: dict[str, str] = dict(zip(SHAPES, rng.sample(SHAPES, len(SHAPES)), strict=True))
    plurals = {f"{old}s": f"{new}s" for old, new in names.items()}
    return _exchanged(pair, {**names, **plurals, **_exchange_of_tokens("Shape", names)})


def _with_other_numbers(pair: Pair, rng: Random) -> Pair:
    in_words = {word for word in pair.words if word.isdigit()}
    in_program = {token[1:] for token in pair.tokens if token.startswith("#")}
    if in_words != in_program or not in_words or "1" in in_words or "0" in in_words:
        return pair
    new = rng.sample(range(2, MAX_NUMBER + 1), min(len(in_words), MAX_NUMBER - 1))
    if len(new) < len(in_words):
        return pair
    exchange: dict[str, str] = {}
    for old, number in zip(sorted(in_words, key=int), sorted(new), strict=True):
        exchange |= {old: str(number), f"#{old}": f"#{number}"}
    return _exchanged(pair, exchange)


def _exchanged(pair: Pair, exchange: Mapping[str, str]) -> Pair:
    return Pair(*(tuple(exchanged(part, exchange)) for part in pair))


class Slot(NamedTuple):
    """A token's position in the program tree."""

    parent: int  # index of the parent token; 0 for the first
    argument: int  # index under the parent


def slots_of(tokens: Sequence[int], table: TokenTable = TOKENS) -> Iterator[Slot]:
    """The slot of each token of a complete program, given as indices in the table."""
    open_slots = [Slot(0, 0)]
    for token in tokens:
        yield open_slots.pop()
        open_slots.extend(open_slots_of(token, table))


def open_slots_of(token: int, table: TokenTable) -> Iterable[Slot]:
    """The argument slots a token opens, last argument first, to be pushed on a stack."""
    return [Slot(token, argument) for argument in reversed(range(table.arities[token]))]
