"""A parser for small context-free grammars: every reading of a text, each as the value its rules build."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

Builder = Callable[..., Any]


class Part(NamedTuple):
    """One place of a rule: a symbol in capitals, or the words that may stand there."""

    symbol: str | None
    words: frozenset[str]
    optional: bool


class Rule(NamedTuple):
    parts: tuple[Part, ...]
    build: Builder


class Grammar:
    """Rules by symbol, and the words that are values by themselves."""

    def __init__(self, lexicon: Mapping[str, Mapping[str, object]]) -> None:
        self.rules: dict[str, list[Rule]] = {}
        self.lexicon = lexicon

    def add(self, symbol: str, pattern: str, build: Builder) -> None:
        """Let `symbol` be what `pattern` describes: SYMBOLS, words, alternatives a|b, each optional with "?".

        `build` gets the values of the symbols in the pattern in order, None for one left out.
        """
        self.rules.setdefault(symbol, []).append(Rule(tuple(map(_part, pattern.split())), build))

    def readings(self, symbol: str, tokens: Sequence[str]) -> list[Any]:
        """The value of every way to read all tokens as `symbol`."""
        chart = _Chart(self, tokens)
        return [value for end, value in chart.read(symbol, 0) if end == len(tokens)]


def _part(text: str) -> Part:
    optional = text.endswith("?")
    name = text.removesuffix("?")
    if name.isupper():
        return Part(name, frozenset(), optional)
    return Part(None, frozenset(name.split("|")), optional)


class _Chart:
    """What has been read so far, by symbol and place."""

    def __init__(self, grammar: Grammar, tokens: Sequence[str]) -> None:
        self.grammar = grammar
        self.tokens = tokens
        self.found: dict[tuple[str, int], list[tuple[int, Any]]] = {}

    def read(self, symbol: str, start: int) -> list[tuple[int, Any]]:
        """Where a `symbol` that starts there may end, and its values."""
        key = (symbol, start)
        if key not in self.found:
            self.found[key] = list(self._read(symbol, start))
        return self.found[key]

    def _read(self, symbol: str, start: int) -> Iterator[tuple[int, Any]]:
        entries = self.grammar.lexicon.get(symbol)
        if entries is not None:
            if start < len(self.tokens) and self.tokens[start] in entries:
                yield start + 1, entries[self.tokens[start]]
            return
        for rule in self.grammar.rules[symbol]:
            for end, values in self._follow(rule.parts, start):
                yield end, rule.build(*values)

    def _follow(self, parts: tuple[Part, ...], start: int) -> Iterator[tuple[int, tuple[Any, ...]]]:
        """Every way to read the parts one after the other, with the symbols' values."""
        if not parts:
            yield start, ()
            return
        part, rest = parts[0], parts[1:]
        if part.symbol is None:
            if start < len(self.tokens) and self.tokens[start] in part.words:
                yield from self._follow(rest, start + 1)
            if part.optional:
                yield from self._follow(rest, start)
            return
        for end, value in self.read(part.symbol, start):
            for last, values in self._follow(rest, end):
                yield last, (value, *values)
        if part.optional:
            for last, values in self._follow(rest, start):
                yield last, (None, *values)
