"""Parses the replies of language models: one action, or none if the reply is unclear.

The answer stands on a line of its own, as `describe` names it, "ADD(LEFT, BLUE)", in words, "add left blue" or
"add_left_blue", or by its number.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from enum import IntEnum
from typing import NamedTuple

from lilgym_mp.actions import BOX_NAMES, STOP, Action, ActionError, AddBlock, AddItem, RemoveBlock, RemoveItem
from lilgym_mp.appearances import Appearance
from lilgym_mp.scene import Colour, Shape, Size


class Reply(NamedTuple):
    """A parsed reply."""

    action: int  # action index
    understood: bool  # False: no action or several, so `action` is the default


MAX_REPLY = 500_000  # characters; a longer reply is not understood
MAX_ANSWER = 20_000  # the same after the thought
MAX_LINE = 200  # a longer line names no action

_THOUGHT_TAG = re.compile(r"<(?P<end>/?)(?:think|thinking|thought|reasoning)>", re.IGNORECASE)
_DECORATION = " \t\n\r*_`'\"#>$\\{}[]"  # allowed around an action on its line
_ENCLOSED = re.compile(
    r"\\boxed\s*\{(?:\\text\s*\{)?(?P<boxed>[^{}\n]*)\}|<(?P<tag>answer|action)>(?P<tagged>[^<>]*)</(?P=tag)>",
    re.IGNORECASE,
)
_LABELLED = re.compile(
    r"^[ \t*_`'\"#>{-]*(?:(?:my|the|final|next|best|chosen)[ \t]+){0,3}(?:answer|action)"
    r"[*_`'\"]*[ \t]*[:=](?P<answer>[^\n]*)",
    re.IGNORECASE | re.MULTILINE,
)
_LEAD_IN = re.compile(
    r"^(?:(?:so|therefore|thus|ok(?:ay)?)[\s,:]+)?(?:i (?:choose|take|pick)|"
    r"(?:(?:my|the|final|next|best|chosen|single)\s+){0,3}(?:answer|action|move|choice|decision)(?:\s+is)?)?\s*[:=]?\s*",
    re.IGNORECASE,
)
_NUMBER = re.compile(r"(?:(?:action|number|no\.?)\s+)*(?P<number>\d+)", re.IGNORECASE)
_NUMBERED = re.compile(r"(?P<number>\d+)\s*[:.)=-]*\s+")
_CALL = re.compile(r"(?P<verb>ADD|REMOVE)\s*\((?P<inside>[^()]*)\)|STOP(?:\s*\(\s*\))?", re.IGNORECASE)
_PHRASE = re.compile(r"(?P<verb>add|remove)\b(?P<inside>[\w\s,-]*)", re.IGNORECASE)

_BOXES = {name: index for index, name in enumerate(BOX_NAMES)}
_FILLERS = frozenset(
    word.upper() for word in ("a", "an", "the", "one", "to", "in", "into", "at", "on", "of", "from", "top", "block")
) | frozenset(("ITEM", "OBJECT", "BOX", "TOWER", "CELL", "COLUMN", "ROW", "COL"))
_TOWER_FILLERS = frozenset(("MEDIUM", "SQUARE"))  # properties of every block


def parse_reply(
    reply: str, appearance: Appearance, default: int, is_shown: Callable[[int], bool] = lambda index: True
) -> Reply:
    """The action that `reply` chooses; `default`, not understood, if there is none or several.

    Text up to the end of a thought ("</think>") is ignored; a reply whose thought does not end is not understood. If
    answers are marked ("Action: ...", "Answer: ...", "<answer>...</answer>", "\\boxed{...}"), only they count,
    otherwise every line that consists of one action; all of them must name the same. A number counts only if marked or
    on the last line, and if the agent was shown it (`is_shown`).
    """
    text = without_thought(reply)
    if text is None:
        return Reply(default, understood=False)
    named = _named(text, appearance, is_shown)
    (action,) = named if len(named) == 1 else (None,)
    return Reply(default, understood=False) if action is None else Reply(action, understood=True)


def without_thought(reply: str) -> str | None:
    """The reply after its last thought; None if a thought does not end or the reply is too long."""
    if len(reply) > MAX_REPLY:
        return None
    end: int | None = 0
    for tag in _THOUGHT_TAG.finditer(reply):
        end = tag.end() if tag["end"] else None
    return None if end is None or len(reply) - end > MAX_ANSWER else reply[end:]


def marked_answers(text: str) -> list[str]:
    """The parts marked as the answer, without markup: enclosed ones if there are any, otherwise labelled ones."""
    found = [match["boxed"] or match["tagged"] or "" for match in _ENCLOSED.finditer(text)]
    found = found or [match["answer"] for match in _LABELLED.finditer(text)]
    return [answer for answer in (each.strip(_DECORATION) for each in found) if answer]


def _named(text: str, appearance: Appearance, is_shown: Callable[[int], bool]) -> set[int | None]:
    """The actions that the reply names; None stands for a marked answer that is no action."""
    if marked := marked_answers(text):
        return {action_on(answer, appearance, is_shown) for answer in marked}
    lines = [line for line in text.splitlines() if line.strip(_DECORATION + ".")]
    actions = {action_on(line, appearance) for line in lines[:-1]}
    return {*actions, *(action_on(line, appearance, is_shown) for line in lines[-1:])} - {None}


def action_on(line: str, appearance: Appearance, is_shown: Callable[[int], bool] = lambda index: False) -> int | None:
    """The action if the line consists of exactly one; its number alone counts only if it `is_shown`."""
    if len(line) > MAX_LINE:
        return None
    bare = _LEAD_IN.sub("", line.strip(_DECORATION).removeprefix("- ")).strip(_DECORATION)
    bare = bare.removesuffix(".").strip(_DECORATION)
    if alone := _NUMBER.fullmatch(bare):
        number = int(alone["number"])
        return number if number < appearance.action_count and is_shown(number) else None
    numbered = _NUMBERED.match(bare)
    name = bare[numbered.end() :] if numbered else bare
    if name.startswith("(") and name.endswith(")"):
        name = name[1:-1]
    name = name.replace("_", " ")
    match = _CALL.fullmatch(name) or _PHRASE.fullmatch(name)
    action = _encoded(match, appearance) if match else None
    return None if numbered and int(numbered["number"]) != action else action


def _encoded(match: re.Match[str], appearance: Appearance) -> int | None:
    """The index of the action in a match of _CALL or _PHRASE."""
    if match.re is _CALL and match["verb"] is None:
        return appearance.encode(STOP)
    words = list(_words(match["inside"]))
    action = (_block_action if appearance.grid is None else _item_action)(match["verb"].upper(), words)
    try:
        return None if action is None else appearance.encode(action)
    except ActionError:
        return None


def _words(inside: str) -> Iterator[str]:
    """The words of an action's arguments, without fillers; "row 4, column 3" is put in column-row order."""
    words = re.findall(r"\w+", inside.upper())
    for first, second in (("ROW", "COLUMN"), ("ROW", "COL")):
        if first in words and second in words and words.index(first) < words.index(second):
            row, column = (words.index(name) + 1 for name in (first, second))
            if row < len(words) and column < len(words):
                words[row], words[column] = words[column], words[row]
    return (word for word in words if word not in _FILLERS)


def _block_action(verb: str, words: list[str]) -> Action | None:
    words = [word for word in words if word not in _TOWER_FILLERS]
    match verb, sorted(words, key=lambda word: word not in _BOXES):
        case "ADD", [box, colour] if box in _BOXES and colour in Colour.__members__:
            return AddBlock(_BOXES[box], Colour[colour])
        case "REMOVE", [box] if box in _BOXES:
            return RemoveBlock(_BOXES[box])
        case _:
            return None


def _item_action(verb: str, words: list[str]) -> Action | None:
    numbers = [int(word) for word in words if word.isdecimal()]
    attributes = [word for word in words if not word.isdecimal()]
    if len(numbers) != 2:
        return None
    column, row = numbers
    if verb == "REMOVE":
        return None if attributes else RemoveItem(column, row)
    enums: tuple[type[IntEnum], ...] = (Shape, Colour, Size)
    found = [[word for word in attributes if word in enum.__members__] for enum in enums]
    if len(attributes) != len(enums) or any(len(words) != 1 for words in found):
        return None
    (shape,), (colour,), (size,) = found
    return AddItem(column, row, Shape[shape], Colour[colour], Size[size])
