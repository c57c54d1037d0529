"""Statement forms: statements with colours, shapes, sizes and numbers replaced by placeholders."""

from __future__ import annotations

from lilgym_mp.corpus.tokens import words

_NUMBERS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")
_PLACEHOLDERS: dict[str, str] = {
    **dict.fromkeys(("yellow", "black", "blue"), "COLOUR"),
    **dict.fromkeys(("circle", "circles", "square", "squares", "triangle", "triangles"), "SHAPE"),
    **dict.fromkeys(("small", "medium", "big", "large"), "SIZE"),
    **dict.fromkeys(_NUMBERS, "NUMBER"),
}


def normalised(statement: str) -> str:
    """The statement in lower case without punctuation."""
    return " ".join(words(statement))


def statement_form(statement: str) -> str:
    """The normalised statement with a placeholder for each colour, shape, size and number (words or digits)."""
    return " ".join("NUMBER" if word.isdigit() else _PLACEHOLDERS.get(word, word) for word in words(statement))
