"""Symbols the parser reads and writes, words and program tokens, and their indices.

Colours are permuted in statement and program alike so that every statement names them in the same order: the rules and
the program language are symmetric in the colours, so the parser need not learn each permutation.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from lilgym_mp.programs.prefix import token_arities
from lilgym_mp.scene import Colour

COLOURS = tuple(colour.name.lower() for colour in Colour)
_COLOUR_TOKEN = re.compile(r"is_(yellow|black|blue)\(1\)|Color\.(YELLOW|BLACK|BLUE)")

Exchange = Mapping[str, str]  # colour name in lower case -> its replacement


def standard_colours(words: Iterable[str]) -> dict[str, str]:
    """The permutation that puts the named colours in the order of `Colour`, followed by the unnamed ones."""
    named = dict.fromkeys([*(word for word in words if word in COLOURS), *COLOURS])
    return dict(zip(named, COLOURS, strict=True))


def words_recoloured(words: Sequence[str], exchange: Exchange) -> list[str]:
    return [exchange.get(word, word) for word in words]


def inverse(exchange: Exchange) -> dict[str, str]:
    return {new: old for old, new in exchange.items()}


def tokens_recoloured(tokens: Sequence[str], exchange: Exchange) -> list[str]:
    """Program tokens with their colours replaced."""

    def recoloured(token: str) -> str:
        found = _COLOUR_TOKEN.fullmatch(token)
        if found is None:
            return token
        name = exchange[(found[1] or found[2]).lower()]
        return f"is_{name}(1)" if found[1] else f"Color.{name.upper()}"

    return [recoloured(token) for token in tokens]


@dataclass(frozen=True)
class SymbolTable:
    """Indices of symbols, from 1; 0 is padding."""

    symbols: tuple[str, ...]
    _indices: dict[str, int] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_indices", {symbol: index for index, symbol in enumerate(self.symbols, start=1)})

    def __len__(self) -> int:
        """Padding included."""
        return 1 + len(self.symbols)

    def index(self, symbol: str, default: int | None = None) -> int:
        return self._indices[symbol] if default is None else self._indices.get(symbol, default)

    def symbol(self, index: int) -> str:
        return self.symbols[index - 1]


@dataclass(frozen=True)
class TokenTable(SymbolTable):
    """Indices of program tokens. A parser keeps the table it was trained with, so new words do not affect it."""

    arities: tuple[int, ...] = field(init=False, repr=False, compare=False)  # by index; 0 for padding

    def __post_init__(self) -> None:
        """Raises ValueError for a token that the program language lacks."""
        super().__post_init__()
        unknown = [symbol for symbol in self.symbols if symbol not in token_arities()]
        if unknown:
            raise ValueError(f"this version of the program language has no {', '.join(map(repr, unknown[:3]))}")
        object.__setattr__(self, "arities", (0, *(token_arities()[symbol] for symbol in self.symbols)))


TOKENS = TokenTable(tuple(token_arities()))  # of newly trained networks
