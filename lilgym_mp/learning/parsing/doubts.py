"""Reasons to doubt the most probable reading of a statement: what it does not express, and rivals nearly as likely."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator, Sequence

CLOSE_RIVAL = 0.25  # of the first reading's probability, from which the second is named
# A sentence whose other words are all unknown is not understood
_FUNCTION_WORDS = """
    a an the this that these those it its is are be was there here in on at of to from with has have and or as by for
    which who what any some one
"""
FUNCTION_WORDS = frozenset(_FUNCTION_WORDS.split())
# Numbers that the words do not tell: separators, decimals, powers, per cents and signs. A hyphen between words is none.
_NUMBER = r"[.,/:'\u2019\u066b\u066c]"
_SIGN = r"[-+\u2010-\u2015\u2212]"
_FOREIGN_NUMBER = re.compile(
    rf"\d+(?:(?:{_NUMBER}|{_SIGN})\d+)+|(?<![\w)]){_SIGN}\s?\d+|(?<!\w){_NUMBER}\d+|\d+\s?[%\u2030]"
    r"|\b\d{1,3}(?:\s\d{3})+\b"
)
_TOKEN = re.compile(r"\w+|[<>=!]=|[<>%]")
_NEGATION = re.compile(
    r"\b(?:no|none|not|neither|never|nothing|without|except)\b"
    r"|\b(?:all|any|each|every)(?: \w+){1,2} but\b(?! (?:no|none|not|only)\b)"
)
# Words of statements, and what any program of a statement with one of them has one of
_EXPRESSIONS = {
    "even odd": "%",
    "bigger larger smaller": "query_size get_set_sizes",
    "taller tallest shorter higher highest lower lowest": "count < > <= >= is_top is_bottom get_above get_below",
    "yellow": "yellow is_yellow YELLOW",
    "blue": "is_blue BLUE",
    "black": "is_black BLACK",
    "circle circles": "is_circle CIRCLE",
    "triangle triangles": "is_triangle TRIANGLE",
    "small": "is_small SMALL",
    "medium": "is_medium MEDIUM",
    "big large": "is_big BIG",
    "corner corners": "is_touching_corner is_closely_touching_corner",
    "second": "is_second 2",
    "third": "is_third 3",
    "left": "LEFT 0",
    "right": "RIGHT 2",
}
# The least number above the limit that a comparison names, besides N, and whether the numbers from there on are meant
_COMPARISONS = {
    "more than": (1, True),
    "greater than": (1, True),
    "at most": (1, False),
    "fewer than": (0, False),
    "less than": (0, False),
    "at least": (0, True),
}
_COMPARED = re.compile(rf"(\b(?:no|not) )?\b({'|'.join(_COMPARISONS)}) (\d+)\b")
_COMPARES = re.compile(r"([<>]=?) (\d+)\b")
_NEGATED = re.compile(r"\b(?:not|NOT|lt|le)\b|!=|<|(?<!\[)\b0\b")
_EXPRESSED_BY = {word: frozenset(tokens.split()) for words, tokens in _EXPRESSIONS.items() for word in words.split()}


def doubts(
    statement: str, words: Sequence[str], readings: Sequence[tuple[str, float]], truths: Sequence[bool | None]
) -> Iterator[str]:
    """Lines that say why the first of the readings may be wrong, besides unknown words; none if nothing says so.

    `words`: those that were read. `readings`: programs with their probabilities, `truths`: those of the first one on
    the probe scenes.
    """
    for number in dict.fromkeys(_foreign_numbers(statement)):
        yield f"{number!r} cannot be read as a number; whole numbers from 0 to 12 can"
    if not readings:
        yield "no program was found"
        return
    program, probability = readings[0]
    tokens = frozenset(_TOKEN.findall(program))
    for word in dict.fromkeys(words):
        if word in _EXPRESSED_BY and not tokens & _EXPRESSED_BY[word]:
            yield f"the first reading does not express {word!r}"
        elif word.isdecimal() and int(word) > 1 and not _has_number(int(word), tokens):
            yield f"the first reading does not have the number {word}"
    text = " ".join(words)
    negations = _NEGATION.findall(_COMPARED.sub("", text))
    yield from _other_limits(text, program, is_negated=bool(negations))
    if negations and "empty" in words:
        negations.append("empty")
    if len(negations) > len(_NEGATED.findall(program)):
        yield f"the first reading does not express {' and '.join(map(repr, negations))}"
    for value in (True, False):
        if set(truths) == {value}:
            yield f"the first reading is {str(value).lower()} in every scene that was tried"
    if len(readings) > 1 and readings[1][1] >= CLOSE_RIVAL * probability:
        yield f"another reading is nearly as likely: {readings[1][0]}"


def _foreign_numbers(statement: str) -> Iterator[str]:
    yield from (match[0].strip() for match in _FOREIGN_NUMBER.finditer(statement))
    for sign in statement:
        if unicodedata.numeric(sign, None) is not None and unicodedata.decimal(sign, None) is None:
            yield sign


def _other_limits(text: str, program: str, *, is_negated: bool) -> Iterator[str]:
    """Lines about comparisons of the text with numbers, "fewer than 2", that the program does not make."""
    if "All(" in program or "combinations(" in program:  # of all three boxes, or of two items
        return
    found = {(int(number) + (sign in (">", "<=")), sign[0] == ">") for sign, number in _COMPARES.findall(program)}
    if "exist(" in program:
        found.add((1, True))
    if is_negated or "not" in program:
        found |= {(limit, not is_from) for limit, is_from in found}
    for negated, comparison, number in _COMPARED.findall(text):
        more, is_from = _COMPARISONS[comparison]
        if (int(number) + more, is_from != bool(negated)) not in found:
            yield f"the first reading does not express '{negated}{comparison} {number}'"


def _has_number(number: int, tokens: frozenset[str]) -> bool:
    """Whether the number, or a neighbour that a strict comparison can have instead, is in the program."""
    ordinal = {2: "is_second", 3: "is_third"}.get(number, "")
    return bool(tokens & {str(number - 1), str(number), str(number + 1), ordinal})
