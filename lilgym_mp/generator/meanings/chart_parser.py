"""A chart parser for small context-free grammars without left recursion; returns the value of every parse."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple


class Element(NamedTuple):
    """An element of a pattern: a symbol or word alternatives. Only symbols in capitals contribute their value."""

    name: str
    optional: bool
    keyword: str  # of the value in the call that builds the rule's value; empty if it is positional

    @classmethod
    def of(cls, text: str) -> Element:
        keyword, _, name = text.rpartition(":")
        return cls(name.removesuffix("?"), name.endswith("?"), keyword)


Values = tuple[tuple[str, Any], ...]  # keywords and values


def _only_value(value: Any) -> Any:
    return value


class Grammar:
    """Rules by nonterminal, and a lexicon: preterminal -> word -> value."""

    def __init__(self, lexicon: Mapping[str, Mapping[str, object]]) -> None:
        self.rules: dict[str, list[tuple[Sequence[Element], Callable[..., Any]]]] = {}
        self.lexicon = dict(lexicon)

    def add(self, symbol: str, patterns: str, build: Callable[..., Any] = _only_value) -> None:
        """Add rules that expand `symbol` to each of the patterns, separated by " / ".

        A pattern consists of SYMBOLS, <symbols> without a value, words and alternatives a|b; "?" marks optional ones.
        `build` maps the values of the pattern's SYMBOLS, None where omitted, to the rule's value: in order, or by
        keyword for "keyword:SYMBOL". By default it returns the only one.
        """
        for pattern in patterns.split(" / "):
            elements = list(map(Element.of, pattern.split()))
            self.rules.setdefault(symbol, []).append((elements, build))
            for name, _, _ in elements:
                if not name.isupper() and not name.startswith("<"):
                    self.lexicon[name] = dict.fromkeys(name.split("|"))

    def parses(self, symbol: str, tokens: Sequence[str]) -> list[Any]:
        """The value of every parse of all tokens as `symbol`."""

        @cache
        def spans(symbol: str, start: int) -> list[tuple[int, Any]]:
            """End index and value of every parse of `symbol` from `start`."""
            if (entries := self.lexicon.get(symbol)) is not None:
                return [(start + 1, entries[word]) for word in tokens[start : start + 1] if word in entries]
            return [
                (end, build(*(value for keyword, value in values if not keyword), **{k: v for k, v in values if k}))
                for elements, build in self.rules[symbol]
                for end, values in sequences(elements, start)
            ]

        def sequences(elements: Sequence[Element], start: int) -> Iterator[tuple[int, Values]]:
            """End index and values of every parse of consecutive elements."""
            if not elements:
                yield start, ()
                return
            (name, optional, keyword), rest = elements[0], elements[1:]
            found = spans(name, start)
            for middle, value in [*found, (start, None)] if optional else found:
                own: Values = ((keyword, value),) if name.isupper() else ()
                for end, values in sequences(rest, middle):
                    yield end, (*own, *values)

        return [value for end, value in spans(symbol, 0) if end == len(tokens)]
