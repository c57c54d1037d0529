"""The program language for an editor: its words with signatures and documentation, and what is wrong with a text."""

from __future__ import annotations

import inspect
from functools import cache

from pydantic import BaseModel

from lilgym_mp.programs import ProgramError
from lilgym_mp.programs.syntax import ATTRIBUTES, METHODS, SCENE_NAMES, parse
from lilgym_mp.programs.values import ENUMS, BoxView
from lilgym_mp.programs.words import GROUPS, WORDS

KEYWORDS = ("lambda", "and", "or", "not", "in", "True", "False")
SCENE_MEANINGS = {
    "all_boxes": ("list of boxes", "The three boxes, left to right."),
    "all_items": ("list of items", "Every item of the scene, box by box."),
}
MEMBER_MEANINGS = {
    "box": ("item.box -> box", "The box that the item is in."),
    "color": ("item.color -> Color", "The item's colour."),
    "shape": ("item.shape -> Shape", "The item's shape."),
    "size": ("item.size -> Size", "The item's size."),
}


class WordBody(BaseModel):
    """Something that can stand in a program."""

    name: str
    group: str
    signature: str
    meaning: str
    is_function: bool


class LanguageBody(BaseModel):
    """Everything that the editor completes."""

    groups: list[str]
    words: list[WordBody]


class CheckBody(BaseModel):
    """Whether a text is a program; where not, what is wrong and where, counted in characters from 0."""

    ok: bool
    offset: int
    length: int
    message: str


@cache
def language() -> LanguageBody:
    """The language's own tables."""
    words = [
        WordBody(
            name=word.name, group=word.group, signature=word.signature, meaning=_line(word.meaning), is_function=True
        )
        for word in WORDS.values()
    ]
    for name in SCENE_NAMES:
        kind, meaning = SCENE_MEANINGS[name]
        words.append(_value(name, "scene", f"{name}: {kind}", meaning))
    for name, kind in ENUMS.items():
        for member in kind:
            words.append(_value(f"{name}.{member.name}", "values", f"{name}.{member.name}", f"A member of {name}."))
    for name in ATTRIBUTES:
        words.append(_value(f".{name}", "members", *MEMBER_MEANINGS[name]))
    for name in METHODS:
        meaning = inspect.getdoc(getattr(BoxView, name)) or ""
        words.append(_value(f".{name}()", "members", f"box.{name}()", _line(meaning)))
    words.extend(_value(name, "Python", name, "As in Python.") for name in KEYWORDS)
    return LanguageBody(groups=[*GROUPS, "scene", "values", "members", "Python"], words=words)


def _line(meaning: str) -> str:
    return " ".join(meaning.split())


def _value(name: str, group: str, signature: str, meaning: str) -> WordBody:
    return WordBody(name=name, group=group, signature=signature, meaning=meaning, is_function=False)


def check(source: str) -> CheckBody:
    """What the language says of a text."""
    try:
        parse(source)
    except ProgramError as fault:
        return CheckBody(ok=False, offset=fault.offset, length=max(1, len(fault.piece)), message=fault.reason)
    return CheckBody(ok=True, offset=0, length=0, message="")
