"""Program-language reference and syntax check for the editor."""

from __future__ import annotations

import inspect
from functools import cache

from lilgym_mp.contrib.web.bodies import JSON, pick
from lilgym_mp.programs import ProgramError
from lilgym_mp.programs.syntax import ATTRIBUTES, METHODS, SCENE_NAMES, parse
from lilgym_mp.programs.values import ENUMS, BoxView
from lilgym_mp.programs.words import GROUPS, WORDS

KEYWORDS = ("lambda", "and", "or", "not", "in", "True", "False")
SCENE_VARIABLES = {
    "all_boxes": ("list of boxes", "The three boxes, left to right."),
    "all_items": ("list of items", "Every item of the scene, box by box."),
}
ATTRIBUTE_SIGNATURES = {
    "box": ("item.box -> box", "The box that holds the item."),
    "color": ("item.color -> Color", "The item's colour."),
    "shape": ("item.shape -> Shape", "The item's shape."),
    "size": ("item.size -> Size", "The item's size."),
}


@cache
def language() -> JSON:
    """All words of the language, for completion and the word list, from the language's own tables."""
    words = [
        {**pick(word, "name", "group", "signature"), "meaning": _single_line(word.meaning), "is_function": True}
        for word in WORDS.values()
    ]
    for name in SCENE_NAMES:
        type_name, meaning = SCENE_VARIABLES[name]
        words.append(_non_function(name, "scene", f"{name}: {type_name}", meaning))
    for name, enum in ENUMS.items():
        for member in enum:
            qualified = f"{name}.{member.name}"
            words.append(_non_function(qualified, "values", qualified, f"A member of {name}."))
    for name in ATTRIBUTES:
        words.append(_non_function(f".{name}", "members", *ATTRIBUTE_SIGNATURES[name]))
    for name in METHODS:
        meaning = inspect.getdoc(getattr(BoxView, name)) or ""
        words.append(_non_function(f".{name}()", "members", f"box.{name}()", _single_line(meaning)))
    words.extend(_non_function(name, "Python", name, "As in Python.") for name in KEYWORDS)
    return {"groups": [*GROUPS, "scene", "values", "members", "Python"], "words": words}


def _single_line(meaning: str) -> str:
    return " ".join(meaning.replace("`", "").split())


def _non_function(name: str, group: str, signature: str, meaning: str) -> JSON:
    return {"name": name, "group": group, "signature": signature, "meaning": meaning, "is_function": False}


def check(source: str) -> JSON:
    """Whether a text parses as a program; if not, the error and its position in characters, from 0."""
    try:
        parse(source)
    except ProgramError as fault:
        return {"ok": False, "offset": fault.offset, "length": max(1, len(fault.piece)), "message": fault.reason}
    return {"ok": True, "offset": 0, "length": 0, "message": ""}
