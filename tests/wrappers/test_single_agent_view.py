"""SingleAgentView of a wrapped game: wrappers apply to the agent and the partner."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("pettingzoo", reason="pettingzoo is not installed: it comes with the extra `pettingzoo`")


from lilgym_mp.envs.proposer_verifier import (
    ALWAYS_ACCEPT,
    PartnerTurn,
    RandomPartner,
    SingleAgentView,
    env,
    parallel_env,
)
from lilgym_mp.wrappers import flat_observation_v0, grid_planes_v0, stop_forcing_v0

PROPOSER, VERIFIER = "proposer_0", "verifier_0"


@pytest.mark.parametrize("make", [env, parallel_env])
def test_flat_observation__applies_to_the_view(make: Any):
    view = SingleAgentView(flat_observation_v0(grid_planes_v0(make())), PROPOSER, ALWAYS_ACCEPT)
    observation, _ = view.reset(seed=0)
    assert isinstance(observation, np.ndarray)
    assert view.observation_space.contains(observation)
    observation, *_ = view.step(int(np.flatnonzero(view.action_masks())[1]))
    assert view.observation_space.contains(observation)


@pytest.mark.parametrize("make", [env, parallel_env])
def test_stop_forcing__allows_only_stop_at_the_goal(make: Any):
    view = SingleAgentView(stop_forcing_v0(make(reveal_truth=True)), PROPOSER, ALWAYS_ACCEPT)
    generator = np.random.default_rng(0)
    forced = 0
    for seed in range(30):
        _, info = view.reset(seed=seed)
        ended = False
        while not ended:
            mask = view.action_masks()
            if info["goal_reached"]:
                forced += 1
                assert np.flatnonzero(mask).tolist() == [0]
            _, _, terminated, truncated, info = view.step(int(generator.choice(np.flatnonzero(mask))))
            ended = terminated or truncated
    assert forced > 3


def test_wrappers__apply_to_the_partner():
    """At the goal, the partner playing the proposer may only STOP."""
    game = stop_forcing_v0(env(protocol="audit", reveal_truth=True))
    met: list[bool] = []

    def proposer(turn: PartnerTurn) -> int:
        if game.unwrapped.dynamics.goal_reached(turn.state.mdp):
            met.append(np.flatnonzero(turn.action_mask).tolist() == [0] == np.flatnonzero(turn["action_mask"]).tolist())
        return RandomPartner()(turn)

    view = SingleAgentView(game, VERIFIER, proposer)
    for seed in range(30):
        view.reset(seed=seed)
        for _ in range(12):
            _, _, terminated, truncated, _ = view.step(int(np.flatnonzero(view.action_masks())[0]))
            if terminated or truncated:
                break
    assert met
    assert all(met)


def test_array_observations__are_refused():
    with pytest.raises(TypeError, match='SingleAgentView needs the game with observations="nested"'):
        SingleAgentView(parallel_env(observations="vector"), PROPOSER, ALWAYS_ACCEPT)
