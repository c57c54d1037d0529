"""How people type: capitals, full stops, slips, words left out or doubled. The meaning stays."""

from __future__ import annotations

import random
import re
from itertools import pairwise

SHORTEST = 4  # letters of a word that is mistyped
ALTERNATIVES = {
    "color": ("colour",),
    "colors": ("colours",),
    "grey": ("gray",),
    "gray": ("grey",),
    "there": ("their", "ther", "thre"),
    "exactly": ("exactely", "exacty", "excatly"),
    "triangle": ("traingle", "triangel", "trianlge"),
    "triangles": ("traingles", "triangels"),
    "yellow": ("yelow", "yellw", "yello"),
    "square": ("sqaure", "squre"),
    "circle": ("cirlce", "circel"),
    "touching": ("toching", "touchng", "touchig"),
    "least": ("leas", "lest"),
    "which": ("wich", "whcih"),
}
DROPPABLE = frozenset({"a", "an", "the"})
JOINABLE = frozenset({("at", "least"), ("is", "a"), ("at", "most"), ("a", "box"), ("there", "is"), ("in", "the")})
KEPT_ARTICLES = re.compile(r"\bthe (other|only)\b")
SWAPS = {
    "contains": ("has",),
    "has": ("contains",),
    "which": ("that",),
    "beneath": ("below",),
    "image": ("picture",),
    "picture": ("image",),
}


def paraphrased(statement: str, rng: random.Random) -> str:
    """The statement as somebody else might have typed it: same meaning, other case, stops, spelling, small words."""
    text = statement.rstrip(" .!")
    text = text[:1].lower() + text[1:]
    draw = rng.random
    if draw() < 0.05:
        text = _swapped(text, rng)
    if draw() < 0.1:
        text = _without_article(text, rng)
    if draw() < 0.04:
        text = _joined_words(text)
    if draw() < 0.02:
        text = _doubled_word(text, rng)
    if draw() < 0.12:
        text = _mistyped(text, rng)
    return _finished(text, rng)


def _swapped(text: str, rng: random.Random) -> str:
    words = text.split(" ")
    places = [place for place, word in enumerate(words) if word in SWAPS]
    if places:
        place = rng.choice(places)
        words[place] = rng.choice(SWAPS[words[place]])
    return " ".join(words)


def _without_article(text: str, rng: random.Random) -> str:
    words = text.split(" ")
    places = [
        place
        for place, word in enumerate(words[:-1])
        if word in DROPPABLE and words[place + 1] not in ("only", "other", "same", "most", "single", "couple", "pair")
    ]
    if places:
        del words[rng.choice(places)]
    return " ".join(words)


def _joined_words(text: str) -> str:
    words = text.split(" ")
    for place, pair in enumerate(pairwise(words)):
        if pair in JOINABLE:
            return " ".join([*words[:place], "".join(pair), *words[place + 2 :]])
    return text


def _doubled_word(text: str, rng: random.Random) -> str:
    words = text.split(" ")
    place = rng.randrange(len(words))
    return " ".join([*words[: place + 1], *words[place:]])


def _mistyped(text: str, rng: random.Random) -> str:
    words = text.split(" ")
    places = [place for place, word in enumerate(words) if len(word) >= SHORTEST and word.isalpha()]
    if places:
        place = rng.choice(places)
        word = words[place]
        words[place] = (
            rng.choice(ALTERNATIVES[word]) if word in ALTERNATIVES and rng.random() < 0.4 else _slip(word, rng)
        )
    return " ".join(words)


def _slip(word: str, rng: random.Random) -> str:
    at = rng.randrange(1, len(word) - 1)
    match rng.randrange(4):
        case 0:
            return word[:at] + word[at + 1] + word[at] + word[at + 2 :]
        case 1:
            return word[:at] + word[at + 1 :]
        case 2:
            return word[:at] + word[at] + word[at:]
        case _:
            return word[:at] + rng.choice("aeionrst") + word[at + 1 :]


def _finished(text: str, rng: random.Random) -> str:
    """With capital and full stop, or without."""
    draw = rng.random()
    if draw < 0.85:
        text = text[:1].upper() + text[1:]
    if draw > 0.99:
        text = text[1:]
    draw = rng.random()
    stop = "." if draw < 0.82 else "" if draw < 0.95 else " ." if draw < 0.98 else ". "
    return text + stop
