"""The protocol of an appearance, through which everything else uses Tower and Scatter."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from enum import StrEnum
from functools import lru_cache
from typing import Any, NamedTuple, Protocol

import numpy as np

from lilgym_mp.scene import BOX_SIDE, FOOTPRINT_SIDES, Box, Scene, Shape
from lilgym_mp.scene.actions import Action, ActionError
from lilgym_mp.scene.arrays import BoolArray, Int64Array

Grid = tuple[int, int]  # columns and rows
LAST_CORNER = tuple(BOX_SIDE - side for side in FOOTPRINT_SIDES)  # by footprint: largest x and y inside the box


def fits_box(footprint: int, x: int, y: int) -> bool:
    """Whether an item with its top-left corner at (x, y) pixels lies within a box."""
    return 0 <= x <= LAST_CORNER[footprint] and 0 <= y <= LAST_CORNER[footprint]


class PlacementRules(NamedTuple):
    """How a rule set places items."""

    searches_cell: bool  # if the item overlaps others at the cell's corner, other positions in the cell are tried
    keeps_unfit_snaps: bool  # a snap applies even if the item then leaves the box or overlaps others
    rounds_in_image: bool  # nearest points are rounded in full-image, not box-local, coordinates


class InvalidReason(StrEnum):
    """Why an action of the MDP is invalid in a scene."""

    SEPARATOR = "separator"
    OVERLAP = "overlap"
    OUT_OF_BOX = "out_of_box"
    FULL_TOWER = "full_tower"
    EMPTY_TOWER = "empty_tower"
    NOTHING_TO_REMOVE = "nothing_to_remove"


class Edit(NamedTuple):
    """The result of an edit: the scene after it (unchanged if invalid), and why it is invalid."""

    scene: Scene
    invalid: InvalidReason | None = None


class EveryBox(NamedTuple):
    """All boxes that an appearance can have, where they are few."""

    boxes: Sequence[Box]  # (B,)
    distances: Int64Array  # (B, B) edits from one to another


class Appearance(Protocol):
    """A family of scenes with its actions. Actions have indices 0 .. action_count - 1; 0 is STOP.

    An appearance may also have `every_box` (EveryBox), `given_words` and `sampler`, which `optional` looks up.
    """

    @property
    def name(self) -> str:
        """The name in configurations."""
        ...

    @property
    def action_count(self) -> int:
        """The number of actions; index 0 is STOP."""
        ...

    @property
    def grid(self) -> Grid | None:
        """The (columns, rows) whose cells actions name (AddItem, RemoveItem); None if they name boxes (AddBlock,
        RemoveBlock)."""
        ...

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """The shapes that items can have."""
        ...

    @property
    def example(self) -> Action:
        """An ADD, for help texts."""
        ...

    @property
    def box_capacity(self) -> int | None:
        """The most items that a box can hold; None if only geometry limits it."""
        ...

    def decode(self, index: int) -> Action:
        """The action with this index, which must be in range."""
        ...

    def encode(self, action: Action) -> int:
        """The index of `action`. Raises ActionError if it is not an action of this appearance."""
        ...

    def from_array(self, values: Sequence[int]) -> Action:
        """The action in the released array form; unused slots are ignored. Raises ActionError."""
        ...

    def to_array(self, action: Action) -> list[int]:
        """The released array form, -1 in unused slots."""
        ...

    def apply(self, scene: Scene, action: Action, rules: PlacementRules) -> Edit:
        """Applies `action`, which must not be STOP, to `scene`."""
        ...

    def legal_mask(self, scene: Scene, rules: PlacementRules) -> BoolArray:
        """(action_count,) a new array: whether `apply` finds each action valid. STOP always is."""
        ...

    def explain(self, rules: PlacementRules) -> Iterator[str]:
        """Sentences that explain the actions, in the form of `actions.describe`."""
        ...

    def check_scene(self, scene: Scene) -> Scene:
        """`scene`, ready for play. Raises SceneError when it cannot be a scene of this appearance."""
        ...


class ArrayForm(NamedTuple):
    """The released array form of an appearance's actions: type and slots, -1 in those that the type does not use."""

    appearance: str
    slots: Mapping[str, Sequence[int]]  # their values
    actions: tuple[type[Action], type[Action], type[Action]]  # by ActionType; each has the first slots as fields

    def read(self, values: Sequence[int]) -> Action:
        """Ignores unused slots. Raises ActionError."""
        names = ("type", *self.slots)
        array = np.asarray(values)
        if array.shape != (len(names),) or array.dtype.kind not in "iu":
            form = ", ".join(names)
            raise ActionError(f"an action array must be {len(names)} whole numbers [{form}], not {values!r}")
        number, *rest = array.tolist()
        action = self.actions[slot_value("type", number, len(self.actions))]
        used = zip(self.slots.items(), rest, action._fields, strict=False)
        found: list[Any] = [choices[slot_value(name, value, len(choices))] for (name, choices), value, _ in used]
        return action(*found)

    def write(self, action: Action) -> list[int]:
        """Raises ActionError."""
        if type(action) not in self.actions:
            raise ActionError(f"{action!r} is not an action of {self.appearance}")
        return [self.actions.index(type(action)), *map(int, action), *[-1] * (len(self.slots) - len(action))]


def slot_value(name: str, value: int, count: int) -> int:
    """`value` when it is in 0 .. count - 1. Raises ActionError."""
    if 0 <= value < count:
        return value
    raise ActionError(f"{name} {value} of the action is out of range; choose from 0 .. {count - 1}")


@lru_cache(maxsize=4)
def action_arrays(appearance: Appearance) -> Int64Array:
    """(actions, slots) the released array form of each action: its type, then its arguments, -1 in unused slots."""
    indices = range(appearance.action_count)
    return np.array([appearance.to_array(appearance.decode(index)) for index in indices], np.int64)


def optional(appearance: Appearance, member: str) -> Any:
    """A member that only some appearances have; None if this one has it not.

    `every_box`: an `EveryBox`; `given_words`: words, in capitals, of properties that all its items have, which a reply
    may name; `sampler`: a `sampling.Sampler` of its scenes.
    """
    return getattr(appearance, member, None)
