"""Data augmentation by symmetry: permutes colours, shapes, boxes, and left and right.

An `Augmentation` applies the same permutation to statements, programs, scenes, images, actions and tasks.
docs/perception.md says which permutations commute with the rules and when one is refused.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import permutations
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.corpus import words
from lilgym_mp.corpus.spelling import normalised_words
from lilgym_mp.envs.rules import RULE_SETS
from lilgym_mp.programs import compile_program
from lilgym_mp.programs.syntax import Call, Member, Node, Slice, Subscript, WordName, children
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import (
    BOX_COUNT,
    BOX_PITCH,
    BOX_SIDE,
    IMAGE_WIDTH,
    Box,
    Colour,
    Item,
    Scene,
    SceneError,
    Shape,
)
from lilgym_mp.scene.actions import Action, AddBlock, AddItem, RemoveBlock, RemoveItem, Stop
from lilgym_mp.scene.appearances import APPEARANCES, NATIVE, RELEASED_GRID, Appearance, Grid, checked_grid
from lilgym_mp.scene.appearances.placement import check_apart
from lilgym_mp.scene.arrays import UInt8Array
from lilgym_mp.scene.choices import choose
from lilgym_mp.scene.render import draw

Value = TypeVar("Value")

CACHE_SIZE = 32_768  # statement-program pairs

_COLOURS = {colour.name.lower(): colour for colour in Colour}
_SHAPES = {shape.name.lower(): shape for shape in Shape}
_SIDES = {"left": "right", "right": "left"}


def _any_of(names: Sequence[str], after: str = "") -> re.Pattern[str]:
    """Matches one of the names as a word; the suffix pattern `after` may follow."""
    return re.compile(rf"(?<![a-z])({'|'.join(names)})(?={after}(?![a-z]))", re.IGNORECASE)


_COLOUR = _any_of(list(_COLOURS))
_SHAPE = _any_of(list(_SHAPES), "s?")
_SIDE = _any_of(list(_SIDES))
_SIDE_VALUE = re.compile(r"(?<=Side\.)(LEFT|RIGHT)\b")

# Words that imply a shape without naming it; "box" where it refers to an item
_OTHER_SHAPE = re.compile(
    r"(?<![a-z])(blocks?|round|circular|triangular|rectangles?|rectangular|cubes?|balls?|dots?|dis[ck]s?"
    r"|gr[ae]y\s+squares?|(black|yellow|blue|small|medium|big|large|colou?red)\s+box(es)?)(?![a-z])",
    re.IGNORECASE,
)
# Common words that look like misspelt names, and words often typed together with the next one
_ORDINARY = {"block", "blocks", "back", "lack", "bellow", "lift", "let", "light", "might", "night", "sight"}
_SHORT = {"a", "an", "the", "is", "of", "in", "at", "on", "with", "and", "one"}
_TOWER_WORDS = {"is_second", "is_third", "get_above", "get_below"}  # words that depend on whether a box is a tower


class AugmentationError(ValueError):
    """A field of an Augmentation is not a permutation."""


@dataclass(frozen=True, slots=True)
class Augmentation:
    """A permutation of colours, shapes, boxes and sides; the identity by default.

    `statement` and `program` rewrite any text; `pair` and `task` return None unless the result is known to be
    consistent.
    """

    colours: tuple[Colour, ...] = tuple(Colour)  # colours[c] replaces colour c
    shapes: tuple[Shape, ...] = tuple(Shape)  # shapes[s] replaces shape s
    boxes: tuple[int, ...] = tuple(range(BOX_COUNT))  # box k of the new scene is box boxes[k] of the old one
    mirrored: bool = False  # swap left and right within each box

    def __post_init__(self) -> None:
        """Raises AugmentationError for a field that is not a permutation."""
        for name, choices in (
            ("colours", tuple(Colour)),
            ("shapes", tuple(Shape)),
            ("boxes", tuple(range(BOX_COUNT))),
        ):
            value = getattr(self, name)
            if sorted(value) != sorted(choices):
                raise AugmentationError(f"{name} must be a permutation of {tuple(map(int, choices))}, not {value!r}")

    def keeps_shapes(self, appearance: Appearance) -> bool:
        """Whether the permuted shapes are valid in the appearance."""
        return {self.shapes[shape] for shape in appearance.shapes} == {*appearance.shapes}

    def is_exact(self, appearance: Appearance, rules: str = "paper") -> bool:
        """Whether the augmentation commutes with environment steps: a symmetry of the MDP.

        Raises ValueError for an unknown rule set.
        """
        placement = choose("rules", rules, RULE_SETS).placement
        if appearance.grid is None:
            return self.keeps_shapes(appearance)
        if self.shapes != IDENTITY.shapes:
            return False
        if appearance.grid == checked_grid(NATIVE):  # items are placed exactly where requested
            return True
        return not self.mirrored and (self.boxes == IDENTITY.boxes or not placement.rounds_in_image)

    # Language

    def statement(self, text: str) -> str:
        """The rewritten statement; letter case is preserved."""
        return self._rewritten(text, _SIDE)

    def program(self, source: str) -> str:
        """The rewritten program source."""
        return self._rewritten(source, _SIDE_VALUE)

    def _rewritten(self, text: str, sides: re.Pattern[str]) -> str:
        if self.colours != IDENTITY.colours:
            text = _exchanged(text, _COLOUR, lambda name: self.colours[_COLOURS[name]].name)
        if self.shapes != IDENTITY.shapes:
            text = _exchanged(text, _SHAPE, lambda name: self.shapes[_SHAPES[name]].name)
        return _exchanged(text, sides, _SIDES.__getitem__) if self.mirrored else text

    def pair(self, statement: str, program: str) -> tuple[str, str] | None:
        """Statement and program rewritten, or None when the results might no longer have the same meaning.

        The statement and the program must name the same permuted colours, shapes and sides (misspelt names do
        not count), and the program's truth value must follow the augmented scene: see `Symmetries`.
        """
        if not self._is_allowed(symmetries(statement, program)):
            return None
        return self.statement(statement), self.program(program)

    def _is_allowed(self, allowed: Symmetries) -> bool:
        shapes = allowed.shapes if self.shapes[Shape.SQUARE] == Shape.SQUARE else allowed.squares
        return (
            (self.colours == IDENTITY.colours or allowed.colours)
            and (self.shapes == IDENTITY.shapes or shapes)
            and (not self.mirrored or allowed.sides)
            and (self.boxes == IDENTITY.boxes or allowed.boxes)
        )

    # Scenes and images

    def scene(self, scene: Scene) -> Scene:
        """The augmented scene.

        Items with other shapes may overlap; unlike `task`, this does not check for it.
        """
        left, middle, right = (Box(tuple(map(self._item, box.items))) for box in scene.boxes)
        return Scene((left, middle, right)).permuted(self.boxes)

    def _item(self, item: Item) -> Item:
        x, y, shape, colour, size = item
        return Item(BOX_SIDE - x - item.side if self.mirrored else x, y, self.shapes[shape], self.colours[colour], size)

    def image(self, image: UInt8Array) -> UInt8Array:
        """The image of the augmented scene, from the image of the scene: uint8 (50, 190, 3) or (100, 380, 3).

        The scene is reconstructed and redrawn. Raises PerceptionError for an image that shows no scene.
        """
        from lilgym_mp.perception import image_size_of, read_scene

        return draw(self.scene(read_scene(image, "scatter")), image_size_of(image))

    # Actions

    def action(self, action: Action, grid: Grid = RELEASED_GRID) -> Action:
        """The action on the augmented scene; `grid`: (columns, rows) of a Scatter action's cells.

        When mirrored, a removal's cell keeps its distance to the opposite wall, and an addition's cell is the one with
        the top-left corner of the mirrored item; a column where the item does not fit is unchanged.
        """
        match action:
            case AddBlock(box, colour):
                return AddBlock(self.boxes.index(box), self.colours[colour])
            case RemoveBlock(box):
                return RemoveBlock(self.boxes.index(box))
            case AddItem(column, row, shape, colour, size):
                new_column = self._column(column, grid, size.pixels)
                return AddItem(new_column, row, self.shapes[shape], self.colours[colour], size)
            case RemoveItem(column, row):
                return RemoveItem(self._column(column, grid, IMAGE_WIDTH // grid[0]), row)
            case Stop():
                return action

    def _column(self, column: int, grid: Grid, side: int) -> int:
        """The augmented column; `side`: width in pixels of the item or cell that starts there."""
        width = IMAGE_WIDTH // grid[0]
        pitch = BOX_PITCH // width
        box, column_in_box = divmod(column, pitch)
        right_margin = BOX_SIDE - side - column_in_box * width  # pixels
        if column_in_box * width >= BOX_SIDE:
            return column  # on a separator
        is_moved = self.mirrored and right_margin >= 0
        return self.boxes.index(box) * pitch + (right_margin // width if is_moved else column_in_box)

    def action_indices(self, appearance: Appearance) -> NDArray[np.int64]:
        """(action_count,) a permutation: index of each augmented action by action index. Read-only.

        For a mask: `augmented_mask[indices] = mask`; for an action: `augmented_action = indices[action]`.
        """
        return _action_indices(self, appearance)

    # Tasks

    def task(self, task: Task, appearance: str | None = None) -> Task | None:
        """The augmented task with the same id, or None when it might not be equivalent.

        None if `pair` returns None, when items of the start overlap or are invalid in the given `appearance`, and when
        the start's truth value changes.
        """
        played = None if appearance is None else choose("appearance", appearance, APPEARANCES)
        if played is not None and not self.keeps_shapes(played):
            return None
        rewritten = self.pair(task.statement, task.program)
        if rewritten is None:
            return None
        new = Task(task.id, *rewritten, task.target, self.scene(task.start))
        if self == Augmentation(self.colours):
            return new
        try:
            if self.shapes != IDENTITY.shapes:
                for box in new.start.boxes:
                    check_apart(box.items)
            if played is not None:
                played.check_scene(new.start)
        except SceneError:
            return None
        return new if new.truth(new.start) == task.truth(task.start) else None


IDENTITY = Augmentation()


@lru_cache(maxsize=256)
def _action_indices(augmentation: Augmentation, appearance: Appearance) -> NDArray[np.int64]:
    grid = appearance.grid or RELEASED_GRID
    actions = (augmentation.action(appearance.decode(index), grid) for index in range(appearance.action_count))
    indices = np.fromiter(map(appearance.encode, actions), np.int64, appearance.action_count)
    indices.flags.writeable = False
    return indices


def _exchanged(text: str, pattern: re.Pattern[str], new_name: Callable[[str], str]) -> str:
    """The text with new names, in the letter case of the old ones."""

    def renamed(found: re.Match[str]) -> str:
        old = found[0]
        new = new_name(old.lower())
        return new.upper() if old.isupper() else new.capitalize() if old[0].isupper() else new.lower()

    return pattern.sub(renamed, text)


# Allowed permutations


class Symmetries(NamedTuple):
    """Permutations under which a statement and its program keep the same meaning."""

    colours: bool
    shapes: bool  # circles and triangles
    squares: bool  # also squares; not if the program tests for towers, which consist of squares
    sides: bool  # not if the program tests for towers, whose right edges are compared, or indexes a list
    boxes: bool  # the program does not depend on their order


@lru_cache(maxsize=CACHE_SIZE)
def symmetries(statement: str, program: str) -> Symmetries:
    """The permutations allowed for a statement and its program. Raises ProgramError for an invalid program."""
    uses = _used_names(program)
    tests_for_tower = bool(uses & _TOWER_WORDS or "is_tower" in uses)
    shapes = _same_names(statement, program, _SHAPE, _SHAPE, _SHAPES) and not _OTHER_SHAPE.search(statement)
    same_sides = _same_names(statement, program, _SIDE, _SIDE_VALUE, _SIDES)
    return Symmetries(
        colours=_same_names(statement, program, _COLOUR, _COLOUR, _COLOURS),
        shapes=shapes,
        squares=shapes and not tests_for_tower,
        sides=same_sides and not tests_for_tower and "[]" not in uses,
        boxes=not uses & {"[]", "min"},
    )


def _same_names(
    statement: str,
    program: str,
    statement_pattern: re.Pattern[str],
    program_pattern: re.Pattern[str],
    names: dict[str, Any],
) -> bool:
    """Whether statement and program contain the same names, and the statement has no misspelt one."""
    found = [word.lower() for word in statement_pattern.findall(statement)]
    if set(found) != {word.lower() for word in program_pattern.findall(program)}:
        return False
    singular = {name + ending: name for name in names for ending in ("", "s")}
    checked_words = " ".join(word for word in words(statement) if word not in _ORDINARY)
    repaired = normalised_words(checked_words, _SHORT | singular.keys())
    return Counter(singular[word] for word in repaired if word in singular) == Counter(found)


def _used_names(program: str) -> set[str]:
    """The words and members that a program uses, and "[]" if it indexes or slices a list."""
    found: set[str] = set()
    pending: list[Node] = [compile_program(program).tree]
    while pending:
        node = pending.pop()
        match node:
            case Call() | WordName():
                found.add(node.word.name)
            case Member():
                found.add(node.name)
            case Subscript() | Slice():
                found.add("[]")
            case _:
                pass
        pending.extend(children(node))
    return found


# The identity first, then the one that swaps circles and triangles, then those that move squares
SHAPE_PERMUTATIONS = sorted(permutations(Shape), key=lambda order: (order[Shape.SQUARE] != Shape.SQUARE, order))
COLOUR_PERMUTATIONS = tuple(Augmentation(colours) for colours in permutations(Colour))  # the identity first
