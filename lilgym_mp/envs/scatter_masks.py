"""Masks of many Scatter scenes at once, kept up to date box by box."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lilgym_mp.appearances import PlacementRules, Scatter
from lilgym_mp.appearances.scatter import LOOK_KINDS
from lilgym_mp.envs.block import BoolArray
from lilgym_mp.scene import BOX_COUNT, Item

Items = tuple[Item, ...]


class ScatterMasks:
    """Keeps masks equal to `Scatter.legal_mask`: an added item only takes away room, other changes begin anew."""

    def __init__(self, appearance: Scatter, rules: PlacementRules, masks: BoolArray) -> None:
        """`masks` (N, actions) are written in `refresh` only; until then they may be anything."""
        count = len(masks)
        self._legality = appearance.legality(rules)
        self._numbers = appearance.box_numbers
        self._masks = masks
        masks[:] = False
        masks[:, 0] = True
        self._shown: list[Items | None] = [None] * (BOX_COUNT * count)  # what the masks are of
        room, removable = self._legality.room(()), self._legality.removable(())
        self._room = np.empty((BOX_COUNT * count, *room.shape), room.dtype)
        self._removable = np.empty((BOX_COUNT * count, *removable.shape), np.bool_)

    def refresh(self, items: Sequence[Items]) -> None:
        """Makes the masks those of boxes with `items`, (3 N,) by 3 * environment + box."""
        changed = [row for row, (new, old) in enumerate(zip(items, self._shown, strict=True)) if new is not old]
        for row in changed:
            self._follow(row, items[row])
        for index, (adds, removes) in enumerate(self._numbers):
            rows = np.array([row for row in changed if row % BOX_COUNT == index], np.int64)
            if len(rows):
                addable = self._legality.addable(self._room[rows])[..., LOOK_KINDS]
                self._masks[rows // BOX_COUNT, adds] = addable.reshape(len(rows), -1)
                self._masks[rows // BOX_COUNT, removes] = self._removable[rows].reshape(len(rows), -1)

    def _follow(self, row: int, items: Items) -> None:
        old = self._shown[row]
        if old is not None and len(items) == len(old) + 1 and items[:-1] == old:
            self._legality.fill(self._room[row], items[-1])
            self._legality.cover(self._removable[row], items[-1])
        else:
            self._room[row] = self._legality.room(items)
            self._removable[row] = self._legality.removable(items)
        self._shown[row] = items
