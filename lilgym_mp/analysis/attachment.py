"""Detects ambiguous attachment of conjuncts and prepositional phrases in statements.

Each word is tagged with a letter for its part of speech, and regular expressions over the letters look for phrases with
two possible attachment sites. There is no parser: words outside the lists below end every phrase.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from lilgym_mp.corpus.spelling import plain_words

_SHAPES = ("circle", "square", "triangle", "block", "tower", "stack", "box", "item", "object", "shape")
_PARTS = ("base", "top", "bottom", "roof", "middle", "side", "wall", "edge", "corner", "line", "position")
_MEASURES = ("color", "colour", "size", "height")
_PLURALS = {"box": "boxes"}
_SINGULARS = (*_SHAPES, *_PARTS, *_MEASURES)
_WORDS: dict[str, Sequence[str]] = {
    "n": (*_SINGULARS, *(_PLURALS.get(noun, f"{noun}s") for noun in _SINGULARS), "it", "them", "ones"),
    "a": (
        *("yellow", "black", "blue", "grey", "small", "medium", "big", "large"),
        *("same", "different", "single", "first", "second", "third", "left", "right"),
    ),
    "d": (
        *("a", "an", "the", "all", "each", "every", "any", "some", "no", "both", "another", "other", "its", "their"),
        *("exactly", "only", "just", "atleast", "atmost", "more", "less", "fewer", "than", "many", "multiple", "not"),
    ),
    "p": (
        *("with", "without", "at", "on", "in", "inside", "above", "below", "over", "under", "underneath", "beneath"),
        *("as", "near", "between", "from", "by", "beside", "behind"),
    ),
    "o": ("of",),
    "c": ("and", "or"),
    "m": ("touching", "having", "containing", "stacked", "attached", "which", "that", "whose"),
    "v": ("is", "are", "has", "have", "contains", "contain"),
}
_TAGS = {word: tag for tag, words in _WORDS.items() for word in words}
_OTHER = "x"
_LIMITS = {"at": ("least", "most"), "more": ("than",), "less": ("than",), "fewer": ("than",)}

_NOUN_PHRASE = "[da]*n"
_PREPOSITIONAL = re.compile(rf"n[po]{_NOUN_PHRASE}(?:c{_NOUN_PHRASE})*p{_NOUN_PHRASE}")
_COORDINATION = (
    re.compile(rf"np(?:{_NOUN_PHRASE})+c[da]+n(?!v)"),  # a corner with two triangles and a square
    re.compile(rf"{_NOUN_PHRASE}c{_NOUN_PHRASE}[pm]"),  # a triangle and a square near the wall
    re.compile(r"ancn(?!v)"),  # small triangles and squares
)


def has_ambiguous_coordination(statement: str) -> bool:
    """`and` or `or` joins a noun phrase to one inside a prepositional phrase after another noun; or the second of two
    joined noun phrases is followed by a modifier (a preposition, `touching`, `which`, ...); or only the first of two
    joined nouns is preceded by an adjective.
    """
    tags = _tagged(statement)
    return any(pattern.search(tags) for pattern in _COORDINATION)


def has_ambiguous_preposition(statement: str) -> bool:
    """A noun is followed by a prepositional phrase (including `of`) and another one (except `of`)."""
    return _PREPOSITIONAL.search(_tagged(statement)) is not None


def _tagged(statement: str) -> str:
    """One part-of-speech letter per word; "at least" and the like are one determiner."""
    words = plain_words(statement)
    tags: list[str] = []
    for index, word in enumerate(words):
        following = words[index + 1] if index + 1 < len(words) else ""
        if word in ("least", "most") and index and words[index - 1] == "at":
            continue
        tags.append("d" if word.isdigit() or following in _LIMITS.get(word, ()) else _TAGS.get(word, _OTHER))
    return "".join(tags)
