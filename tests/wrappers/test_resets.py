"""Shaped rewards and forced stops around wrappers that reset environments themselves."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import Autoreset
from gymnasium.wrappers import vector as vector_wrappers

from lilgym_mp.wrappers import PotentialShaping, StopForcing, potential_shaping_v0, stop_forcing_v0

TOWER = "lilgym_mp/TowerFlipIt-v0"
N = 4


class ResetAtOnce(gym.Wrapper[Any, Any, Any, Any]):
    """Resets in the step that ends an episode, as some wrappers of other libraries do."""

    def step(self, action: Any) -> Any:
        observation, reward, terminated, truncated, info = self.env.step(action)
        if terminated or truncated:
            observation, _ = self.env.reset()
        return observation, reward, terminated, truncated, info


@pytest.mark.parametrize("resetting", [Autoreset, ResetAtOnce])
def test_shaping__around_a_wrapper_that_resets_is_as_with_resets_by_hand(resetting: Any) -> None:
    by_hand, env = PotentialShaping(gym.make(TOWER)), PotentialShaping(resetting(gym.make(TOWER)))
    for each in (by_hand, env):
        each.reset(seed=2)
    was_over = False
    for action in np.random.default_rng(0).integers(13, size=60).tolist():
        _, reward, _, _, info = env.step(action)
        if was_over:
            by_hand.reset()
        if was_over and resetting is Autoreset:  # a step that only resets
            assert reward == 0
            assert "unshaped_reward" not in info
            was_over = False
        else:
            _, expected, terminated, truncated, _ = by_hand.step(action)
            assert reward == pytest.approx(expected)
            was_over = terminated or truncated


def test_forcing__forces_nothing_in_steps_that_only_reset() -> None:
    env = StopForcing(Autoreset(gym.make("lilgym_mp/TowerScratch-v0")), mode="replace")
    env.reset(seed=0)
    was_over = False
    for action in np.random.default_rng(0).integers(13, size=80).tolist():
        _, _, terminated, truncated, info = env.step(action)
        assert ("forced_stop" in info) == (not was_over)
        was_over = terminated or truncated


@pytest.mark.parametrize("wrap", [potential_shaping_v0, stop_forcing_v0], ids=["shaping", "forcing"])
@pytest.mark.parametrize("inner", [lambda envs: envs, vector_wrappers.RecordEpisodeStatistics])
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED])
def test_partial_resets__equal_those_of_the_batch_itself(wrap: Any, inner: Any, mode: AutoresetMode) -> None:
    """RecordEpisodeStatistics takes `reset_mask` out of the options it is given."""
    settings = {"mode": "replace"} if wrap is stop_forcing_v0 else {}
    outer = wrap(inner(gym.make_vec(TOWER, num_envs=N, autoreset_mode=mode)), **settings)
    plain = wrap(gym.make_vec(TOWER, num_envs=N, autoreset_mode=mode), **settings)
    assert [env.reset(seed=1)[1]["task"].tolist() for env in (outer, plain)].count(None) == 0
    generator = np.random.default_rng(3)
    ended = np.zeros(N, np.bool_)
    for _ in range(40):
        if ended.any():
            mask = ended.copy()
            if mode is AutoresetMode.NEXT_STEP:  # the others reset themselves
                mask[np.flatnonzero(ended)[1:]] = False
            for env in (outer, plain):
                env.reset(options={"reset_mask": mask.copy()})
        actions = generator.integers(13, size=N)
        (_, rewards, over, cut, infos), (_, expected, *_, expected_infos) = outer.step(actions), plain.step(actions)
        assert np.allclose(rewards, expected)
        key = "unshaped_reward" if wrap is potential_shaping_v0 else "forced_stop"
        assert np.array_equal(infos.get(f"_{key}", ()), expected_infos.get(f"_{key}", ()))
        if mode is AutoresetMode.NEXT_STEP and ended.sum() > 1:
            only_reset = np.flatnonzero(ended)[1:]
            assert not rewards[only_reset].any()
        ended = over | cut


def test_partial_resets__leave_potentials_of_other_environments_alone() -> None:
    class ResetsAtOnce(gym.vector.VectorWrapper):
        def step(self, actions: Any) -> Any:
            result = self.env.step(actions)
            if (ended := result[2] | result[3]).any():
                self.env.reset(options={"reset_mask": ended})
            return result

    disabled = gym.make_vec(TOWER, num_envs=N, autoreset_mode=AutoresetMode.DISABLED)
    outer = potential_shaping_v0(ResetsAtOnce(disabled))
    plain = potential_shaping_v0(gym.make_vec(TOWER, num_envs=N, autoreset_mode=AutoresetMode.SAME_STEP))
    for env in (outer, plain):
        env.reset(seed=1)
    generator = np.random.default_rng(3)
    for _ in range(40):
        actions = generator.integers(13, size=N)
        assert np.allclose(outer.step(actions)[1], plain.step(actions)[1])
