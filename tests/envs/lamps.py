"""An appearance that the package does not have: each box has one yellow circle or none."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from lilgym_mp.scene import Box, Colour, Item, Scene, SceneError, Shape, Size
from lilgym_mp.scene.actions import STOP, Action, ActionError, AddBlock, RemoveBlock, Stop
from lilgym_mp.scene.appearances.base import ArrayForm, Edit, InvalidReason, PlacementRules
from lilgym_mp.scene.arrays import BoolArray

NAME = "lamps"
LAMP = Item(40, 40, Shape.CIRCLE, Colour.YELLOW, Size.MEDIUM)
ACTIONS: tuple[Action, ...] = (
    STOP,
    *(AddBlock(box, Colour.YELLOW) for box in range(3)),
    *(RemoveBlock(box) for box in range(3)),
)
ARRAY_FORM = ArrayForm(NAME, {"box": range(3), "colour": (Colour.YELLOW,)}, (Stop, AddBlock, RemoveBlock))


class Lamps:
    """Each box has one yellow circle or none."""

    name = NAME
    action_count = len(ACTIONS)
    grid = None
    shapes = (Shape.CIRCLE,)
    example = AddBlock(0, Colour.YELLOW)
    box_capacity = 1

    def decode(self, index: int) -> Action:
        return ACTIONS[index]

    def encode(self, action: Action) -> int:
        if action not in ACTIONS:
            raise ActionError(f"{action} is not an action of lamps")
        return ACTIONS.index(action)

    def from_array(self, values: Sequence[int]) -> Action:
        return ARRAY_FORM.read(values)

    def to_array(self, action: Action) -> list[int]:
        return ARRAY_FORM.write(action)

    def apply(self, scene: Scene, action: Action, rules: PlacementRules) -> Edit:
        assert isinstance(action, AddBlock | RemoveBlock)
        adds, lit = isinstance(action, AddBlock), bool(scene.boxes[action.box].items)
        if adds == lit:
            return Edit(scene, InvalidReason.OVERLAP if adds else InvalidReason.NOTHING_TO_REMOVE)
        return Edit(scene.with_box(action.box, Box((LAMP,) if adds else ())))

    def legal_mask(self, scene: Scene, rules: PlacementRules) -> BoolArray:
        return np.array(
            [isinstance(action, Stop) or self.apply(scene, action, rules).invalid is None for action in ACTIONS]
        )

    def explain(self, rules: PlacementRules) -> Iterator[str]:
        yield "ADD(LEFT|MIDDLE|RIGHT, YELLOW) lights the lamp of a box; REMOVE(LEFT|MIDDLE|RIGHT) puts it out."

    def check_scene(self, scene: Scene) -> Scene:
        if any(box.items not in ((), (LAMP,)) for box in scene.boxes):
            raise SceneError("a box of lamps holds one lamp or none")
        return scene
