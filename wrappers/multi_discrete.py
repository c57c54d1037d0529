"""Actions in the released array form."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from lilgym_mp.actions import STOP, ActionType
from lilgym_mp.arrays import BoolArray, Int64Array
from lilgym_mp.choices import choose
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.transformation import Batch, EnvDescription, EnvState, Transformation

NUMBERS, SLOTS = "numbers", "slots"  # one mask entry per action index, or per value of each slot
MASKS = {form: form for form in (NUMBERS, SLOTS)}


class ArrayDecoding(Transformation):
    """Decodes batches of action arrays to action indices."""

    changes_actions = True
    uses_mdp_actions = True

    def __init__(self, description: EnvDescription, *, masks: str) -> None:
        super().__init__(description)
        description.require_discrete_actions()
        self._by_slots = choose("masks", masks, MASKS) == SLOTS
        self._appearance = description.dynamics.appearance
        # Each action type has consecutive indices, last slot fastest (docs/spec.md, "Actions"): the first of them, and
        # the array form of the last action, which has the largest value of each slot, -1 if unused.
        unused = [0] * (len(self._appearance.to_array(STOP)) - 1)
        arrays = ([int(action_type), *unused] for action_type in ActionType)
        self._firsts = [self._appearance.encode(self._appearance.from_array(array)) for array in arrays]
        ends = [*self._firsts[1:], self._appearance.action_count]
        self._lasts = np.array([self._appearance.to_array(self._appearance.decode(end - 1)) for end in ends])
        self._sizes = 1 + self._lasts.max(axis=0)

    def action_space(self) -> spaces.MultiDiscrete:
        return spaces.MultiDiscrete(self._sizes)

    def actions(self, actions: Batch, state: EnvState) -> tuple[Batch, Mapping[str, BoolArray]]:
        """Raises ActionError for an array of another shape or a value out of range."""
        arrays = np.asarray(actions)
        if arrays.ndim != 2 or arrays.shape[1] != len(self._sizes) or arrays.dtype.kind not in "iu":
            return self._decode_one_by_one(actions), {}
        indices = np.zeros(len(arrays), np.int64)
        is_valid = np.zeros(len(arrays), np.bool_)
        for action_type, (last, first_index) in enumerate(zip(self._lasts, self._firsts, strict=True)):
            rows = arrays[:, 0] == action_type
            slots = np.flatnonzero(last[1:] >= 0) + 1
            values = arrays[np.ix_(rows, slots)]
            is_valid[rows] = ((values >= 0) & (values <= last[slots])).all(axis=1)
            if slots.size and is_valid[rows].all():
                indices[rows] = first_index + np.ravel_multi_index(tuple(values.T), tuple(last[slots] + 1))
        return (indices if is_valid.all() else self._decode_one_by_one(arrays)), {}

    def action_masks(self, state: EnvState) -> BoolArray:
        legal = state.action_masks()
        if not self._by_slots:
            return legal
        values = self._slot_values
        flags = [
            np.stack([legal[:, values[:, slot] == value].any(axis=1) for value in range(size)], axis=1)
            for slot, size in enumerate(self._sizes)
        ]
        for slot in flags:
            slot[~slot.any(axis=1)] = True  # no legal action uses the slot, so its value is ignored
        return np.concatenate(flags, axis=1)

    @cached_property
    def _slot_values(self) -> Int64Array:
        """(actions, slots) the array form of each action, -1 in unused slots."""
        appearance = self._appearance
        return np.array([appearance.to_array(appearance.decode(index)) for index in range(appearance.action_count)])

    def _decode_one_by_one(self, arrays: Batch) -> Int64Array:
        """The slow path, for its error messages."""
        return np.array([self._appearance.encode(self._appearance.from_array(array)) for array in arrays])


class MultiDiscreteActions(EnvWrapper[ArrayDecoding]):
    """Takes actions in the released array form, MultiDiscrete: [type, box, colour] for Tower, [type, x, y, shape,
    colour, size] for Scatter. Slots that an action type does not use may have any value, such as the release's -1.

    `masks="numbers"`: `action_masks()` has one flag per action index, as without this wrapper. `masks="slots"`, as
    MaskablePPO expects: (sum of slot sizes,), one flag per value of each slot, false if no legal action has it;
    combinations of such values may still be illegal. Raises ValueError for other `masks`, and ActionError in `step`
    for an array of the wrong shape or a value out of range.
    """

    transformation_class = ArrayDecoding

    def __init__(self, env: gym.Env[Any, Any], *, masks: str = NUMBERS) -> None:
        super().__init__(env, masks=masks)
