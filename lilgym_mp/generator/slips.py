"""Slips of the typing hand, as people make them."""

from __future__ import annotations

import random
import re
from collections.abc import Container

SHORTEST = 4  # letters of a word that is mistyped
_WORD = re.compile(rf"[a-zA-Z]{{{SHORTEST},}}")


def mistyped(statement: str, rng: random.Random, words: Container[str]) -> str:
    """The statement with one word mistyped: a letter left out, doubled, or changing places with the next.

    The word keeps its first letter and becomes none of `words`, which are in lower case.
    """
    places = list(_WORD.finditer(statement))
    while places:
        place = rng.choice(places)
        slip = _slip(place.group(), rng)
        if slip.lower() not in words and slip != place.group():
            return statement[: place.start()] + slip + statement[place.end() :]
    return statement


def _slip(word: str, rng: random.Random) -> str:
    at = rng.randrange(1, len(word) - 1)
    match rng.choice(("swap", "swap", "drop", "double")):
        case "swap":
            return word[:at] + word[at + 1] + word[at] + word[at + 2 :]
        case "drop":
            return word[:at] + word[at + 1 :]
        case _:
            return word[:at] + word[at] + word[at:]
