"""SingleAgentView of a wrapped game: wrappers apply to the agent and the partner."""

import numpy as np
import pytest

pytest.importorskip("pettingzoo")


from lilgym_mp.envs.proposer_verifier import (
    ALWAYS_ACCEPT,
    SingleAgentView,
    env,
    parallel_env,
)
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.wrappers import flat_observation_v0, grid_planes_v0, stop_forcing_v0

PROPOSER, VERIFIER = "proposer_0", "verifier_0"


@pytest.mark.parametrize("make", [env, parallel_env])
def test_flat_observation__applies_to_the_view(make):
    view = SingleAgentView(flat_observation_v0(grid_planes_v0(make())), PROPOSER, ALWAYS_ACCEPT)
    observation, _ = view.reset(seed=0)
    assert isinstance(observation, np.ndarray)
    assert view.observation_space.contains(observation)
    observation, *_ = view.step(int(np.flatnonzero(view.action_masks())[1]))
    assert view.observation_space.contains(observation)


ADD_LEFT_BLUE = 3
EASY = Task("easy", "A block is blue.", "exist(filter_color(all_items, Color.BLUE))", True, Scene.empty())


@pytest.mark.parametrize("make", [env, parallel_env])
def test_stop_forcing__allows_only_stop_at_the_goal(make):
    view = SingleAgentView(stop_forcing_v0(make(reveal_truth=True)), PROPOSER, ALWAYS_ACCEPT)
    view.reset(options={"task": EASY})
    assert view.action_masks().sum() > 1
    *_, info = view.step(ADD_LEFT_BLUE)
    assert info["goal_reached"]
    assert np.flatnonzero(view.action_masks()).tolist() == [0]


def test_wrappers__apply_to_the_partner():
    """At the goal, the partner playing the proposer may only STOP."""
    game = stop_forcing_v0(env(protocol="audit"))
    allowed = []

    def proposer(turn):
        allowed.extend(np.flatnonzero(mask).tolist() for mask in (turn.action_mask, turn["action_mask"]))
        return ADD_LEFT_BLUE if len(allowed) == 2 else 0

    SingleAgentView(game, VERIFIER, proposer).reset(options={"task": EASY})
    assert len(allowed[0]) == len(allowed[1]) > 1
    assert allowed[2:] == [[0], [0]]


def test_array_observations__are_refused():
    with pytest.raises(TypeError, match='SingleAgentView needs the game with observations="nested"'):
        SingleAgentView(parallel_env(observations="vector"), PROPOSER, ALWAYS_ACCEPT)
