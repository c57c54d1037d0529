"""Text commands for actions: "ADD(LEFT, BLUE)", as shown everywhere, or in words, "add left blue"."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from enum import IntEnum
from functools import partial
from typing import Any, TypeVar

from lilgym_mp.scene import Colour, Shape, Size
from lilgym_mp.scene.actions import BOX_NAMES, STOP, Action, AddBlock, AddItem, RemoveBlock, RemoveItem, describe
from lilgym_mp.scene.appearances import Appearance

Value = TypeVar("Value")
Words = Sequence[str]
Reader = Callable[[str], Any]  # of a word; raises CommandSyntaxError


class CommandSyntaxError(ValueError):
    """A line that is not a command; the message shows the valid form."""


def _names(members: type[IntEnum]) -> dict[str, Any]:
    return {member.name.lower(): member for member in members}


BOXES = {name.lower(): index for index, name in enumerate(BOX_NAMES)}
COLOURS, SHAPES, SIZES = _names(Colour), _names(Shape), _names(Size)
VERBS = {"add": "add", "remove": "remove", "stop": "stop"}
_PUNCTUATION = str.maketrans("(),", "   ")


def command_help(appearance: Appearance) -> list[str]:
    """Lines that describe the commands for edits."""
    return [usage for usage, readers, _ in _forms(appearance).values() if readers]


def words_of(line: str) -> list[str]:
    """The words of a line, without the brackets and commas of "ADD(LEFT, BLUE)"."""
    return line.lower().translate(_PUNCTUATION).split()


def parse_command(words: Words, appearance: Appearance) -> Action:
    """The action of a command; words may be abbreviated. Raises CommandSyntaxError."""
    verb = match_choice("command", words[0], VERBS)
    usage, readers, make = _forms(appearance)[verb]
    if len(words) - 1 != len(readers):
        raise CommandSyntaxError(f"{verb} takes {len(readers)} words, not {len(words) - 1}; usage: {usage}")
    return make(*(read(word) for read, word in zip(readers, words[1:], strict=True)))


def _forms(appearance: Appearance) -> dict[str, tuple[str, Sequence[Reader], Callable[..., Action]]]:
    """The usage of each command, what reads its words, and what makes its action."""
    stop, example = ("stop", (), lambda: STOP), describe(appearance.example)
    if appearance.grid is None:
        box, colour = partial(match_choice, "box", choices=BOXES), partial(match_choice, "colour", choices=COLOURS)
        add = (f"add BOX COLOUR, such as: {example}", (box, colour), AddBlock)
        return {"add": add, "remove": ("remove BOX, such as: remove left", (box,), RemoveBlock), "stop": stop}
    columns, rows = appearance.grid
    cell = partial(_coordinate, "column", columns), partial(_coordinate, "row", rows)
    attribute = partial(match_choice, "shape, colour or size", choices={**SHAPES, **COLOURS, **SIZES})
    usage = f"add COLUMN ROW SHAPE COLOUR SIZE, such as: {example}  (0..{columns - 1}, 0..{rows - 1})"
    remove = ("remove COLUMN ROW: the item that covers most of that cell", cell, RemoveItem)
    return {"add": (usage, (*cell, *[attribute] * 3), _add_item), "remove": remove, "stop": stop}


def _add_item(column: int, row: int, *attributes: IntEnum) -> Action:
    values: dict[type[IntEnum], Any] = {}
    for value in attributes:
        if type(value) in values:
            second = f"{value.name.lower()!r} is a second {type(value).__name__.lower()}"
            raise CommandSyntaxError(f"{second}; give one shape, colour and size")
        values[type(value)] = value
    return AddItem(column, row, values[Shape], values[Colour], values[Size])


def _coordinate(axis: str, count: int, word: str) -> int:
    if not word.isdecimal() or int(word) >= count:
        raise CommandSyntaxError(f"{axis} {word!r} must be one of 0 .. {count - 1}")
    return int(word)


def match_choice(what: str, word: str, choices: Mapping[str, Value]) -> Value:
    """The choice named `word`, or the only one that begins with it. Raises CommandSyntaxError naming the choices."""
    matches = [word] if word in choices else [name for name in choices if name.startswith(word)]
    if len(matches) == 1:
        return choices[matches[0]]
    error = f"{word!r} could be {' or '.join(matches)}" if matches else f"unknown {what} {word!r}"
    raise CommandSyntaxError(f"{error}; choose from {', '.join(choices)}")


def legal_commands(appearance: Appearance, legal: Sequence[int]) -> Iterator[str]:
    """Lines that list the legal actions, given by index; ADDs to cells are counted by size and shape."""
    actions = [appearance.decode(index) for index in legal]
    if appearance.grid is None:
        yield from map(describe, actions)
        return
    yield describe(STOP)
    removals = [describe(action) for action in actions if isinstance(action, RemoveItem)]
    yield ", ".join(removals) or "nothing to remove"
    for shape in Shape:
        for size in Size:
            cells = {
                (action.column, action.row)
                for action in actions
                if isinstance(action, AddItem) and action.size == size and action.shape == shape
            }
            yield f"ADD({shape.name}, any colour, {size.name}): {len(cells)} cells"
