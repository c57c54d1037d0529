"""Random scenes of each appearance, and random single-item changes, for synthesizing start scenes."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from lilgym_mp.envs.rules import RULE_SETS
from lilgym_mp.scene import BOX_COUNT, BOX_SIDE, Box, Colour, Item, Scene, Shape, Size
from lilgym_mp.scene.appearances import make_appearance
from lilgym_mp.scene.appearances.base import fits_box
from lilgym_mp.scene.appearances.placement import is_free
from lilgym_mp.scene.choices import listed

# Values to draw uniformly from; repeated ones are more likely
ATTRIBUTE_VALUE_COUNTS = (1, 2, 3, 3)  # distinct colours, shapes or sizes in a scene
TOWER_HEIGHTS = (0, 1, 1, 2, 2, 3, 3, 4)
MAX_BOX_ITEMS = (1, 2, 4, 6, 8)  # limits on the items per box of a Scatter scene
_PLACEMENT = RULE_SETS["paper"].placement


class ItemTypes(NamedTuple):
    """The shapes, colours and sizes to draw items from."""

    shapes: tuple[Shape, ...] = tuple(Shape)
    colours: tuple[Colour, ...] = tuple(Colour)
    sizes: tuple[Size, ...] = tuple(Size)

    @classmethod
    def sample(
        cls, rng: random.Random, shapes: Sequence[int], colours: Sequence[int], sizes: Sequence[int]
    ) -> ItemTypes:
        """Random values, as many of each attribute as one of the numbers."""
        return cls(
            tuple(rng.sample(list(Shape), rng.choice(shapes))),
            tuple(rng.sample(list(Colour), rng.choice(colours))),
            tuple(rng.sample(list(Size), rng.choice(sizes))),
        )


ALL_ITEM_TYPES = ItemTypes()


class ItemPlacing(NamedTuple):
    """How a random place for an item is found."""

    attempts: int = 20
    margin: int = 0  # fewest pixels to the walls, unless the item is put at one
    gap: Callable[[random.Random], int] = lambda rng: 0  # draws the pixels to the wall or item that it is put at
    accepts: Callable[[Box], bool] = lambda box: True  # whether the box is as required with the new item


ANYWHERE = ItemPlacing()


class Sampler(NamedTuple):
    """Draws a random non-empty scene of one appearance, or changes a scene by one item."""

    scene: Callable[[random.Random], Scene]
    changed: Callable[[random.Random, Scene], Scene]


def _random_tower(rng: random.Random) -> Scene:
    tower = make_appearance("tower")
    colours = rng.sample(list(Colour), rng.choice(ATTRIBUTE_VALUE_COUNTS))
    scene = Scene.empty()
    while not any(scene.items()):
        for box in range(BOX_COUNT):
            for _ in range(rng.choice(TOWER_HEIGHTS)):
                scene = tower.apply(scene, tower.from_array([1, box, rng.choice(colours)]), _PLACEMENT).scene
    return scene


def _changed_tower(rng: random.Random, scene: Scene) -> Scene:
    tower = make_appearance("tower")
    while True:
        changed = tower.apply(scene, tower.decode(rng.randrange(1, tower.action_count)), _PLACEMENT)
        if changed.invalid is None and any(changed.scene.items()):
            return changed.scene


def _random_scatter(rng: random.Random) -> Scene:
    item_types = ItemTypes.sample(rng, *[ATTRIBUTE_VALUE_COUNTS] * 3)
    limit = rng.choice(MAX_BOX_ITEMS)
    while not any((scene := scattered(rng, item_types, limit)).items()):
        pass
    return scene


def _changed_scatter(rng: random.Random, scene: Scene) -> Scene:
    while True:
        index = rng.randrange(BOX_COUNT)
        box = scene.boxes[index]
        if box.items and rng.random() < 0.5:
            changed = scene.with_box(index, box.without(rng.randrange(len(box.items))))
        else:
            changed = with_item(rng, scene, index, ALL_ITEM_TYPES)
        if changed is not scene and any(changed.items()):
            return changed


def scattered(rng: random.Random, item_types: ItemTypes, limit: int, placing: ItemPlacing = ANYWHERE) -> Scene:
    """A scene with random items, at most `limit` in each box; it may be empty."""
    scene = Scene.empty()
    for box in range(BOX_COUNT):
        for _ in range(rng.randint(0, limit)):
            scene = with_item(rng, scene, box, item_types, placing)
    return scene


def with_item(
    rng: random.Random, scene: Scene, index: int, item_types: ItemTypes, placing: ItemPlacing = ANYWHERE
) -> Scene:
    """The scene with one item added to a box, or the same scene object when no free position was found."""
    shape = rng.choice(item_types.shapes)
    colour = rng.choice(item_types.colours)
    size = rng.choice(item_types.sizes)
    box = scene.boxes[index]
    for _ in range(placing.attempts):
        x, y = _random_position(rng, size.pixels, box.items, placing)
        item = Item(x, y, shape, colour, size)
        if fits_box(item.footprint, x, y) and is_free(item.footprint, x, y, box.items):
            changed = box.with_item(item)
            if placing.accepts(changed):
                return scene.with_box(index, changed)
    return scene


def _random_position(rng: random.Random, side: int, others: tuple[Item, ...], placing: ItemPlacing) -> tuple[int, int]:
    """A random position in a box: anywhere, at a wall, in a corner, or beside another item."""
    last = BOX_SIDE - side
    x, y = (rng.randint(placing.margin, last - placing.margin) for _ in "xy")
    gap = placing.gap(rng)
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


_SAMPLERS: Mapping[str, Sampler] = {
    "tower": Sampler(_random_tower, _changed_tower),
    "scatter": Sampler(_random_scatter, _changed_scatter),
}


def sampler_of(appearance: str) -> Sampler:
    """The sampler of an appearance's scenes. Raises ValueError naming the appearances that have one."""
    if appearance not in _SAMPLERS:
        raise ValueError(
            f"appearance {appearance!r} has no sampler of scenes; those that have one: {listed(_SAMPLERS)}"
        )
    return _SAMPLERS[appearance]
