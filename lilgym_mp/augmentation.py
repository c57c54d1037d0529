"""More training data out of what there is: colours, shapes, boxes, sides and numbers exchanged alike everywhere.

An `Augmentation` exchanges them in statements, programs, scenes, pictures, actions and tasks. docs/augmentation.md says
which of them leave the rules as they are, and what each refuses.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import permutations
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.actions import Action, AddBlock, AddItem, RemoveBlock, RemoveItem, Stop
from lilgym_mp.appearances import APPEARANCES, RELEASED_GRID, Appearance, Grid, Scatter
from lilgym_mp.appearances.placement import check_apart
from lilgym_mp.arrays import UInt8Array
from lilgym_mp.choices import choose
from lilgym_mp.corpus import TaskSet, words, write_corpus
from lilgym_mp.corpus.spelling import NUMBERS, normalised_words
from lilgym_mp.perception import image_size_of, read_scene, recoloured
from lilgym_mp.programs import compile_program
from lilgym_mp.programs.syntax import Call, Member, Node, Slice, Subscript, WordName, children
from lilgym_mp.render import draw
from lilgym_mp.rules import RULE_SETS
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
from lilgym_mp.task import Task

Value = TypeVar("Value")

NUMBER_RANGE = tuple(range(1, 8))  # numbers that may be exchanged
KEPT_PAIRS = 32_768  # statements with programs whose words are remembered
PLURAL_AFTER = 1  # `random_augmentation` leaves this number and what is below alone: English then has the singular

_COLOURS = {colour.name.lower(): colour for colour in Colour}
_SHAPES = {shape.name.lower(): shape for shape in Shape}
_SIDES = {"left": "right", "right": "left"}
_NUMBER_WORDS = {int(digits): word for word, digits in NUMBERS.items()}


def _any_of(names: Sequence[str], after: str = "") -> re.Pattern[str]:
    """One of the names, no letter before or after it but `after`."""
    return re.compile(rf"(?<![a-z])({'|'.join(names)})(?={after}(?![a-z]))", re.IGNORECASE)


_COLOUR = _any_of(list(_COLOURS))
_SHAPE = _any_of(list(_SHAPES), "s?")
_SIDE = _any_of(list(_SIDES))
_SIDE_VALUE = re.compile(r"(?<=Side\.)(LEFT|RIGHT)\b")
_NUMBER = re.compile(rf"(?<![\w.])({'|'.join(NUMBERS)}|\d+)(?![\w.]\w|\w)", re.IGNORECASE)
_INT = re.compile(r"(?<![\w.])(\d+)(?!\w)")

# Words from which a shape follows without being named; "box" where it is an item.
_OTHER_SHAPE = re.compile(
    r"(?<![a-z])(blocks?|round|circular|triangular|rectangles?|rectangular|cubes?|balls?|dots?|dis[ck]s?"
    r"|gr[ae]y\s+squares?|(black|yellow|blue|small|medium|big|large|colou?red)\s+box(es)?)(?![a-z])",
    re.IGNORECASE,
)
_COMPARISON = re.compile(r"(?<![a-z])(more|less|fewer|greater|larger|smaller)(?![a-z])", re.IGNORECASE)
# Common words that look like misspelt names, and those that are often typed as one with the next.
_ORDINARY = {"block", "blocks", "back", "lack", "bellow", "lift", "let", "light", "might", "night", "sight"}
_SHORT = {"a", "an", "the", "is", "of", "in", "at", "on", "with", "and", "one"}
_TOWER_WORDS = {"is_second", "is_third", "get_above", "get_below"}  # these ask whether a box is a tower


class AugmentationError(ValueError):
    """An exchange that is none: values left out, or several that become one."""


@dataclass(frozen=True, slots=True)
class Augmentation:
    """What becomes of each colour, shape, box, side and number; nothing changes by default.

    Statements and programs are rewritten by `statement` and `program` as they are; `pair` and `task` rewrite them
    only where they name the same things.
    """

    colours: tuple[Colour, ...] = tuple(Colour)  # what each colour becomes
    shapes: tuple[Shape, ...] = tuple(Shape)  # what each shape becomes
    boxes: tuple[int, ...] = tuple(range(BOX_COUNT))  # box k of the new scene is the old one's box boxes[k]
    mirrored: bool = False  # left and right exchanged inside of each box
    numbers: tuple[int, ...] = NUMBER_RANGE  # what 1 .. 7 become, in statements and programs only

    def __post_init__(self) -> None:
        """Raises AugmentationError for a field that is no permutation."""
        for name, choices in (
            ("colours", tuple(Colour)),
            ("shapes", tuple(Shape)),
            ("boxes", tuple(range(BOX_COUNT))),
            ("numbers", NUMBER_RANGE),
        ):
            value = getattr(self, name)
            if sorted(value) != sorted(choices):
                raise AugmentationError(f"{name} must be a permutation of {tuple(map(int, choices))}, not {value!r}")

    @property
    def is_identity(self) -> bool:
        return self == IDENTITY

    @property
    def moves_squares(self) -> bool:
        return self.shapes[Shape.SQUARE] != Shape.SQUARE

    def is_exact(self, appearance: Appearance, rules: str = "paper") -> bool:
        """Whether augmenting a state and an action and then stepping is always the same as augmenting the step.

        Raises ValueError for an unknown rule set.
        """
        placement = choose("rules", rules, RULE_SETS).placement
        if self.numbers != NUMBER_RANGE:
            return False
        if not isinstance(appearance, Scatter):
            return not self.moves_squares
        if self.shapes != IDENTITY.shapes:
            return False
        if appearance.is_native:  # items come to lie where they are put
            return True
        return not self.mirrored and (self.boxes == IDENTITY.boxes or not placement.rounds_in_image)

    # Language

    def statement(self, text: str) -> str:
        """The statement with its words exchanged; capitals as they were."""
        if self.colours != IDENTITY.colours:
            text = _COLOUR.sub(lambda found: _like(found[0], self._colour(found[0])), text)
        if self.shapes != IDENTITY.shapes:
            text = _SHAPE.sub(lambda found: _like(found[0], self._shape(found[0])), text)
        if self.mirrored:
            text = _SIDE.sub(lambda found: _like(found[0], _SIDES[found[0].lower()]), text)
        if self.numbers != NUMBER_RANGE:
            text = _NUMBER.sub(self._number, text)
        return text

    def program(self, source: str) -> str:
        """The program with its words exchanged."""
        if self.colours != IDENTITY.colours:
            source = _COLOUR.sub(lambda found: _like(found[0], self._colour(found[0])), source)
        if self.shapes != IDENTITY.shapes:
            source = _SHAPE.sub(lambda found: _like(found[0], self._shape(found[0])), source)
        if self.mirrored:
            source = _SIDE_VALUE.sub(lambda found: _SIDES[found[0].lower()].upper(), source)
        if self.numbers != NUMBER_RANGE:
            source = _INT.sub(self._number, source)
        return source

    def pair(self, statement: str, program: str) -> tuple[str, str] | None:
        """Both rewritten; None where that might part them, or where the program depends on what is not named.

        That is so where one names a colour, shape, side or number that is exchanged and the other does not (a
        misspelt one is not named), and where the program's truth would not follow its scene: see `Pair`.
        """
        if not self._suits(facts(statement, program)):
            return None
        return self.statement(statement), self.program(program)

    def _suits(self, pair: Pair) -> bool:
        return (
            (self.colours == IDENTITY.colours or pair.colours)
            and (self.shapes == IDENTITY.shapes or (pair.squares if self.moves_squares else pair.shapes))
            and (not self.mirrored or pair.sides)
            and (self.boxes == IDENTITY.boxes or pair.boxes)
            and self._exchanged_numbers <= pair.numbers
            and not (pair.compares and len(self._exchanged_numbers & pair.named_numbers) > 1)
        )

    @property
    def _exchanged_numbers(self) -> set[int]:
        return {old for old, new in zip(NUMBER_RANGE, self.numbers, strict=True) if old != new}

    def _colour(self, name: str) -> str:
        return self.colours[_COLOURS[name.lower()]].name.lower()

    def _shape(self, name: str) -> str:
        return self.shapes[_SHAPES[name.lower()]].name.lower()

    def _number(self, found: re.Match[str]) -> str:
        text = found[0]
        number = _value(text)
        if number not in NUMBER_RANGE:
            return text
        new = self.numbers[number - NUMBER_RANGE[0]]
        return str(new) if text.isdigit() else _like(text, _NUMBER_WORDS[new])

    # Scenes and pictures

    def scene(self, scene: Scene) -> Scene:
        """The scene with its items exchanged, moved and mirrored; numbers do not matter.

        Other shapes may overlap where the old ones did not: `task` refuses that, this does not.
        """
        left, middle, right = (Box(tuple(map(self._item, box.items))) for box in scene.boxes)
        return Scene((left, middle, right)).permuted(self.boxes)

    def _item(self, item: Item) -> Item:
        x, y, shape, colour, size = item
        return Item(BOX_SIDE - x - item.side if self.mirrored else x, y, self.shapes[shape], self.colours[colour], size)

    def image(self, image: UInt8Array) -> UInt8Array:
        """The picture of the augmented scene: of `scene(s)` for that of s. (50, 190, 3) or (100, 380, 3), uint8.

        A mirrored picture is drawn anew, as a triangle's pixels are not symmetric, and so is one of other shapes.
        Raises PerceptionError for a picture of no scene.
        """
        if self.mirrored or self.shapes != IDENTITY.shapes:
            return draw(self.scene(read_scene(image, "scatter")), image_size_of(image))
        changed = recoloured(image, self.colours)
        columns = [_box_columns(image.shape[1], index) for index in range(BOX_COUNT)]
        if self.boxes == IDENTITY.boxes:
            return changed
        moved = changed.copy()
        for new, old in enumerate(self.boxes):
            moved[:, columns[new]] = changed[:, columns[old]]
        return moved

    # Actions

    def action(self, action: Action, grid: Grid = RELEASED_GRID) -> Action:
        """The action on the augmented scene; `grid`: (columns, rows) of a Scatter action's cells.

        Mirrored, a cell to remove from lies as far from the right as it did from the left, and one to add to is the
        one that holds the upper left corner of the mirrored item; where the item would not fit it stays.
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
        """Where a column goes; `side`: width in pixels of what begins at its left."""
        width = IMAGE_WIDTH // grid[0]
        pitch = BOX_PITCH // width
        box, across = divmod(column, pitch)
        room = BOX_SIDE - side - across * width  # to the right of it
        if across * width >= BOX_SIDE:
            return column  # on a separator
        return self.boxes.index(box) * pitch + (room // width if self.mirrored and room >= 0 else across)

    def action_indices(self, appearance: Appearance) -> NDArray[np.int64]:
        """(action_count,) the index of what each action becomes, a permutation; not to be written.

        A mask of the augmented state is `new[indices] = mask`; the mask of an index is `new_index = indices[index]`.
        """
        return _action_indices(self, appearance)

    # Tasks

    def task(self, task: Task, appearance: str | None = None) -> Task | None:
        """The task with everything exchanged, under its own id; None where that might make it another task.

        So it is where `pair` refuses, where numbers are exchanged (the start's truth need not follow), where items of
        the start come to overlap or, when `appearance` is given, leave it, and where its truth changes all the same.
        """
        if self.numbers != NUMBER_RANGE or (appearance == "tower" and self.moves_squares):
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
            if appearance is not None:
                choose("appearance", appearance, APPEARANCES).check_scene(new.start)
        except SceneError:
            return None
        return new if new.truth(new.start) == task.truth(task.start) else None


IDENTITY = Augmentation()


@lru_cache(maxsize=256)
def _action_indices(augmentation: Augmentation, appearance: Appearance) -> NDArray[np.int64]:
    grid = appearance.grid if isinstance(appearance, Scatter) else RELEASED_GRID
    actions = (augmentation.action(appearance.decode(index), grid) for index in range(appearance.action_count))
    indices = np.fromiter(map(appearance.encode, actions), np.int64, appearance.action_count)
    indices.flags.writeable = False
    return indices


def _box_columns(width: int, index: int) -> slice:
    first = index * BOX_PITCH * width // IMAGE_WIDTH
    return slice(first, first + BOX_SIDE * width // IMAGE_WIDTH)


def _like(old: str, new: str) -> str:
    """`new` with the capitals of `old`."""
    return new.upper() if old.isupper() else new.capitalize() if old[0].isupper() else new.lower()


def _value(number: str) -> int:
    return int(number) if number.isdigit() else int(NUMBERS[number.lower()])


# What may be exchanged


class Pair(NamedTuple):
    """What may be exchanged in a statement and its program so that they keep meaning the same."""

    colours: bool
    shapes: bool  # circles and triangles
    squares: bool  # and squares: not where the program asks for towers, which are of squares
    sides: bool  # not where the program asks for towers, whose right edges are compared, nor where it counts boxes
    boxes: bool  # the program does not depend on their order
    numbers: frozenset[int]  # of 1 .. 7: those that both name equally often
    named_numbers: frozenset[int]  # those that they name
    compares: bool  # "more than 2" may be `ge(..., 3)`: two numbers may not be exchanged apart


@lru_cache(maxsize=KEPT_PAIRS)
def facts(statement: str, program: str) -> Pair:
    """What may be exchanged in both. Raises ProgramError when `program` is none."""
    uses = _uses(program)
    asks_for_tower = bool(uses & _TOWER_WORDS or "is_tower" in uses)
    shapes = _agree(statement, program, _SHAPE, _SHAPE, _SHAPES) and not _OTHER_SHAPE.search(statement)
    said, meant = Counter(map(_value, _NUMBER.findall(statement))), Counter(map(int, _INT.findall(program)))
    may = frozenset(number for number in NUMBER_RANGE if said[number] == meant[number])
    return Pair(
        colours=_agree(statement, program, _COLOUR, _COLOUR, _COLOURS),
        shapes=shapes,
        squares=shapes and not asks_for_tower,
        sides=_agree(statement, program, _SIDE, _SIDE_VALUE, _SIDES) and not asks_for_tower and "[]" not in uses,
        boxes=not uses & {"[]", "min"},
        numbers=frozenset[int]() if "[]" in uses else may,
        named_numbers=frozenset(said),
        compares=bool(_COMPARISON.search(statement)),
    )


def _agree(statement: str, program: str, said: re.Pattern[str], meant: re.Pattern[str], names: dict[str, Any]) -> bool:
    """Whether both name the same, and the statement names it in words that are spelt right."""
    spoken = [word.lower() for word in said.findall(statement)]
    if set(spoken) != {word.lower() for word in meant.findall(program)}:
        return False
    singular = {name + ending: name for name in names for ending in ("", "s")}
    unsure = " ".join(word for word in words(statement) if word not in _ORDINARY)
    repaired = normalised_words(unsure, _SHORT | singular.keys())
    return Counter(singular[word] for word in repaired if word in singular) == Counter(spoken)


def _uses(program: str) -> set[str]:
    """The words and members that a program uses, "[]" among them where it takes elements by their place."""
    found: set[str] = set()
    left: list[Node] = [compile_program(program).tree]
    while left:
        node = left.pop()
        match node:
            case Call() | WordName():
                found.add(node.word.name)
            case Member():
                found.add(node.name)
            case Subscript() | Slice():
                found.add("[]")
            case _:
                pass
        left.extend(children(node))
    return found


# Random ones


def random_augmentation(
    rng: np.random.Generator,
    *,
    colours: bool = True,
    shapes: bool = True,
    boxes: bool = False,
    mirror: bool = False,
    numbers: bool = True,
) -> Augmentation:
    """One of all augmentations that exchange no more than what is asked for; 1 stays, for its singular.

    The defaults are for statements with programs, where neither scenes nor boxes occur.
    """
    return Augmentation(
        _shuffled(tuple(Colour), rng) if colours else IDENTITY.colours,
        _shuffled(tuple(Shape), rng) if shapes else IDENTITY.shapes,
        _shuffled(IDENTITY.boxes, rng) if boxes else IDENTITY.boxes,
        mirror and bool(rng.integers(2)),
        _more_numbers(NUMBER_RANGE, rng) if numbers else NUMBER_RANGE,
    )


def random_pair(
    statement: str,
    program: str,
    rng: np.random.Generator,
    *,
    colours: bool = True,
    shapes: bool = True,
    mirror: bool = True,
    numbers: bool = True,
) -> tuple[str, str]:
    """Statement and program, of which all that may be exchanged is exchanged at random. Raises ProgramError."""
    may = facts(statement, program)
    changing = SHAPE_ORDERS if may.squares else SHAPE_ORDERS[:2] if may.shapes else SHAPE_ORDERS[:1]
    exchangeable = may.numbers if not may.compares or len(may.named_numbers) < 2 else ()
    augmentation = Augmentation(
        _shuffled(tuple(Colour), rng) if colours and may.colours else IDENTITY.colours,
        changing[int(rng.integers(len(changing)))] if shapes else IDENTITY.shapes,
        mirrored=mirror and may.sides and bool(rng.integers(2)),
        numbers=_more_numbers(exchangeable, rng) if numbers else NUMBER_RANGE,
    )
    return augmentation.statement(statement), augmentation.program(program)


# Those that leave squares alone come first, and of these the one that changes nothing.
SHAPE_ORDERS = sorted(permutations(Shape), key=lambda order: (order[Shape.SQUARE] != Shape.SQUARE, order))


def _shuffled(values: tuple[Value, ...], rng: np.random.Generator) -> tuple[Value, ...]:
    order: list[int] = rng.permutation(len(values)).tolist()
    return tuple(values[index] for index in order)


def _more_numbers(exchangeable: Sequence[int] | frozenset[int], rng: np.random.Generator) -> tuple[int, ...]:
    old = tuple(number for number in NUMBER_RANGE if number > PLURAL_AFTER and number in exchangeable)
    new = dict(zip(old, _shuffled(old, rng), strict=True))
    return tuple(new.get(number, number) for number in NUMBER_RANGE)


# Files

COLOUR_EXCHANGES = tuple(Augmentation(colours) for colours in permutations(Colour))  # the first changes nothing


def write_recoloured(path: Path, tasks: TaskSet) -> None:
    """Writes a corpus file with the tasks and every other task that exchanging colours makes of them."""
    name = f"{tasks.provenance.name}, recoloured"
    write_corpus(path, name, "as the original", list(_recoloured_entries(tasks)))


def _recoloured_entries(tasks: TaskSet) -> Iterator[dict[str, object]]:
    origin = tasks.provenance
    met = set[tuple[str, str, bool, Scene]]()
    for number, exchange in enumerate(COLOUR_EXCHANGES):
        for task in tasks:
            new = exchange.task(task)
            if new is None or (key := (new.statement, new.program, new.target, new.start)) in met:
                continue
            met.add(key)
            entry_id = f"{task.id}-colours-{number}"
            start = {"id": f"{entry_id}-start", "label": not new.target, "scene": new.start.to_json()}
            yield {
                "id": entry_id,
                "appearance": origin.appearance,
                "split": origin.split,
                "statement": new.statement,
                "program": new.program,
                "starts": [] if origin.start == "scratch" else [start],
            }
