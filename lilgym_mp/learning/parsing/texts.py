"""Statements and programs as the parser reads and writes them: sequences of word and token indices.

Colours are exchanged on both sides so that every statement names them in one order: no rule and no word of the
language tells one colour from another, so the parser need not learn to.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from lilgym_mp.programs.prefix import token_arities
from lilgym_mp.scene import Colour

COLOURS = tuple(colour.name.lower() for colour in Colour)
_COLOUR_TOKEN = re.compile(r"is_(yellow|black|blue)\(1\)|Color\.(YELLOW|BLACK|BLUE)")

Exchange = Mapping[str, str]  # by name of a colour in lower case, another


def standard_colours(words: Iterable[str]) -> dict[str, str]:
    """The exchange after which words name the colours in the order of `Colour`, those that they do not name last."""
    named = dict.fromkeys([*(word for word in words if word in COLOURS), *COLOURS])
    return dict(zip(named, COLOURS, strict=True))


def words_recoloured(words: Sequence[str], exchange: Exchange) -> list[str]:
    return [exchange.get(word, word) for word in words]


def inverse(exchange: Exchange) -> dict[str, str]:
    return {new: old for old, new in exchange.items()}


def tokens_recoloured(tokens: Sequence[str], exchange: Exchange) -> list[str]:
    """Program tokens with each colour exchanged for another."""

    def exchanged(token: str) -> str:
        found = _COLOUR_TOKEN.fullmatch(token)
        if found is None:
            return token
        name = exchange[(found[1] or found[2]).lower()]
        return f"is_{name}(1)" if found[1] else f"Color.{name.upper()}"

    return [exchanged(token) for token in tokens]


@dataclass(frozen=True)
class Index:
    """A numbering of texts from 1 on; 0 is padding."""

    texts: tuple[str, ...]
    _places: dict[str, int] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_places", {text: place for place, text in enumerate(self.texts, start=1)})

    def __len__(self) -> int:
        """With the padding."""
        return 1 + len(self.texts)

    def __contains__(self, text: object) -> bool:
        return text in self._places

    def of(self, text: str, default: int | None = None) -> int:
        return self._places[text] if default is None else self._places.get(text, default)

    def text(self, index: int) -> str:
        return self.texts[index - 1]


TOKENS = Index(tuple(token_arities()))
