"""What the reply of an agent that writes text comes to: one action, or none where it is not plain which.

An action is named by `describe`'s form, "ADD(LEFT, BLUE)", or in words, "add left blue", "remove 3 4", "stop". Numbers
count where nothing else can be meant: alone, on the last line alone, or after the word "action" or "answer".
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
    """What an agent's reply comes to."""

    action: int
    understood: bool  # False: it names no action, or not plainly one, so `action` is the default


class _Mention(NamedTuple):
    """A place in a reply that speaks of an action."""

    start: int
    end: int
    action: int | None  # its number; None: no action is called so, or it is not said completely
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
# What may stand around an action on a line of its own: marks, bullets, "Answer:", "My next action is".
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

_BOXES = {name: number for number, name in enumerate(BOX_NAMES)}
_FILLERS = frozenset(
    word.upper() for word in ("a", "an", "the", "one", "to", "in", "into", "at", "on", "of", "from", "top", "block")
) | frozenset(("ITEM", "OBJECT", "BOX", "TOWER", "CELL", "COLUMN", "ROW", "COL"))
_TOWER_FILLERS = frozenset(("MEDIUM", "SQUARE"))  # what every block is


def parse_reply(reply: str, appearance: Appearance, default: int, shown: Collection[int] | None = None) -> Reply:
    """The action that `reply` decides for; `default`, not understood, where it is none or not plainly one.

    The last line counts if it is one action and nothing else; else the action named last, but for those denied,
    asked or supposed; a number only after "action" or "answer", where no action is named. `shown`: the numbers that
    the agent was told; None: all.
    """
    text = _THOUGHT_END.split(reply)[-1]
    number = _decided(text, appearance, range(appearance.action_count) if shown is None else shown)
    return Reply(default, understood=False) if number is None else Reply(number, understood=True)


def _decided(text: str, appearance: Appearance, shown: Collection[int]) -> int | None:
    lines = [line for line in text.splitlines() if line.strip(_DECORATION + ".")]
    if not lines:
        return None
    last = _alone(lines[-1], appearance, shown)
    if last is not None:
        earlier = _alone(lines[-2], appearance, shown) if len(lines) > 1 else None
        is_plan = earlier not in (None, last) and not _LABEL.match(lines[-1].strip(_DECORATION))
        return None if is_plan else last
    mentions = list(_calls(text, appearance))
    if all(mention.is_stop for mention in mentions):
        mentions = sorted([*mentions, *_phrases(text, appearance)])
    return _last_meant(text, mentions or list(_numbered(text, appearance.action_count, shown)))


def _alone(line: str, appearance: Appearance, shown: Collection[int]) -> int | None:
    """The action that a line is, and nothing else."""
    bare = _LABEL.sub("", line.strip(_DECORATION).removeprefix("- ")).strip(_DECORATION)
    bare = bare.removesuffix(".").strip(_DECORATION)
    if bare.isdecimal():
        return _known(int(bare), appearance.action_count, shown)
    number = re.match(r"(\d+)\s*[:.)=-]*\s+", bare)
    name = bare[number.end() :] if number else bare
    if name.startswith("(") and name.endswith(")"):
        name = name[1:-1]
    match = _CALL.fullmatch(name) or _PHRASE.fullmatch(name)
    action = _encoded(match, appearance) if match else None
    return None if number and int(number[1]) != action else action


def _known(number: int, count: int, shown: Collection[int]) -> int | None:
    return number if number < count and number in shown else None


def _calls(text: str, appearance: Appearance) -> Iterator[_Mention]:
    """The actions named by their form; STOP in capitals, so that prose may use the verb."""
    for match in _CALL.finditer(text):
        if match["verb"] is None and not match[0].startswith("STOP"):
            continue
        action = _encoded(match, appearance)
        before = _LEADING_NUMBER.search(text[: match.start()].rsplit("\n", 1)[-1])
        if before is not None and int(before["number"]) != action:
            action = None  # such as "action 4: ADD(LEFT, BLUE)", where action 4 is another
        yield _Mention(match.start(), match.end(), action, is_stop=match["verb"] is None)


def _phrases(text: str, appearance: Appearance) -> Iterator[_Mention]:
    """The actions named in words, where any of their arguments are given."""
    for match in _PHRASE.finditer(text):
        if _values(match["inside"]):
            yield _Mention(match.start(), match.end(), _encoded(match, appearance), is_stop=False)


def _encoded(match: re.Match[str], appearance: Appearance) -> int | None:
    """The number of the action that a match of _CALL or _PHRASE names."""
    if match["verb"] is None:
        return appearance.encode(STOP)
    words = _words(match["inside"])
    action = (_scatter_action if isinstance(appearance, Scatter) else _tower_action)(match["verb"].upper(), words)
    try:
        return None if action is None else appearance.encode(action)
    except ActionError:
        return None


def _words(inside: str) -> list[str]:
    """The words of an action's arguments, "column 3" and "row 4" in this order, fillers left out."""
    words = re.findall(r"\w+", inside.upper())
    for first, second in (("ROW", "COLUMN"), ("ROW", "COL")):
        if first in words and second in words and words.index(first) < words.index(second):
            row, column = (words.index(name) + 1 for name in (first, second))
            if row < len(words) and column < len(words):
                words[row], words[column] = words[column], words[row]
    return [word for word in words if word not in _FILLERS]


def _values(inside: str) -> bool:
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
    looks = [word for word in words if not word.isdecimal()]
    if len(numbers) != 2:
        return None
    column, row = numbers
    if verb == "REMOVE":
        return None if looks else RemoveItem(column, row)
    kinds: tuple[type[IntEnum], ...] = (Shape, Colour, Size)
    found = [[word for word in looks if word in kind.__members__] for kind in kinds]
    if len(looks) != len(kinds) or any(len(words) != 1 for words in found):
        return None
    (shape,), (colour,), (size,) = found
    return AddItem(column, row, Shape[shape], Colour[colour], Size[size])


def _numbered(text: str, count: int, shown: Collection[int]) -> Iterator[_Mention]:
    """The numbers that follow "action" or "answer"."""
    for match in _NUMBERED.finditer(text):
        yield _Mention(match.start(), match.end(), _known(int(match["number"]), count, shown), is_stop=False)


def _last_meant(text: str, mentions: list[_Mention]) -> int | None:
    """The action of the last mention that is not denied; None where it is one of several to be done."""
    meant = [mention for mention in mentions if not _is_denied(text, mention.start, mention.end)]
    if not meant:
        return None
    last = meant[-1]
    goes_on = any(earlier.action != last.action and _goes_on(text[earlier.end : last.start]) for earlier in meant[:-1])
    return None if goes_on else last.action


def _goes_on(between: str) -> bool:
    """Whether what stands between two actions makes the second one more thing to do, not a change of mind."""
    tail = _last_part(_SENTENCE_END, between)
    if _FRESH_START.search(tail):
        return False
    if not re.search(r"[^\W\d]", between):
        return True
    return bool(_LATER.search(tail) or (tail == between and _ALSO.search(tail)))


def _is_denied(text: str, start: int, end: int) -> bool:
    """Whether text[start:end] is denied, asked or supposed rather than said."""
    clause = _last_part(_CLAUSE_END, text[:start])
    sentence_end = _SENTENCE_END.search(text, end)
    asked = sentence_end is not None and sentence_end[0] == "?"
    return bool(asked or _NEGATION.search(clause) or _CONDITION.search(clause) or _REJECTION.search(text[end:]))


def _last_part(boundary: re.Pattern[str], text: str) -> str:
    """What follows the last match of `boundary`."""
    ends = [match.end() for match in boundary.finditer(text)]
    return text[ends[-1] :] if ends else text
