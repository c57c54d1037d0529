"""A chart parser for small context-free grammars without left recursion; returns the value of every parse."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

Builder = Callable[..., Any]


class Element(NamedTuple):
    """An element of a rule's right-hand side: a nonterminal, or alternative words (`symbol` None)."""

    symbol: str | None
    words: frozenset[str]
    optional: bool


class Rule(NamedTuple):
    elements: tuple[Element, ...]
    build: Builder


def _only_value(value: Any) -> Any:
    return value


class Grammar:
    """Rules by nonterminal, and a lexicon: preterminal -> word -> value."""

    def __init__(self, lexicon: Mapping[str, Mapping[str, object]]) -> None:
        self.rules: dict[str, list[Rule]] = {}
        self.lexicon = lexicon

    def add(self, symbol: str, pattern: str, build: Builder = _only_value) -> None:
        """Add a rule that expands `symbol` to `pattern`: SYMBOLS, words and alternatives a|b; "?" marks optional ones.

        `build` maps the values of the pattern's symbols, in order and None where omitted, to the rule's value; by
        default it returns the only one.
        """
        self.rules.setdefault(symbol, []).append(Rule(tuple(map(_element, pattern.split())), build))

    def parses(self, symbol: str, tokens: Sequence[str]) -> list[Any]:
        """The value of every parse of all tokens as `symbol`."""
        chart = _Chart(self, tokens)
        return [value for end, value in chart.spans(symbol, 0) if end == len(tokens)]


def _element(text: str) -> Element:
    optional = text.endswith("?")
    name = text.removesuffix("?")
    if name.isupper():
        return Element(name, frozenset(), optional)
    return Element(None, frozenset(name.split("|")), optional)


class _Chart:
    """Memoised partial parses by symbol and start index."""

    def __init__(self, grammar: Grammar, tokens: Sequence[str]) -> None:
        self.grammar = grammar
        self.tokens = tokens
        self.memo: dict[tuple[str, int], list[tuple[int, Any]]] = {}

    def spans(self, symbol: str, start: int) -> list[tuple[int, Any]]:
        """End index and value of every parse of `symbol` from `start`."""
        key = (symbol, start)
        if key not in self.memo:
            self.memo[key] = list(self._expand(symbol, start))
        return self.memo[key]

    def _expand(self, symbol: str, start: int) -> Iterator[tuple[int, Any]]:
        entries = self.grammar.lexicon.get(symbol)
        if entries is not None:
            if start < len(self.tokens) and self.tokens[start] in entries:
                yield start + 1, entries[self.tokens[start]]
            return
        for rule in self.grammar.rules[symbol]:
            for end, values in self._sequence(rule.elements, start):
                yield end, rule.build(*values)

    def _sequence(self, elements: tuple[Element, ...], start: int) -> Iterator[tuple[int, tuple[Any, ...]]]:
        """End index and symbol values of every parse of consecutive elements."""
        if not elements:
            yield start, ()
            return
        element, rest = elements[0], elements[1:]
        if element.symbol is None:
            if start < len(self.tokens) and self.tokens[start] in element.words:
                yield from self._sequence(rest, start + 1)
            if element.optional:
                yield from self._sequence(rest, start)
            return
        for end, value in self.spans(element.symbol, start):
            for last, values in self._sequence(rest, end):
                yield last, (value, *values)
        if element.optional:
            for last, values in self._sequence(rest, start):
                yield last, (None, *values)
