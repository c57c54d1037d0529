"""Wrapping a batch equals wrapping each of its environments."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from lilgym_mp import wrappers
from lilgym_mp.observation import EMPTY
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper, factory
from lilgym_mp.wrappers.transformation import EnvState, Transformation

N = 5
STEPS = 24

STACKS: dict[str, list[Callable[[Any], Any]]] = {
    "mask": [wrappers.action_mask_v0],
    "mask forcing": [wrappers.stop_forcing_v0, wrappers.action_mask_v0],
    "replacing": [partial(wrappers.stop_forcing_v0, mode="replace")],
    "tokens": [wrappers.tokenized_statement_v0],
    "structured": [wrappers.structured_observation_v0],
    "planes": [partial(wrappers.grid_planes_v0, keep_image=True)],
    "text": [wrappers.text_observation_v0],
    "embedding": [partial(wrappers.statement_embedding_v0, encoder=lambda text: [len(text), text.count("a")])],
    "native": [wrappers.native_image_v0, wrappers.channels_first_v0],
    "flat": [
        wrappers.steps_left_v0,
        wrappers.tokenized_statement_v0,
        wrappers.structured_observation_v0,
        wrappers.flat_observation_v0,
    ],
    "forced tokens": [
        partial(wrappers.stop_forcing_v0, mode="replace"),
        wrappers.tokenized_statement_v0,
        wrappers.grid_planes_v0,
        wrappers.action_mask_v0,
    ],
}


def stacked(env: Any, names: str) -> Any:
    for wrap in STACKS[names]:
        env = wrap(env)
    return env


def make_each(configuration: str, names: str, mode: AutoresetMode, **settings: Any) -> SyncVectorEnv:
    """Single environments, each wrapped."""
    return SyncVectorEnv([lambda: stacked(gym.make(configuration, **settings), names)] * N, autoreset_mode=mode)


def make_batch(configuration: str, names: str, mode: AutoresetMode, **settings: Any) -> Any:
    """A batched environment, wrapped as a whole."""
    return stacked(gym.make_vec(configuration, num_envs=N, autoreset_mode=mode, **settings), names)


def same(one: Any, other: Any) -> bool:
    """Whether two results are equal, including nested dicts, tuples and object arrays."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[name], other[name]) for name in one)
    if isinstance(one, tuple | list) or (isinstance(one, np.ndarray) and one.dtype == object):
        return len(one) == len(other) and all(map(same, one, other))
    return bool(np.array_equal(one, other))


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@pytest.mark.parametrize("configuration", ["TowerFlipIt", "ScatterScratch"])
@pytest.mark.parametrize("names", STACKS)
def test_batch__equals_wrapped_environments(corpus: Path, configuration: str, names: str, mode: AutoresetMode):
    make = partial(partial, configuration=f"lilgym_mp/{configuration}-v0", names=names, mode=mode, corpus=str(corpus))
    each, batch = make(make_each)(), make(make_batch)()
    assert batch.single_observation_space == each.single_observation_space
    assert batch.single_action_space == each.single_action_space
    generator = np.random.default_rng(0)
    outcomes = [env.reset(seed=7) for env in (each, batch)]
    assert same(*outcomes)
    for _ in range(STEPS):
        legal = batch.action_masks()
        actions = np.array([generator.choice(np.flatnonzero(mask)) for mask in legal])
        actions[generator.random(N) < 0.1] = 0
        outcomes = [env.step(actions) for env in (each, batch)]
        assert same(*outcomes)
    assert batch.observation_space.contains(outcomes[1][0])


class CountedItems(Transformation):
    """The number of items, by a Transformation that is not a Format."""

    changes_observations = True

    def observation_space(self) -> spaces.Space[Any]:
        return spaces.Box(0, 100, (1,), np.int64)

    def observations(self, observations: Any, state: EnvState) -> Any:
        return (state.items[..., -1] != EMPTY).sum(axis=(1, 2))[:, None]


class ItemCount(EnvWrapper[CountedItems]):
    transformation_class = CountedItems


def test_batch__final_obs_of_a_wrapper_uses_the_final_scene():
    make = partial(gym.make, "lilgym_mp/TowerScratch-v0", horizon=3)
    mode = AutoresetMode.SAME_STEP
    each = SyncVectorEnv([lambda: ItemCount(make())] * 3, autoreset_mode=mode)
    batch = factory(ItemCount)(gym.make_vec("lilgym_mp/TowerScratch-v0", num_envs=3, horizon=3, autoreset_mode=mode))
    for env in (each, batch):
        env.reset(seed=0)
        for action in (1, 2, 3):
            *_, infos = env.step(np.full(3, action))
        assert np.array_equal(np.stack(infos["final_obs"]), [[3], [3], [3]])
