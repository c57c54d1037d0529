"""Many games at once equal as many single ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import data_equivalence

from lilgym_mp.actions import ActionError
from lilgym_mp.envs.proposer_verifier import AGENTS, PROTOCOLS, BatchedGames, TurnError, parallel_env

PROPOSER, VERIFIER = AGENTS
GAMES, STEPS, SEED = 3, 60, 11
VIEWS = {PROPOSER: {"history": 2}, VERIFIER: {"scene": "structured", "history": 1}}
SETTINGS: list[dict[str, Any]] = [
    *({"protocol": protocol, "views": VIEWS, "rewards": "hidden", "message_size": 1} for protocol in PROTOCOLS),
    {"protocol": "veto", "rules": "release", "start": "flipit", "reveal_truth": True},
    {"protocol": "joint", "appearance": "scatter", "start": "flipit", "homogeneous": True},
    {"protocol": "audit", "views": "text", "verdict_bins": 4, "rewards": "log"},
]


def row(observations: dict[str, Any], number: int) -> dict[str, Any]:
    """One game's observations out of a batch."""
    return {
        agent: {
            "observation": {key: array[number] for key, array in observation["observation"].items()},
            "action_mask": observation["action_mask"][number],
        }
        for agent, observation in observations.items()
    }


@pytest.mark.parametrize("copy", [True, False])
@pytest.mark.parametrize("settings", SETTINGS, ids=str)
def test_batch__equals_single_games(settings: dict[str, Any], copy: bool):
    batch = BatchedGames(GAMES, copy=copy, **settings)
    singles = [parallel_env(**settings) for _ in range(GAMES)]
    rng = np.random.default_rng(0)
    observations, infos = batch.reset(seed=SEED)
    expected = [single.reset(seed=SEED + number)[0] for number, single in enumerate(singles)]
    endings = 0
    for _ in range(STEPS):
        for number, single in enumerate(singles):
            assert data_equivalence(row(observations, number), expected[number])
            assert infos["turns"][number].tolist() == [role in single.session.state.movers for role in (0, 1)]
        actions = {agent: rng.integers(batch.single_action_spaces[agent].n, size=GAMES) for agent in AGENTS}
        observations, rewards, terminated, truncated, infos = batch.step(actions)
        for number, single in enumerate(singles):
            last, reward, ends, cuts, info = single.step({agent: actions[agent][number] for agent in AGENTS})
            assert {agent: rewards[agent][number] for agent in AGENTS} == reward
            assert (terminated[number], truncated[number]) == (ends[PROPOSER], cuts[PROPOSER])
            expected[number] = last
            if not single.agents:
                endings += 1
                assert data_equivalence(infos["final_observation"][number], last)
                assert infos["final_info"][number] == info
                expected[number], _ = single.reset()
    assert endings > 0


def test_copies__are_the_callers_own():
    batch = BatchedGames(2)
    first, _ = batch.reset(seed=0)
    kept = first[PROPOSER]["observation"]["image"].copy()
    batch.step({PROPOSER: np.array([1, 1]), VERIFIER: np.array([2, 2])})
    batch.step({PROPOSER: np.array([13, 13]), VERIFIER: np.array([1, 1])})
    assert np.array_equal(first[PROPOSER]["observation"]["image"], kept)
    assert first[PROPOSER]["observation"]["image"] is first[VERIFIER]["observation"]["image"]


def test_step__refuses_what_is_no_batch_of_actions():
    batch = BatchedGames(2)
    with pytest.raises(ResetNeeded):
        batch.step({PROPOSER: np.zeros(2, int), VERIFIER: np.zeros(2, int)})
    batch.reset(seed=0)
    with pytest.raises(TurnError, match="actions must be of proposer_0 and verifier_0, not of nobody"):
        batch.step({})
    with pytest.raises(ActionError, match="actions of verifier_0 must be 2 whole numbers, not float64"):
        batch.step({PROPOSER: np.zeros(2, int), VERIFIER: np.zeros(2)})
    with pytest.raises(ActionError, match="action 14 of proposer_0 is out of range"):
        batch.step({PROPOSER: np.array([0, 14]), VERIFIER: np.array([2, 2])})
