"""Text commands for actions: "ADD(LEFT, BLUE)", as shown everywhere, or in words, "add left blue"."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from enum import IntEnum
from typing import Any, TypeVar

from lilgym_mp.actions import BOX_NAMES, STOP, Action, AddBlock, AddItem, RemoveBlock, RemoveItem, describe
from lilgym_mp.appearances import Appearance, Grid
from lilgym_mp.scene import Colour, Shape, Size

Value = TypeVar("Value")
Words = Sequence[str]


class CommandSyntaxError(ValueError):
    """A line that is not a command; the message shows the valid form."""


def _names(members: type[IntEnum]) -> dict[str, Any]:
    return {member.name.lower(): member for member in members}


BOXES = {name.lower(): index for index, name in enumerate(BOX_NAMES)}
COLOURS, SHAPES, SIZES = _names(Colour), _names(Shape), _names(Size)
VERBS = {"add": "add", "remove": "remove", "stop": "stop"}
_PUNCTUATION = str.maketrans("(),", "   ")


def command_help(appearance: Appearance) -> list[str]:
    """Lines that describe the commands for actions."""
    if appearance.grid is None:
        return [
            f"add BOX COLOUR   such as: {describe(appearance.example)}",
            "remove BOX       such as: REMOVE(MIDDLE)",
        ]
    columns, rows = appearance.grid
    example = f"{describe(appearance.example)}  (0..{columns - 1}, 0..{rows - 1})"
    return [
        f"add COLUMN ROW SHAPE COLOUR SIZE   such as: {example}",
        "remove COLUMN ROW                  remove the item that covers most of that cell",
    ]


def words_of(line: str) -> list[str]:
    """The words of a line, without the brackets and commas of "ADD(LEFT, BLUE)"."""
    return line.lower().translate(_PUNCTUATION).split()


def parse_command(words: Words, appearance: Appearance) -> Action:
    """The action of a command; words may be abbreviated. Raises CommandSyntaxError."""
    (verb, *rest), grid = words, appearance.grid
    match match_choice("command", verb, VERBS):
        case "stop":
            _expect(rest, 0, "stop")
            return STOP
        case "add":
            return _add_block(rest) if grid is None else _add_item(rest, grid)
        case _:
            return _remove_block(rest) if grid is None else _remove_item(rest, grid)


def _add_block(words: Words) -> Action:
    _expect(words, 2, "add BOX COLOUR, such as: add left blue")
    return AddBlock(match_choice("box", words[0], BOXES), match_choice("colour", words[1], COLOURS))


def _remove_block(words: Words) -> Action:
    _expect(words, 1, "remove BOX, such as: remove left")
    return RemoveBlock(match_choice("box", words[0], BOXES))


def _add_item(words: Words, grid: Grid) -> Action:
    _expect(words, 5, "add COLUMN ROW SHAPE COLOUR SIZE, such as: add 3 4 circle blue small")
    column, row = _cell(words, grid)
    values: dict[type[IntEnum], IntEnum] = {}
    for word in words[2:]:
        value = match_choice("shape, colour or size", word, {**SHAPES, **COLOURS, **SIZES})
        if type(value) in values:
            raise CommandSyntaxError(
                f"{word!r} is a second {type(value).__name__.lower()}; give one shape, colour and size"
            )
        values[type(value)] = value
    return AddItem(column, row, Shape(values[Shape]), Colour(values[Colour]), Size(values[Size]))


def _remove_item(words: Words, grid: Grid) -> Action:
    _expect(words, 2, "remove COLUMN ROW, such as: remove 3 4")
    return RemoveItem(*_cell(words, grid))


def _cell(words: Words, grid: Grid) -> tuple[int, int]:
    columns, rows = grid
    return _coordinate("column", words[0], columns), _coordinate("row", words[1], rows)


def _coordinate(axis: str, word: str, count: int) -> int:
    if not word.isdecimal() or int(word) >= count:
        raise CommandSyntaxError(f"{axis} {word!r} must be one of 0 .. {count - 1}")
    return int(word)


def _expect(words: Words, count: int, usage: str) -> None:
    if len(words) != count:
        raise CommandSyntaxError(f"{usage.split()[0]} takes {count} words, not {len(words)}; usage: {usage}")


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
