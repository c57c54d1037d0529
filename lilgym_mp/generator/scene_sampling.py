"""Scenes to test statements on, in families of scenes that differ by one legal edit.

A family is a scene and some of its children, each the scene after one ADD that a REMOVE takes back. Scene and child
are one edit apart, two children two edits and equally full: near misses for whoever judges by surface.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

from lilgym_mp.actions import Action, AddBlock, AddItem, RemoveBlock, RemoveItem
from lilgym_mp.appearances import APPEARANCES, RELEASED_GRID
from lilgym_mp.appearances.placement import fits_box, is_free
from lilgym_mp.corpus.scenes import SAMPLERS
from lilgym_mp.rules import RULE_SETS
from lilgym_mp.scene import BOX_COUNT, BOX_SIDE, Box, Colour, Item, Scene, Shape, Size

RULES = RULE_SETS["paper"]
EDIT_LIMIT = RULES.horizon - 1  # the last action is STOP
CHILDREN = 3
TOUCHING_GAP = 1  # pixels between two items that touch, at most
NEAR_GAPS = (2, 3, 4)  # pixels: almost touching, as the programs have it
CLEAR_GAP = 9  # pixels: plainly apart
TRIES = 30

Looks = tuple[list[Shape], list[Colour], list[Size]]


class Family(NamedTuple):
    """A scene, what it can become by one item more, and how many edits led to it from the empty scene, if known."""

    parent: Scene
    children: tuple[Scene, ...]
    edits: int | None


class Chain(NamedTuple):
    """Families, each but the first with a child of the one before as its parent."""

    families: tuple[Family, ...]


def chains(appearance: str, rng: random.Random) -> Iterator[Chain]:
    """Endless chains: every other one grows from the empty scene by legal actions, the others from any scene."""
    while True:
        yield _chain(appearance, Scene.empty(), rng, 0)
        yield _chain(appearance, any_scene(appearance, rng), rng, None)


def any_scene(appearance: str, rng: random.Random) -> Scene:
    """A scene such as the statements' start scenes are: not only what play on the grid leads to."""
    return _any_scatter(rng) if appearance == "scatter" else SAMPLERS[appearance].scene(rng)


def _chain(appearance: str, scene: Scene, rng: random.Random, edits: int | None) -> Chain:
    families: list[Family] = []
    looks = _some_looks(rng)
    boxes = rng.sample(range(BOX_COUNT), rng.choice((1, 2, 3, 3)))
    for _ in range(rng.choice((3, 5, 7, 9)) if edits == 0 else rng.choice((1, 2, 3))):
        children = [_grown(appearance, scene, rng, looks, boxes) for _ in range(CHILDREN)]
        distinct = tuple(dict.fromkeys(child for child in children if child is not None))
        if not distinct:
            break
        families.append(Family(scene, distinct, edits))
        scene = rng.choice(distinct)
        edits = None if edits is None else edits + 1
    return Chain(tuple(families))


def _grown(appearance: str, scene: Scene, rng: random.Random, looks: Looks, boxes: list[int]) -> Scene | None:
    """The scene with one item more, by an ADD that some REMOVE takes back; None when that fails."""
    footprint = APPEARANCES[appearance]
    for _ in range(TRIES):
        box_index = rng.choice(boxes)
        action = _some_add(appearance, rng, looks, box_index)
        grown, invalid = footprint.apply(scene, action, RULES.placement)
        if (
            invalid is None
            and footprint.apply(grown, _undoing(grown, box_index, action), RULES.placement).scene == scene
        ):
            return grown
    return None


def _some_add(appearance: str, rng: random.Random, looks: Looks, box_index: int) -> Action:
    shapes, colours, sizes = looks
    if appearance == "tower":
        return AddBlock(box_index, rng.choice(colours))
    columns, rows = RELEASED_GRID
    pitch = (columns + 2) // BOX_COUNT  # columns from one box to the next
    column = box_index * pitch + rng.randrange(pitch - 2)
    return AddItem(column, rng.randrange(rows), rng.choice(shapes), rng.choice(colours), rng.choice(sizes))


def _undoing(grown: Scene, box_index: int, action: Action) -> Action:
    """The REMOVE most likely to take the newest item of the box away."""
    if isinstance(action, AddBlock):
        return RemoveBlock(box_index)
    columns, rows = RELEASED_GRID
    pitch, cell = (columns + 2) // BOX_COUNT, BOX_SIDE // rows
    item = grown.boxes[box_index].items[-1]
    middle = item.side // 2
    return RemoveItem(box_index * pitch + (item.x + middle) // cell, (item.y + middle) // cell)


def _some_looks(rng: random.Random) -> Looks:
    """Few looks make items alike, so that counting and comparing them is worth while."""
    counts = (1, 2, 2, 3, 3)
    return (
        rng.sample(list(Shape), rng.choice(counts)),
        rng.sample(list(Colour), rng.choice((1, 2, 3, 3, 3))),
        rng.sample(list(Size), rng.choice(counts)),
    )


def _any_scatter(rng: random.Random) -> Scene:
    looks = _some_looks(rng)
    most = rng.choice((1, 2, 3, 4, 6))
    scene = Scene.empty()
    for box_index in range(BOX_COUNT):
        for _ in range(rng.randint(0, most)):
            scene = _with_item(scene, box_index, rng, looks)
    return scene


def _with_item(scene: Scene, box_index: int, rng: random.Random, looks: Looks) -> Scene:
    """The scene with one more item where it fits and is plain to see, else the scene as it is."""
    shapes, colours, sizes = looks
    shape, colour, size = rng.choice(shapes), rng.choice(colours), rng.choice(sizes)
    box = scene.boxes[box_index]
    for _ in range(TRIES):
        x, y = _some_place(rng, size.pixels, box.items)
        item = Item(x, y, shape, colour, size)
        if fits_box(item.footprint, x, y) and is_free(item.footprint, x, y, box.items):
            grown = Box((*box.items, item))
            if is_legible(grown):
                return scene.with_box(box_index, grown)
    return scene


def _some_place(rng: random.Random, side: int, others: tuple[Item, ...]) -> tuple[int, int]:
    """A place in a box: anywhere, often at or near a wall or another item."""
    last = BOX_SIDE - side
    x, y = rng.randint(CLEAR_GAP, last - CLEAR_GAP), rng.randint(CLEAR_GAP, last - CLEAR_GAP)
    gap = rng.choice((0, 0, 0, rng.choice(NEAR_GAPS)))
    match rng.choice(("free", "free", "wall", "corner", "beside")):
        case "wall":
            return rng.choice(((gap, y), (last - gap, y), (x, gap), (x, last - gap)))
        case "corner":
            return rng.choice((gap, last - gap)), rng.choice((gap, last - gap))
        case "beside" if others:
            other = rng.choice(others)
            slide = rng.randint(-side // 2, other.side // 2)
            before, after = -side - gap, other.side + gap
            dx, dy = rng.choice(((before, slide), (after, slide), (slide, before), (slide, after)))
            return other.x + dx, other.y + dy
        case _:
            return x, y


def is_legible(box: Box) -> bool:
    """Whether it is plain for every item of the box if it touches a wall or another item, nearly does, or does not."""
    walls = (gap for item in box.items for gap in _wall_gaps(item))
    pairs = (_gap(one, other) - TOUCHING_GAP for one, other in combinations(box.items, 2))
    return all(gap <= 0 or gap in NEAR_GAPS or gap >= CLEAR_GAP - TOUCHING_GAP for gap in (*walls, *pairs))


def _wall_gaps(item: Item) -> tuple[int, int, int, int]:
    last = BOX_SIDE - item.side
    return item.x, item.y, last - item.x, last - item.y


def _gap(one: Item, other: Item) -> int:
    """Pixels between the bounding squares of two items, as the programs measure it (SPEC section 8)."""
    along_x = max(one.x - other.x - other.side, other.x - one.x - one.side)
    along_y = max(one.y - other.y - other.side, other.y - one.y - one.side)
    return max(along_x, along_y)
