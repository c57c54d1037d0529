"""What every snippet of this folder trains on and ends with: flat observations, and an evaluation on the dev tasks."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import VectorEnv
from gymnasium.wrappers import vector

from lilgym_mp import action_masks
from lilgym_mp.evaluation import Settings, evaluate_wrapped
from lilgym_mp.wrappers import flat_observation_v0, structured_observation_v0

SETTINGS = Settings("TowerScratch")
ID = SETTINGS.id
ACTIONS = 13


def flat(env: Any) -> Any:
    """Vectors of items, token ids and target, of an environment or a batch with observation="arrays"."""
    return flat_observation_v0(structured_observation_v0(env))


def flat_and_mask(env: Any) -> Any:
    """The same with the legal actions as last elements, for libraries whose networks see nothing but observations."""
    env = flat(env)
    batched = isinstance(env, VectorEnv)
    space: Any = env.single_observation_space if batched else env.observation_space
    low = np.append(space.low, np.zeros(ACTIONS, np.float32))
    high = np.append(space.high, np.ones(ACTIONS, np.float32))
    wider = Box(low, high)

    def add(seen: np.ndarray) -> np.ndarray:
        return np.concatenate([seen, action_masks(env)], -1, dtype=np.float32)

    if batched:
        return vector.TransformObservation(env, add, single_observation_space=wider)
    return gym.wrappers.TransformObservation(env, add, wider)


def arguments(kinds: Iterable[str], *more: str) -> argparse.Namespace:
    """The command line: the kind of environment, the steps, and switches such as "--masks"."""
    parser = argparse.ArgumentParser()
    parser.add_argument("kind", choices=list(kinds))
    parser.add_argument("--steps", type=int, default=256)
    for switch in more:
        parser.add_argument(switch, action="store_true")
    return parser.parse_args()


def finish(kind: str, trained: Callable[..., Any], loaded: Callable[..., Any], wrap: Callable[[Any], Any]) -> None:
    """Evaluates the trained policy on each dev task once, and the loaded one, which must play the same."""
    result, again = (
        evaluate_wrapped(choose, SETTINGS, wrap=wrap, observation="arrays") for choose in (trained, loaded)
    )
    assert result.episodes == again.episodes
    print(f"{kind}: {result.summary.accuracy:.1%} of {len(result.episodes)} dev tasks, saved and loaded")
