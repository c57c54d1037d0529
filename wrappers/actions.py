"""Actions in other forms, and masks of actions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from gymnasium import spaces

from lilgym_mp.scene.actions import STOP, ActionType
from lilgym_mp.scene.appearances.base import action_arrays
from lilgym_mp.scene.arrays import AnyMapping, BoolArray
from lilgym_mp.scene.choices import choose
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.transformation import AnySpace, Batch, Batches, EnvDescription, EnvState, GymEnv, Transformation

MASK = "action_mask"  # the info's key


class MaskInfo(Transformation):
    """Adds "action_mask" to infos."""

    adds_infos = True

    def added_infos(self, info: AnyMapping, state: EnvState) -> Batches:
        return {MASK: state.action_masks().view(np.int8)}


class ActionMask(EnvWrapper[MaskInfo]):
    """Adds the exact mask of legal actions as info["action_mask"]: int8 (actions,), as `Discrete.sample` expects.

    Legality takes account of the environment's grid, placement search and snapping, and of wrapped wrappers that
    narrow the mask, such as StopForcing.

    Args:
        env: The environment to wrap.
    """

    transformation_class = MaskInfo


TRAINING_SPLIT = "train"
FORCED = "forced_stop"  # info key
FORCED_NOW = "forced"  # observation key


class Forcing(Transformation):
    """Masks all actions but STOP where STOP succeeds, replaces them by STOP, or says so in the observation."""

    def __init__(self, description: EnvDescription, *, mode: str, allow_evaluation: bool) -> None:
        """Raises ValueError for an unknown mode or an evaluation split."""
        super().__init__(description)
        choose("mode", mode, {name: name for name in ("mask", "replace", "observe")})
        self.adds_infos = mode == "mask"
        self.changes_actions = mode == "replace"
        self.changes_observations = self.uses_mdp_actions = mode == "observe"
        split = description.tasks.provenance.split
        if split != TRAINING_SPLIT and not allow_evaluation:
            raise ValueError(
                f"{description.wrapper} is for training: split {split!r} is for evaluation, where the agent must choose"
                f' STOP itself; choose split="{TRAINING_SPLIT}" or pass allow_evaluation=True'
            )
        if self.changes_actions:
            description.require_discrete_actions()

    def observation_space(self) -> AnySpace:
        if not self.changes_observations:
            return self.env_description.observation_space
        return spaces.Dict({**self.env_description.parts(), FORCED_NOW: spaces.Box(0, 1, (1,), np.int8)})

    def observations(self, observations: Batch, state: EnvState) -> Batch:
        if not self.changes_observations:
            return observations
        return {**observations, FORCED_NOW: state.goal_reached()[:, None].astype(np.int8)}

    def action_masks(self, state: EnvState) -> BoolArray:
        legal = state.action_masks()
        if self.adds_infos:
            success = state.goal_reached()
            legal[success] = False
            legal[success, self.env_description.stop_index] = True
        return legal

    def added_infos(self, info: AnyMapping, state: EnvState) -> Batches:
        return {MASK: self.action_masks(state).astype(np.int8)} if MASK in info else {}

    def actions(self, actions: Batch, state: EnvState) -> tuple[Batch, Mapping[str, BoolArray]]:
        forced = state.goal_reached() & (actions != self.env_description.stop_index)
        return np.where(forced, self.env_description.stop_index, actions), {FORCED: forced}


class StopForcing(EnvWrapper[Forcing]):
    """Makes the agent STOP in every state where STOP succeeds. For training only.

    Source: docs/spec.md, "Stop forcing" (PPO+SF).

    Args:
        env: The environment to wrap.
        mode: "mask" (the paper): `action_masks()`, and info["action_mask"] of a wrapped ActionMask, allow only STOP
            there. "replace" (the release): any action becomes STOP there; info["forced_stop"] is whether the last
            action was replaced. "observe", for learners such as PPO+SF that take STOP themselves, but with the
            log-probability that it has unforced: adds "forced" to observations, int8 (1,), 1 where STOP succeeds. The
            policy must not see it.
        allow_evaluation: Allow evaluation splits, although evaluation is without stop forcing.

    Raises:
        ValueError: For evaluation splits unless `allow_evaluation`, and for another `mode`.
    """

    transformation_class = Forcing

    def __init__(self, env: GymEnv, mode: str = "mask", *, allow_evaluation: bool = False) -> None:
        super().__init__(env, mode=mode, allow_evaluation=allow_evaluation)


# One mask entry per action index, or per value of each slot
NUMBERS = "numbers"
SLOTS = "slots"
MASKS = {form: form for form in (NUMBERS, SLOTS)}
MAX_KNOWN = 100_000  # decoded arrays that are kept


class ArrayDecoding(Transformation):
    """Decodes batches of action arrays to action indices."""

    changes_actions = True

    def __init__(self, description: EnvDescription, *, masks: str) -> None:
        super().__init__(description)
        description.require_discrete_actions()
        self._by_slots = choose("masks", masks, MASKS) == SLOTS
        self._appearance = appearance = description.dynamics.appearance
        unused = [0] * (len(appearance.to_array(STOP)) - 1)
        first_remove = appearance.encode(appearance.from_array([ActionType.REMOVE, *unused]))
        # The last ADD (docs/spec.md, "Actions"), which has the largest value of each slot
        _, *largest = appearance.to_array(appearance.decode(first_remove - 1))
        self._sizes = np.array([len(ActionType), *(1 + value for value in largest)])
        self._indices: dict[tuple[int, ...], int] = {}  # of arrays that have occurred

    def action_space(self) -> spaces.MultiDiscrete:
        return spaces.MultiDiscrete(self._sizes)

    def actions(self, actions: Batch, state: EnvState) -> tuple[Batch, Mapping[str, BoolArray]]:
        """Raises ActionError for an array of another shape or type, or a value out of range."""
        arrays = np.asarray(actions)
        if arrays.ndim != 2 or arrays.dtype.kind not in "iu":
            self._decoded(arrays[0])
        return np.array(list(map(self._index, map(tuple, arrays.tolist())))), {}

    def _index(self, array: tuple[int, ...]) -> int:
        index = self._indices.get(array)
        if index is None:
            if len(self._indices) == MAX_KNOWN:
                self._indices.clear()
            index = self._indices[array] = self._decoded(array)
        return index

    def _decoded(self, array: Sequence[int]) -> int:
        return self._appearance.encode(self._appearance.from_array(array))

    def action_masks(self, state: EnvState) -> BoolArray:
        legal = state.action_masks()
        if not self._by_slots:
            return legal
        values = action_arrays(self._appearance)
        flags = [
            np.stack([legal[:, values[:, slot] == value].any(axis=1) for value in range(size)], axis=1)
            for slot, size in enumerate(self._sizes)
        ]
        for slot in flags:
            slot[~slot.any(axis=1)] = True  # no legal action uses the slot, so its value is ignored
        return np.concatenate(flags, axis=1)


class MultiDiscreteActions(EnvWrapper[ArrayDecoding]):
    """Takes actions in the released array form, MultiDiscrete: [type, box, colour] for Tower, [type, x, y, shape,
    colour, size] for Scatter. Slots that an action type does not use may have any value, such as the release's -1.

    `step` raises ActionError for an array of the wrong shape or a value out of range.

    Args:
        env: The environment to wrap.
        masks: "numbers": `action_masks()` has one flag per action index, as without this wrapper. "slots", as
            MaskablePPO expects: (sum of slot sizes,), one flag per value of each slot, false if no legal action has it;
            combinations of such values may still be illegal.

    Raises:
        ValueError: For other `masks`.
    """

    transformation_class = ArrayDecoding

    def __init__(self, env: GymEnv, *, masks: str = NUMBERS) -> None:
        super().__init__(env, masks=masks)
