"""Reads the answers in models' replies. Any text is either understood or not, in bounded time."""

from __future__ import annotations

import re
from collections.abc import Iterator

from lilgym_mp.actions import BOX_NAMES, STOP, AddBlock
from lilgym_mp.appearances import Appearance
from lilgym_mp.rules import RULE_SETS
from lilgym_mp.scene import Colour, Item, Scene, SceneError, Shape, Size
from lilgym_mp.wrappers.replies import action_on, marked_answers, without_thought

MAX_LINES = 500  # candidate lines of a plan

_ENCLOSED = re.compile(r"<answer>([^<>]*)</answer>", re.IGNORECASE)
_PLAN_LINE = re.compile(
    r"^[^\w\n]{0,9}(?:\d{1,3}[.):][ \t]+)?[^\w\n]{0,9}(?P<actions>(?:add|remove|stop)(?![^\W_])[^\n]*)$",
    re.IGNORECASE | re.MULTILINE,
)
_BETWEEN = re.compile(r";|->|→|(?<=\)),")
_BOX_LINE = re.compile(rf"^[^\w\n]*({'|'.join(BOX_NAMES)})(?: box)?[ \t]*:([^\n]*)$", re.I | re.M)
_ITEM = re.compile(r"(\w+) (\w+) (\w+) (?:at )?\((\d{1,3}), ?(\d{1,3})\)")
_TRUTHS = {"true": True, "false": False}


class NotUnderstood(ValueError):
    """A reply without a readable answer; the message says why."""


def read_plan(reply: object, appearance: Appearance) -> list[int]:
    """The indices of the actions on lines that consist of actions, in order. Raises NotUnderstood."""
    text = _answer_text(reply)
    plan: list[int] = []
    for number, line in enumerate(_PLAN_LINE.finditer(text)):
        if number >= MAX_LINES:
            raise NotUnderstood(f"more than {MAX_LINES} lines begin like actions")
        actions = [action_on(part, appearance) for part in _BETWEEN.split(line["actions"], MAX_LINES)]
        if all(action is not None for action in actions):
            plan += [action for action in actions if action is not None]
    if not plan:
        raise NotUnderstood("no line is an action")
    if appearance.encode(STOP) in plan[:-1]:
        raise NotUnderstood("actions follow STOP")
    return plan


def read_truth(reply: object) -> bool:
    """True or false. Raises NotUnderstood."""
    text = _answer_text(reply)
    lines = marked_answers(text) or text.splitlines()
    found = {_TRUTHS[word] for line in lines if (word := line.strip(" \t*_`.\"'").lower()) in _TRUTHS}
    if len(found) != 1:
        raise NotUnderstood("true and false are both answers" if found else "no line is true or false")
    return found.pop()


def read_scene(reply: object, appearance: Appearance) -> Scene:
    """The scene. Raises NotUnderstood, also for one that the appearance does not have."""
    boxes = {match[1].upper(): match[2] for match in _BOX_LINE.finditer(_answer_text(reply))}
    if set(boxes) != set(BOX_NAMES):
        raise NotUnderstood("there must be a line for each box, LEFT, MIDDLE and RIGHT")
    try:
        if appearance.grid is None:
            return _stacked([boxes[name] for name in BOX_NAMES], appearance)
        return appearance.check_scene(Scene.of(*(list(_items(boxes[name])) for name in BOX_NAMES)))
    except SceneError as error:
        raise NotUnderstood(f"no scene: {error}") from None


def read_program(reply: object) -> str:
    """The last line, without markup. Raises NotUnderstood."""
    lines = [line.strip(" \t`") for line in _answer_text(reply).splitlines()]
    programs = [line for line in lines if line and line != "python"]
    if not programs:
        raise NotUnderstood("there is no program")
    return re.sub(r"^\W*(?:answer|program)\W*[:=]\W*", "", programs[-1][:10_000], flags=re.IGNORECASE)


def _answer_text(reply: object) -> str:
    text = without_thought(reply) if isinstance(reply, str) else None
    if text is None:
        raise NotUnderstood("no text" if not isinstance(reply, str) else "a thought does not end, or it is too long")
    enclosed = _ENCLOSED.findall(text)
    return enclosed[-1] if enclosed else text


def _parts(line: str) -> Iterator[str]:
    parts = line.split(";", MAX_LINES)
    return (part.strip(" \t*`.") for part in parts if part.strip(" \t*`."))


def _stacked(boxes: list[str], appearance: Appearance) -> Scene:
    """Blocks named by colour, from the bottom."""
    scene = Scene.empty()
    for box, line in enumerate(boxes):
        for name in _parts(line):
            if name.upper() not in Colour.__members__:
                raise NotUnderstood(f"{name!r:.40} is not a colour")
            action = AddBlock(box, Colour[name.upper()])
            scene, invalid = appearance.apply(scene, action, RULE_SETS["paper"].placement)
            if invalid is not None:
                raise NotUnderstood(f"the {BOX_NAMES[box]} box holds no more blocks")
    return scene


def _items(line: str) -> Iterator[Item]:
    for part in _parts(line):
        match = _ITEM.fullmatch(part)
        try:
            if match is None:
                raise KeyError(part)
            size, colour, shape = (word.upper() for word in match.groups()[:3])
            yield Item(int(match[4]), int(match[5]), Shape[shape], Colour[colour], Size[size])
        except KeyError:
            raise NotUnderstood(f"{part!r:.60} is not an item like: small blue circle (10, 20)") from None
