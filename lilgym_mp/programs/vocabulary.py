"""All words of the language with their meanings, for editors and lists."""

from __future__ import annotations

import inspect
from functools import cache
from typing import NamedTuple

from lilgym_mp.programs.syntax import ATTRIBUTES, METHODS
from lilgym_mp.programs.values import ENUMS, BoxView
from lilgym_mp.programs.words import GROUPS, WORDS

# What is no function, by group: name and meaning.
OTHERS = {
    "scene": {"all_boxes": "The three boxes, left to right.", "all_items": "Every item of the scene, box by box."},
    "values": {f"{name}.{each.name}": f"A member of {name}." for name, members in ENUMS.items() for each in members},
    "members": {f".{name}": f"The item's {name}." for name in ATTRIBUTES}
    | {f".{name}()": inspect.getdoc(getattr(BoxView, name)) or "" for name in METHODS},
    "Python": dict.fromkeys(("lambda", "and", "or", "not", "in", "True", "False"), "As in Python."),
}


class DocumentedName(NamedTuple):
    """A word, or a name or member that programs can use."""

    name: str
    group: str
    signature: str
    meaning: str  # in one line
    is_function: bool


@cache
def vocabulary() -> tuple[DocumentedName, ...]:
    """Every word, group by group."""
    words = [DocumentedName(word.name, word.group, word.signature, word.meaning, True) for word in WORDS.values()]
    order: list[str] = list(GROUPS)
    words.sort(key=lambda word: order.index(word.group))
    others = [
        DocumentedName(name, group, name, text, False)
        for group, found in OTHERS.items()
        for name, text in found.items()
    ]
    return tuple(
        entry._replace(meaning=" ".join(entry.meaning.replace("`", "").split())) for entry in (*words, *others)
    )
