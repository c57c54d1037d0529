"""Mapping between the network's logits and action indices.

Logits are ordered STOP; ADD by box, cell and item type; REMOVE by box and cell. A Tower box is a single cell with three
item types, its colours. Cells on a separator have no logits, as no edit is ever legal there.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np

from lilgym_mp.learning.common.augmentation import RECOLOURINGS
from lilgym_mp.learning.imitation.box_features import CELLS
from lilgym_mp.scene import BOX_COUNT, BOX_PITCH, BOX_SIDE, Colour
from lilgym_mp.scene.actions import STOP, Action, AddBlock, AddItem, RemoveBlock, RemoveItem
from lilgym_mp.scene.appearances import Appearance
from lilgym_mp.scene.appearances.scatter import ITEM_TYPES
from lilgym_mp.scene.arrays import Int64Array

COLUMN_STEP = CELLS * BOX_PITCH // BOX_SIDE  # columns of the image's grid from a box to the next
STOP_INDEX = 0  # index of STOP's logit


@dataclass(frozen=True)
class ActionHeads:
    """The logits of all heads as one row of length `size`: STOP, the ADDs, the REMOVEs."""

    cells: int  # per box
    item_types: int
    action_of: Int64Array  # (size,) logit index -> action index
    index_of: Int64Array  # (actions,) action index -> logit index; -1 for actions without a logit
    recoloured: Int64Array  # (6, size) logit index under each of RECOLOURINGS

    @property
    def add_count(self) -> int:
        return BOX_COUNT * self.cells * self.item_types

    @property
    def remove_count(self) -> int:
        return BOX_COUNT * self.cells

    @property
    def size(self) -> int:
        return 1 + self.add_count + self.remove_count


@cache
def action_heads(appearance: Appearance) -> ActionHeads:
    """The heads for Tower, or for Scatter on the released grid."""
    boxes = range(BOX_COUNT)
    if appearance.grid is None:
        adds: list[Action] = [AddBlock(box, colour) for box in boxes for colour in Colour]
        removes: list[Action] = [RemoveBlock(box) for box in boxes]
    else:
        cells = [(box * COLUMN_STEP + x, y) for box, x, y in product(boxes, range(CELLS), range(CELLS))]
        adds = [AddItem(*cell, *item_type) for cell in cells for item_type in ITEM_TYPES]
        removes = [RemoveItem(*cell) for cell in cells]
    actions = [STOP, *adds, *removes]
    action_of = np.array([*map(appearance.encode, actions)], np.int64)
    index_of = np.full(appearance.action_count, -1, np.int64)
    index_of[action_of] = np.arange(len(action_of))
    recoloured = [
        [index_of[appearance.encode(recolouring.action(action))] for action in actions] for recolouring in RECOLOURINGS
    ]
    per_box, item_types = len(removes) // BOX_COUNT, len(adds) // len(removes)
    return ActionHeads(per_box, item_types, action_of, index_of, np.array(recoloured, np.int64))
