"""English words and morphology, and the lexical choices of one writer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

NUMBER_WORDS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
IRREGULAR_PLURALS = {"is": "are", "has": "have", "does": "do", "touches": "touch"}  # plurals of verbs


class Phrase(NamedTuple):
    """A noun phrase, and whether a verb that agrees with it is plural."""

    text: str
    plural: bool


@dataclass(frozen=True)
class Style:
    """Lexical choices that one writer keeps to within a statement."""

    item: str  # the noun for an item of any shape: block, object ...
    tower: str = ""  # empty where there are none
    box: str = "box"
    wall: str = "wall"
    picture: str = "picture"
    digits: bool = False
    sloppy: bool = False  # makes agreement errors, leaves articles out
    bare_number_is_bound: bool = False  # "two" may mean at least two, "one of the boxes" exactly one


def article(noun: str) -> str:
    """The noun with its indefinite article."""
    return f"an {noun}" if noun[0] in "aeiou" else f"a {noun}"


def pluralised(noun: str) -> str:
    return noun + "es" if noun.endswith("x") else noun + "s"


def conjugated(verb: str, plural: bool) -> str:
    """The form of a verb given in the third person singular."""
    if not plural:
        return verb
    return IRREGULAR_PLURALS.get(verb, verb.removesuffix("s"))
