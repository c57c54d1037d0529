"""Whether two vector environments do the same, to the bit."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv

STOP_SHARE, WILD_SHARE = 0.1, 0.05  # of random actions: STOP, and any at all; the others are legal


def assert_same(ours: Any, theirs: Any, where: str = "") -> None:
    """Equal in type, shape, dtype, keys and every value."""
    if isinstance(theirs, dict):
        assert isinstance(ours, dict), where
        assert ours.keys() == theirs.keys(), where
        for key in theirs:
            assert_same(ours[key], theirs[key], f"{where}/{key}")
    elif isinstance(theirs, tuple | list):
        assert type(ours) is type(theirs), where
        assert len(ours) == len(theirs), where
        for number, (one, other) in enumerate(zip(ours, theirs, strict=True)):
            assert_same(one, other, f"{where}({number})")
    elif isinstance(theirs, np.ndarray):
        assert isinstance(ours, np.ndarray), where
        assert (ours.dtype, ours.shape) == (theirs.dtype, theirs.shape), where
        if theirs.dtype == object:
            for number, (one, other) in enumerate(zip(ours, theirs, strict=True)):
                assert_same(one, other, f"{where}[{number}]")
        else:
            assert np.array_equal(ours, theirs), where
    else:
        assert type(ours) is type(theirs), where
        assert ours == theirs, where


def equal(one: Any, other: Any) -> bool:
    """Whether two observations, or whatever holds such, are the same in every part."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(equal(one[key], other[key]) for key in one)
    if isinstance(one, tuple | list):
        return len(one) == len(other) and all(map(equal, one, other))
    return np.array_equal(one, other) if isinstance(one, np.ndarray) else one == other


def random_actions(masks: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """(N,) mostly legal actions for masks (N, actions)."""
    actions: list[int] = []
    for mask in masks:
        chance = generator.random()
        if chance < STOP_SHARE:
            actions.append(0)
        elif chance < STOP_SHARE + WILD_SHARE:
            actions.append(int(generator.integers(len(mask))))
        else:
            actions.append(int(generator.choice(np.flatnonzero(mask))))
    return np.array(actions)


def assert_alike(ours: Any, theirs: Any, *, steps: int, seed: int = 5) -> None:
    """Plays both with the same actions and compares all that they tell. Closes them.

    `theirs` may be Gymnasium's SyncVectorEnv around single environments.
    """
    try:
        assert ours.observation_space == theirs.observation_space
        assert ours.action_space == theirs.action_space
        assert_same(ours.reset(seed=seed), theirs.reset(seed=seed), "reset")
        generator = np.random.default_rng(seed)
        for step in range(steps):
            masks = ours.action_masks()
            assert_same(masks, _each(theirs, "action_masks"), f"step {step}: masks")
            assert_same(ours.goal_reached(), _each(theirs, "goal_reached"), f"step {step}: goals")
            if not isinstance(theirs, SyncVectorEnv):
                assert ours.states() == theirs.states()
                assert_same(ours.scene_array(), theirs.scene_array(), f"step {step}: items")
                assert_same(ours.task_indices, theirs.task_indices, f"step {step}: tasks")
            actions = random_actions(masks, generator)
            expected = theirs.step(actions)
            assert_same(ours.step(actions), expected, f"step {step}")
            ended = expected[2] | expected[3]
            if theirs.metadata["autoreset_mode"] is AutoresetMode.DISABLED and ended.any():
                actual = ours.reset(options={"reset_mask": ended.copy()})
                assert_same(actual, theirs.reset(options={"reset_mask": ended.copy()}), f"step {step}: reset")
    finally:
        ours.close()
        theirs.close()


def _each(env: VectorEnv[Any, Any, Any], method: str) -> np.ndarray:
    if isinstance(env, SyncVectorEnv):
        return np.stack([getattr(single.unwrapped, method)() for single in env.envs])
    return getattr(env, method)()
