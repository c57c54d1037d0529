"""Parses the replies of language models: one action, or none if the reply is ambiguous.

An action is named as by `describe`, "ADD(LEFT, BLUE)", or in words, "add left blue", "remove 3 4", "stop". Action
numbers count only where they are unambiguous: alone, alone on the last line, or after "action" or "answer".
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from enum import IntEnum
from typing import NamedTuple

from lilgym_mp.actions import BOX_NAMES, STOP, Action, ActionError, AddBlock, AddItem, RemoveBlock, RemoveItem
from lilgym_mp.appearances import Appearance, Scatter
from lilgym_mp.scene import Colour, Shape, Size


class Reply(NamedTuple):
    """A parsed reply."""

    action: int  # action index
    understood: bool  # False: no action or an ambiguous one, so `action` is the default


class _Mention(NamedTuple):
    """A span of the reply that mentions an action."""

    start: int
    end: int
    action: int | None  # action index; None: unknown or incomplete
    is_stop: bool


_THOUGHT_END = re.compile(r"</(?:think|thinking|reasoning)>", re.IGNORECASE)
_CALL = re.compile(r"\b(?P<verb>ADD|REMOVE)\s*\((?P<inside>[^()]*)\)|\bSTOP\b(?:\s*\(\s*\))?", re.IGNORECASE)
_PHRASE = re.compile(
    r"\b(?P<verb>add|remove)\b(?P<inside>(?:(?!\b(?:because|since|so|which|in order)\b)[^.;:!?\n])*)", re.IGNORECASE
)
_NUMBERED = re.compile(
    r"\b(?:action|answer)(?:\s+(?:number|no\.?|is))?\s*[:=#]?\s*(?P<number>\d+)\b(?!\s*[.,]\d)", re.IGNORECASE
)
_LEADING_NUMBER = re.compile(r"(?:^|\b(?:action|answer|number)\b)\W*(?P<number>\d+)\s*[:.)=-]*\s*\(?$", re.IGNORECASE)
# Allowed around an action on its own line: markup, bullets, "Answer:", "My next action is".
_DECORATION = " \t*_`'\"#>$\\{}[]"
_LABEL = re.compile(
    r"^(?:(?:so|therefore|thus|ok(?:ay)?)[\s,:]+)?(?:(?:my|the|final|next|best|chosen|single)\s+)*"
    r"(?:answer|action|move|choice|decision)(?:\s+is)?\s*[:=]?\s*",
    re.IGNORECASE,
)

_CLAUSE_END = re.compile(r"[,;:!?\n—–]|\.(?!\d)|\b(?:but|so|therefore|hence|thus|because|since)\b", re.IGNORECASE)
_SENTENCE_END = re.compile(r"[;!?\n]|\.(?!\d)")
_NEGATION = re.compile(
    r"\b(?:not|never|cannot|avoid|instead\s+of|rather\s+than|without|neither|nor|no\s+need)\b|n['’]t\b", re.IGNORECASE
)
_CONDITION = re.compile(r"\b(?:if|unless|whether|when|until|once|after|before|had)\b", re.IGNORECASE)
_REJECTION = re.compile(
    r"^\W*(?:is|was|would\s+be|seems|looks)\s+(?:not\b|too\s+early|premature|wrong|illegal|invalid|impossible|an?\s+mistake)"
    r"|^\W*(?:isn|wasn|wouldn|won|doesn|can)['’]t\b|^\W*(?:cannot|would\s+not|does\s+not)\b",
    re.IGNORECASE,
)
_LATER = re.compile(
    r"\b(?:then|next|after\s+that|afterwards?|later|finally|followed\s+by|subsequently)\b|->|→", re.IGNORECASE
)
_ALSO = re.compile(r"\b(?:and|plus|or)\b|\+", re.IGNORECASE)
_FRESH_START = re.compile(r"\b(?:no|better|actually|instead|wait|rather|final)\b", re.IGNORECASE)

_BOXES = {name: index for index, name in enumerate(BOX_NAMES)}
_FILLERS = frozenset(
    word.upper() for word in ("a", "an", "the", "one", "to", "in", "into", "at", "on", "of", "from", "top", "block")
) | frozenset(("ITEM", "OBJECT", "BOX", "TOWER", "CELL", "COLUMN", "ROW", "COL"))
_TOWER_FILLERS = frozenset(("MEDIUM", "SQUARE"))  # properties of every block


def parse_reply(reply: str, appearance: Appearance, default: int, shown: Collection[int] | None = None) -> Reply:
    """The action that `reply` chooses; `default`, not understood, if there is none or several.

    If the last line is exactly one action, that is it. Otherwise the last action named, ignoring negated, questioned
    and hypothetical ones; otherwise a number after "action" or "answer". `shown`: the action numbers that the agent
    was shown; None: all.
    """
    text = _THOUGHT_END.split(reply)[-1]
    index = _chosen(text, appearance, range(appearance.action_count) if shown is None else shown)
    return Reply(default, understood=False) if index is None else Reply(index, understood=True)


def _chosen(text: str, appearance: Appearance, shown: Collection[int]) -> int | None:
    lines = [line for line in text.splitlines() if line.strip(_DECORATION + ".")]
    if not lines:
        return None
    last = _whole_line(lines[-1], appearance, shown)
    if last is not None:
        earlier = _whole_line(lines[-2], appearance, shown) if len(lines) > 1 else None
        is_plan = earlier not in (None, last) and not _LABEL.match(lines[-1].strip(_DECORATION))
        return None if is_plan else last
    mentions = list(_calls(text, appearance))
    if all(mention.is_stop for mention in mentions):
        mentions = sorted([*mentions, *_phrases(text, appearance)])
    return _last_asserted(text, mentions or list(_numbered(text, appearance.action_count, shown)))


def _whole_line(line: str, appearance: Appearance, shown: Collection[int]) -> int | None:
    """The action if the line consists of exactly one."""
    bare = _LABEL.sub("", line.strip(_DECORATION).removeprefix("- ")).strip(_DECORATION)
    bare = bare.removesuffix(".").strip(_DECORATION)
    if bare.isdecimal():
        return _shown_index(int(bare), appearance.action_count, shown)
    number = re.match(r"(\d+)\s*[:.)=-]*\s+", bare)
    name = bare[number.end() :] if number else bare
    if name.startswith("(") and name.endswith(")"):
        name = name[1:-1]
    match = _CALL.fullmatch(name) or _PHRASE.fullmatch(name)
    action = _encoded(match, appearance) if match else None
    return None if number and int(number[1]) != action else action


def _shown_index(number: int, count: int, shown: Collection[int]) -> int | None:
    return number if number < count and number in shown else None


def _calls(text: str, appearance: Appearance) -> Iterator[_Mention]:
    """Actions in the form of `describe`; STOP only in capitals, because prose uses the verb."""
    for match in _CALL.finditer(text):
        if match["verb"] is None and not match[0].startswith("STOP"):
            continue
        action = _encoded(match, appearance)
        before = _LEADING_NUMBER.search(text[: match.start()].rsplit("\n", 1)[-1])
        if before is not None and int(before["number"]) != action:
            action = None  # such as "action 4: ADD(LEFT, BLUE)" if action 4 is a different one
        yield _Mention(match.start(), match.end(), action, is_stop=match["verb"] is None)


def _phrases(text: str, appearance: Appearance) -> Iterator[_Mention]:
    """Actions in words, if they have at least one argument."""
    for match in _PHRASE.finditer(text):
        if _has_argument(match["inside"]):
            yield _Mention(match.start(), match.end(), _encoded(match, appearance), is_stop=False)


def _encoded(match: re.Match[str], appearance: Appearance) -> int | None:
    """The index of the action in a match of _CALL or _PHRASE."""
    if match["verb"] is None:
        return appearance.encode(STOP)
    words = _words(match["inside"])
    action = (_scatter_action if isinstance(appearance, Scatter) else _tower_action)(match["verb"].upper(), words)
    try:
        return None if action is None else appearance.encode(action)
    except ActionError:
        return None


def _words(inside: str) -> list[str]:
    """The words of an action's arguments, without fillers; "row 4, column 3" is put in column-row order."""
    words = re.findall(r"\w+", inside.upper())
    for first, second in (("ROW", "COLUMN"), ("ROW", "COL")):
        if first in words and second in words and words.index(first) < words.index(second):
            row, column = (words.index(name) + 1 for name in (first, second))
            if row < len(words) and column < len(words):
                words[row], words[column] = words[column], words[row]
    return [word for word in words if word not in _FILLERS]


def _has_argument(inside: str) -> bool:
    """Whether any word could be an argument."""
    return any(
        word.isdecimal() or word in _BOXES or any(word in members.__members__ for members in (Colour, Shape, Size))
        for word in _words(inside)
    )


def _tower_action(verb: str, words: list[str]) -> Action | None:
    words = [word for word in words if word not in _TOWER_FILLERS]
    match verb, sorted(words, key=lambda word: word not in _BOXES):
        case "ADD", [box, colour] if box in _BOXES and colour in Colour.__members__:
            return AddBlock(_BOXES[box], Colour[colour])
        case "REMOVE", [box] if box in _BOXES:
            return RemoveBlock(_BOXES[box])
        case _:
            return None


def _scatter_action(verb: str, words: list[str]) -> Action | None:
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


def _numbered(text: str, count: int, shown: Collection[int]) -> Iterator[_Mention]:
    """Numbers after "action" or "answer"."""
    for match in _NUMBERED.finditer(text):
        yield _Mention(match.start(), match.end(), _shown_index(int(match["number"]), count, shown), is_stop=False)


def _last_asserted(text: str, mentions: list[_Mention]) -> int | None:
    """The last mentioned action that the reply asserts; None if it is one step of a plan."""
    asserted = [mention for mention in mentions if not _is_hypothetical(text, mention.start, mention.end)]
    if not asserted:
        return None
    last = asserted[-1]
    is_plan = any(
        earlier.action != last.action and _continues_plan(text[earlier.end : last.start]) for earlier in asserted[:-1]
    )
    return None if is_plan else last.action


def _continues_plan(between: str) -> bool:
    """Whether the text between two actions makes the second a further step of a plan, not a change of mind."""
    tail = _last_part(_SENTENCE_END, between)
    if _FRESH_START.search(tail):
        return False
    if not re.search(r"[^\W\d]", between):
        return True
    return bool(_LATER.search(tail) or (tail == between and _ALSO.search(tail)))


def _is_hypothetical(text: str, start: int, end: int) -> bool:
    """Whether text[start:end] is negated, questioned or hypothetical rather than asserted."""
    clause = _last_part(_CLAUSE_END, text[:start])
    sentence_end = _SENTENCE_END.search(text, end)
    is_question = sentence_end is not None and sentence_end[0] == "?"
    return bool(is_question or _NEGATION.search(clause) or _CONDITION.search(clause) or _REJECTION.search(text[end:]))


def _last_part(boundary: re.Pattern[str], text: str) -> str:
    """The text after the last match of `boundary`."""
    ends = [match.end() for match in boundary.finditer(text)]
    return text[ends[-1] :] if ends else text
