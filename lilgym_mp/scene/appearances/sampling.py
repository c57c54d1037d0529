"""What an appearance may have to draw random scenes, and near misses of statements in them."""

from __future__ import annotations

from collections.abc import Sequence
from random import Random
from typing import NamedTuple, Protocol

from lilgym_mp.scene import Colour, Scene, Shape, Size
from lilgym_mp.scene.actions import Action

ATTRIBUTE_VALUE_COUNTS = (1, 2, 3, 3)  # distinct colours, shapes or sizes in a scene; repeated ones are more likely


class ItemTypes(NamedTuple):
    """The shapes, colours and sizes to draw items from."""

    shapes: tuple[Shape, ...] = tuple(Shape)
    colours: tuple[Colour, ...] = tuple(Colour)
    sizes: tuple[Size, ...] = tuple(Size)

    @classmethod
    def sample(cls, rng: Random, shapes: Sequence[int], colours: Sequence[int], sizes: Sequence[int]) -> ItemTypes:
        """Random values, as many of each attribute as one of the numbers."""
        return cls(
            tuple(rng.sample(list(Shape), rng.choice(shapes))),
            tuple(rng.sample(list(Colour), rng.choice(colours))),
            tuple(rng.sample(list(Size), rng.choice(sizes))),
        )

    @classmethod
    def few(cls, rng: Random) -> ItemTypes:
        """Random values, few of which make items alike, so that counts and comparisons vary."""
        counts = (1, 2, 2, 3, 3)
        return cls.sample(rng, counts, (1, 2, 3, 3, 3), counts)


class Sampler(Protocol):
    """Draws random scenes of one appearance, and edits of them."""

    def scene(self, rng: Random) -> Scene:
        """A random scene that is not empty."""
        ...

    def changed(self, rng: Random, scene: Scene) -> Scene:
        """The scene changed by one item, not empty."""
        ...

    def legible_scene(self, rng: Random) -> Scene:
        """A random scene in which people see what touches what. It may be empty."""
        ...

    def addition(self, rng: Random, item_types: ItemTypes, box: int) -> Action:
        """A random ADD to a box, legal or not."""
        ...

    def removal(self, successor: Scene, box: int) -> Action:
        """The REMOVE that should undo the ADD of the last item of a box."""
        ...
