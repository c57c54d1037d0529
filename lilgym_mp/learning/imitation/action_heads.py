"""Mapping between the network's logits and action indices.

Logits are ordered STOP; ADD by box, cell and item type; REMOVE by box and cell. A Tower box is a single cell with three
item types, its colours. Cells on a separator have no logits, as no edit is ever legal there.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import prod

import numpy as np

from lilgym_mp.learning.common.augmentation import RECOLOURINGS
from lilgym_mp.learning.common.factored_policy import STOP, edit_actions, joint_factorisation
from lilgym_mp.scene import BOX_COUNT
from lilgym_mp.scene.actions import ActionType
from lilgym_mp.scene.appearances import Appearance
from lilgym_mp.scene.appearances.places import places_of
from lilgym_mp.scene.arrays import Int64Array

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
        """The number of ADD actions."""
        return BOX_COUNT * self.cells * self.item_types

    @property
    def remove_count(self) -> int:
        """The number of REMOVE actions."""
        return BOX_COUNT * self.cells

    @property
    def size(self) -> int:
        """The number of actions: STOP, all ADD and all REMOVE."""
        return 1 + self.add_count + self.remove_count


@cache
def action_heads(appearance: Appearance) -> ActionHeads:
    """The heads for Tower, or for Scatter on the released grid."""
    factorisation = joint_factorisation(appearance)
    adds = edit_actions(factorisation, ActionType.ADD, (0,))
    removes = edit_actions(factorisation, ActionType.REMOVE, (1,))
    shape = places_of(appearance.grid).box_shape
    cells = BOX_COUNT, *shape  # by row, then column; here by column, then row
    adds, removes = (actions.reshape(*cells, -1).swapaxes(1, 2).ravel() for actions in (adds, removes))
    action_of = np.concatenate([[STOP], adds, removes])
    index_of = np.full(appearance.action_count, -1, np.int64)
    index_of[action_of] = np.arange(len(action_of))
    actions = [*map(appearance.decode, action_of.tolist())]
    recoloured = [
        [index_of[appearance.encode(recolouring.action(action))] for action in actions] for recolouring in RECOLOURINGS
    ]
    return ActionHeads(prod(shape), len(adds) // len(removes), action_of, index_of, np.array(recoloured, np.int64))
