"""Statements with their colours, shapes, sizes and numbers blanked: what is left is the form."""

from __future__ import annotations

from lilgym_mp.corpus.tokens import words

_NUMBERS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")
_BLANKS: dict[str, str] = {
    **dict.fromkeys(("yellow", "black", "blue"), "COLOUR"),
    **dict.fromkeys(("circle", "circles", "square", "squares", "triangle", "triangles"), "SHAPE"),
    **dict.fromkeys(("small", "medium", "big", "large"), "SIZE"),
    **dict.fromkeys(_NUMBERS, "NUMBER"),
}


def normalised(statement: str) -> str:
    """The statement in lower case without punctuation: equal for what a reader takes to be the same sentence."""
    return " ".join(words(statement))


def statement_form(statement: str) -> str:
    """The normalised statement with a blank for each colour, shape, size and number, in words or digits."""
    return " ".join("NUMBER" if word.isdigit() else _BLANKS.get(word, word) for word in words(statement))
