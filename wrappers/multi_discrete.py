"""Actions in the released array form."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from lilgym_mp.actions import STOP, ActionType
from lilgym_mp.appearances import Appearance
from lilgym_mp.arrays import BoolArray, Int64Array
from lilgym_mp.choices import choose
from lilgym_mp.wrappers.env_state import EnvDescription, EnvState
from lilgym_mp.wrappers.factory import factory
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.transformation import Batch, Transformation

NUMBERS, SLOTS = "numbers", "slots"
MASKS = {form: form for form in (NUMBERS, SLOTS)}  # what masks have a flag for


class _Form(NamedTuple):
    """The actions of one type, numbered on end, the last slot fastest (SPEC section 3)."""

    last: Int64Array  # (slots,) the array form of the last one: the largest value of each slot, -1 where unused
    first_number: int


class ArrayForm(Transformation):
    """Action arrays to action numbers, a whole batch at once."""

    changes_actions = True
    concerns_actions = True

    def __init__(self, description: EnvDescription, *, masks: str) -> None:
        super().__init__(description)
        description.numbered_actions()
        self._by_slots = choose("masks", masks, MASKS) == SLOTS
        self._appearance = description.dynamics.appearance
        self._forms = _forms(self._appearance)
        self._sizes = 1 + np.max([form.last for form in self._forms], axis=0)

    def action_space(self) -> spaces.MultiDiscrete:
        return spaces.MultiDiscrete(self._sizes)

    def actions(self, actions: Batch, state: EnvState) -> tuple[Batch, Mapping[str, BoolArray]]:
        """Raises ActionError for an array of another shape or a value out of range."""
        arrays = np.asarray(actions)
        if arrays.ndim != 2 or arrays.shape[1] != len(self._sizes) or arrays.dtype.kind not in "iu":
            return self._one_by_one(actions), {}
        numbers = np.zeros(len(arrays), np.int64)
        known = np.zeros(len(arrays), np.bool_)
        for kind, (last, first_number) in enumerate(self._forms):
            rows = arrays[:, 0] == kind
            slots = np.flatnonzero(last[1:] >= 0) + 1
            values = arrays[np.ix_(rows, slots)]
            known[rows] = ((values >= 0) & (values <= last[slots])).all(axis=1)
            if slots.size and known[rows].all():
                numbers[rows] = first_number + np.ravel_multi_index(tuple(values.T), tuple(last[slots] + 1))
        return (numbers if known.all() else self._one_by_one(arrays)), {}

    def legal(self, state: EnvState) -> BoolArray:
        legal = state.legal()
        if not self._by_slots:
            return legal
        values = self._slot_values
        flags = [
            np.stack([legal[:, values[:, slot] == value].any(axis=1) for value in range(size)], axis=1)
            for slot, size in enumerate(self._sizes)
        ]
        for slot in flags:
            slot[~slot.any(axis=1)] = True  # no legal action uses the slot: what stands there is ignored
        return np.concatenate(flags, axis=1)

    @cached_property
    def _slot_values(self) -> Int64Array:
        """(actions, slots) the array form of each action, -1 where unused."""
        appearance = self._appearance
        return np.array([appearance.to_array(appearance.decode(n)) for n in range(appearance.action_count)])

    def _one_by_one(self, arrays: Batch) -> Int64Array:
        """The slow way, which explains what is wrong."""
        return np.array([self._appearance.encode(self._appearance.from_array(array)) for array in arrays])


def _forms(appearance: Appearance) -> list[_Form]:
    """By ActionType."""
    unused = [0] * (len(appearance.to_array(STOP)) - 1)
    firsts = [appearance.encode(appearance.from_array([int(kind), *unused])) for kind in ActionType]
    ends = [*firsts[1:], appearance.action_count]
    lasts = [np.array(appearance.to_array(appearance.decode(end - 1))) for end in ends]
    return [_Form(last, first) for last, first in zip(lasts, firsts, strict=True)]


class MultiDiscreteActions(EnvWrapper[ArrayForm]):
    """Takes actions in the released array form: [type, box, colour] for Tower, [type, x, y, shape, colour, size] for
    Scatter, MultiDiscrete; slots that a type leaves unused may hold anything, -1 as in the release included.

    `masks="numbers"`: `action_masks()` stays one flag for each numbered action. `masks="slots"`, what MaskablePPO
    takes: (sum of slot sizes,), one flag for each value of each slot, false where no legal action has it; combinations
    of such values may still be illegal. Raises ValueError for other `masks`, ActionError in `step` for an array of
    another shape or a value out of range.
    """

    transformation_class = ArrayForm

    def __init__(self, env: gym.Env[Any, Any], *, masks: str = NUMBERS) -> None:
        super().__init__(env, masks=masks)


multi_discrete_actions_v0 = factory(MultiDiscreteActions)
