"""Shaped rewards and forced stops around wrappers that reset environments themselves."""

from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import Autoreset

from lilgym_mp.testing import check_vector_env
from lilgym_mp.wrappers import PotentialShaping, StopForcing, potential_shaping_v0, stop_forcing_v0

TOWER = "lilgym_mp/TowerFlipIt-v0"
N = 4


class ResetAtOnce(gym.Wrapper):
    """Resets in the step that ends an episode, as some wrappers of other libraries do."""

    def step(self, action):
        observation, reward, terminated, truncated, info = self.env.step(action)
        if terminated or truncated:
            observation, _ = self.env.reset()
        return observation, reward, terminated, truncated, info


@pytest.mark.parametrize("resetting", [Autoreset, ResetAtOnce])
def test_shaping__around_a_wrapper_that_resets_is_as_with_resets_by_hand(resetting):
    by_hand, env = PotentialShaping(gym.make(TOWER)), PotentialShaping(resetting(gym.make(TOWER)))
    for each in (by_hand, env):
        each.reset(seed=2)
    for action in np.random.default_rng(0).integers(13, size=40).tolist():
        _, expected, terminated, truncated, _ = by_hand.step(action)
        assert env.step(action)[1] == pytest.approx(expected)
        if terminated or truncated:
            by_hand.reset()
            if resetting is Autoreset:  # which resets in a step of its own
                _, reward, _, _, info = env.step(action)
                assert (reward, "unshaped_reward" in info) == (0, False)


def test_forcing__forces_nothing_in_steps_that_only_reset():
    env = StopForcing(Autoreset(gym.make("lilgym_mp/TowerScratch-v0")), mode="replace")
    env.reset(seed=0)
    was_over = False
    for action in np.random.default_rng(0).integers(13, size=80).tolist():
        _, _, terminated, truncated, info = env.step(action)
        assert ("forced_stop" in info) == (not was_over)
        was_over = terminated or truncated


class TakesTheMask(gym.vector.VectorWrapper):
    """Takes `reset_mask` out of the options it is given, as RecordEpisodeStatistics does."""

    def reset(self, *, seed=None, options=None):
        started = self.env.reset(seed=seed, options=options)
        (options or {}).pop("reset_mask", None)
        return started


@pytest.mark.parametrize(
    "wrap", [potential_shaping_v0, partial(stop_forcing_v0, mode="replace")], ids=["shaping", "forcing"]
)
def test_partial_resets__equal_those_of_single_environments(wrap):
    make = lambda **settings: wrap(TakesTheMask(gym.make_vec(TOWER, **settings)))  # noqa: E731
    modes = [AutoresetMode.DISABLED, AutoresetMode.NEXT_STEP]
    check_vector_env(make, lambda: wrap(gym.make(TOWER)), num_envs=N, modes=modes, exact_masks=False, steps=15)


class ResetsAtOnce(gym.vector.VectorWrapper):
    """Resets environments in the step that ends their episodes."""

    def step(self, actions):
        result = self.env.step(actions)
        if (ended := result[2] | result[3]).any():
            self.env.reset(options={"reset_mask": ended})
        return result


def test_partial_resets__leave_potentials_of_other_environments_alone():
    disabled = gym.make_vec(TOWER, num_envs=N, autoreset_mode=AutoresetMode.DISABLED)
    outer = potential_shaping_v0(ResetsAtOnce(disabled))
    plain = potential_shaping_v0(gym.make_vec(TOWER, num_envs=N, autoreset_mode=AutoresetMode.SAME_STEP))
    for env in (outer, plain):
        env.reset(seed=1)
    generator = np.random.default_rng(3)
    for _ in range(40):
        actions = generator.integers(13, size=N)
        assert np.allclose(outer.step(actions)[1], plain.step(actions)[1])
