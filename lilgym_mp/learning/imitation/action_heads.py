"""The actions as the network's heads have them: STOP; ADD by box, cell and look; REMOVE by box and cell.

A Tower box is one cell with three looks, its colours. Cells on a separator are left out: nothing can be done there.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import permutations, product

import numpy as np

from lilgym_mp.actions import Action, AddBlock, AddItem, RemoveBlock, RemoveItem
from lilgym_mp.appearances import Scatter, Tower
from lilgym_mp.appearances.scatter import ITEM_TYPES
from lilgym_mp.arrays import Int64Array
from lilgym_mp.learning.imitation.box_features import CELLS
from lilgym_mp.scene import BOX_COUNT, BOX_PITCH, BOX_SIDE, Colour

COLOUR_ORDERS = tuple(permutations(range(len(Colour))))  # the first changes nothing; colour c becomes order[c]
COLUMN_STEP = CELLS * BOX_PITCH // BOX_SIDE  # columns of the image's grid from a box to the next
STOP_INDEX = 0


@dataclass(frozen=True)
class ActionHeads:
    """The heads' outputs as one row: STOP, the ADDs, the REMOVEs."""

    cells: int  # of a box
    item_types: int
    action_of: Int64Array  # (heads,) the appearance's index of each of the heads' actions
    index_of: Int64Array  # (actions,) the other way; -1 for actions that the heads leave out
    recoloured: Int64Array  # (6, heads) what each action becomes under each of COLOUR_ORDERS

    @property
    def adds(self) -> int:
        return BOX_COUNT * self.cells * self.item_types

    @property
    def removes(self) -> int:
        return BOX_COUNT * self.cells

    @property
    def size(self) -> int:
        return 1 + self.adds + self.removes


@cache
def action_heads(appearance: Tower | Scatter) -> ActionHeads:
    """The heads for Tower or for Scatter on the released grid."""
    edits = _tower_edits() if isinstance(appearance, Tower) else _scatter_edits()
    adds, removes = edits
    numbers = [0, *(appearance.encode(action) for action in (*adds, *removes))]
    action_of = np.array(numbers, np.int64)
    index_of = np.full(appearance.action_count, -1, np.int64)
    index_of[action_of] = np.arange(len(action_of))
    actions = [appearance.decode(number) for number in numbers]
    recoloured = [
        [index_of[appearance.encode(_recoloured(action, order))] for action in actions] for order in COLOUR_ORDERS
    ]
    cells = len(removes) // BOX_COUNT
    return ActionHeads(cells, len(adds) // len(removes), action_of, index_of, np.array(recoloured, np.int64))


def _tower_edits() -> tuple[list[Action], list[Action]]:
    boxes = range(BOX_COUNT)
    return [AddBlock(box, colour) for box in boxes for colour in Colour], [RemoveBlock(box) for box in boxes]


def _scatter_edits() -> tuple[list[Action], list[Action]]:
    cells = [(box * COLUMN_STEP + x, y) for box, x, y in product(range(BOX_COUNT), range(CELLS), range(CELLS))]
    adds: list[Action] = [AddItem(*cell, *item_type) for cell in cells for item_type in ITEM_TYPES]
    return adds, [RemoveItem(*cell) for cell in cells]


def _recoloured(action: Action, order: tuple[int, ...]) -> Action:
    if isinstance(action, AddBlock | AddItem):
        return action._replace(colour=Colour(order[action.colour]))
    return action
