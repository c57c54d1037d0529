"""Tower: medium squares stacked in the middle of each box, added and removed at the top.

There are only 121 possible stacks, so each box exists once, with its four successors.
Source: docs/spec.md, "Scenes", "Actions", "Legality and effects".
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from lilgym_mp.scene import Box, Colour, Scene, SceneError, Shape, new_tuple
from lilgym_mp.scene.actions import BOX_NAMES, Action, ActionError, AddBlock, RemoveBlock, TowerAction
from lilgym_mp.scene.appearances.base import Edit, EveryBox, Grid, PlacementRules
from lilgym_mp.scene.appearances.tower import geometry
from lilgym_mp.scene.appearances.tower.actions import ACTIONS, ARRAY_FORM, INDICES
from lilgym_mp.scene.appearances.tower.geometry import CAPACITY, EDIT_REASONS, REMOVE_COLUMN, successors
from lilgym_mp.scene.arrays import BoolArray

if TYPE_CHECKING:
    from lilgym_mp.scene.appearances.sampling import Sampler


@dataclass(frozen=True, slots=True)
class Tower:
    """13 actions: STOP, ADD(box, colour) for 3 boxes x 3 colours, REMOVE(box) for 3 boxes."""

    name = "tower"
    action_count = len(ACTIONS)
    grid = None
    shapes = (Shape.SQUARE,)
    example = AddBlock(0, Colour.BLUE)
    box_capacity = CAPACITY
    given_words = ("MEDIUM", "SQUARE")

    @property
    def every_box(self) -> EveryBox:
        """All 121 boxes, and the edits between any two."""
        return geometry.every_box()

    @property
    def sampler(self) -> Sampler:
        """Imported when first used."""
        from lilgym_mp.scene.appearances.tower.sampling import TowerSampler

        return TowerSampler()

    def decode(self, index: int) -> Action:
        return ACTIONS[index]

    def encode(self, action: Action) -> int:
        if isinstance(action, TowerAction) and action in INDICES:
            return INDICES[action]
        raise ActionError(f"{action!r} is not an action of tower")

    def from_array(self, values: Sequence[int]) -> Action:
        return ARRAY_FORM.read(values)

    def to_array(self, action: Action) -> list[int]:
        return ARRAY_FORM.write(action)

    def apply(self, scene: Scene, action: Action, rules: PlacementRules) -> Edit:
        if isinstance(action, AddBlock):
            column = action.colour
        elif isinstance(action, RemoveBlock):
            column = REMOVE_COLUMN
        else:
            raise ActionError(f"{action!r} is not an edit of tower")
        box = successors(scene.boxes[action.box])[column]
        if box is None:
            return Edit(scene, EDIT_REASONS[column])
        return new_tuple(Edit, (scene.with_box(action.box, box), None))

    def legal_mask(self, scene: Scene, rules: PlacementRules) -> BoolArray:
        left, middle, right = scene.boxes
        return geometry.legal_by_heights()[len(left.items), len(middle.items), len(right.items)].copy()

    def explain(self, rules: PlacementRules) -> Iterator[str]:
        boxes = "|".join(BOX_NAMES)
        colours = "|".join(colour.name for colour in Colour)
        yield f"ADD({boxes}, {colours}) puts a block on top of a box's tower, which holds {CAPACITY}."
        yield f"REMOVE({boxes}) takes the top block away."

    def check_scene(self, scene: Scene) -> Scene:
        """The same scene, composed of the shared boxes."""
        boxes: list[Box] = []
        for index, box in enumerate(scene.boxes):
            try:
                boxes.append(geometry.shared_box(box))
            except SceneError as fault:
                raise SceneError(f"box {index}: {fault}") from None
        return Scene.of_boxes(boxes)


def make_tower(grid: Grid) -> Tower:
    """`grid` does not apply."""
    return Tower()
