"""Rollouts of the game: own turns, advantages, claims and situations."""

import numpy as np
import pytest

from lilgym_mp.envs.observation import item_array
from lilgym_mp.envs.proposer_verifier import Game, GameSettings, Role
from lilgym_mp.envs.proposer_verifier.observations import ObservedGames
from lilgym_mp.envs.proposer_verifier.protocols import NO_CHOICE
from lilgym_mp.envs.proposer_verifier.rewards import Intent
from lilgym_mp.learning.game.rollout import Rollout, own_turn_advantages, without_refused
from lilgym_mp.learning.game.situations import (
    EDIT_PENDING,
    INTENT,
    PENDING,
    REFUSED,
    STOP_PENDING,
    read_situations,
)

GAMMA, LAMBDA = 0.9, 0.8


def game(acted, values, rewards, ended):
    """A rollout of one game with the proposer's turns."""
    found = Rollout(Game(GameSettings()), (), len(acted), 1)
    found.acted[0, :, 0], found.values[0, :, 0], found.rewards[0, :, 0] = acted, values, rewards
    found.ended[:, 0] = ended
    return found


def test_own_turns__earn_the_rewards_up_to_the_next_own_turn_or_the_end():
    # veto: the proposer moves in turns 0, 2, 4, the verifier answers in 1, 3, 5, which ends the game
    both = game([1, 0, 1, 0, 1, 0], [0.5, 9, 0.4, 9, 0.3, 9], [0, -0.1, 0, -0.1, 0, 1], [0, 0, 0, 0, 0, 1])
    both.acted[1], both.rewards[1] = ~both.acted[0], both.rewards[0]
    both.values[1, :, 0], both.last_values[0] = [9, 0.2, 9, 0.1, 9, 0.6], 7
    (proposer, verifier), complete = own_turn_advantages(both, GAMMA, LAMBDA)
    last = 1 - 0.3
    middle = -0.1 + GAMMA * 0.3 - 0.4 + GAMMA * LAMBDA * last
    first = -0.1 + GAMMA * 0.4 - 0.5 + GAMMA * LAMBDA * middle
    assert proposer[:, 0].tolist() == pytest.approx([first, 0, middle, 0, last, 0])
    assert np.array_equal(complete, both.acted)
    assert verifier[5, 0] == pytest.approx(1 - 0.6)
    assert verifier[3, 0] == pytest.approx(-0.1 + GAMMA * 0.6 - 0.1 + GAMMA * LAMBDA * (1 - 0.6))


def test_own_turns__without_a_known_successor_are_incomplete_but_lend_their_value():
    own = game([1, 0, 1], [0.5, 0, 0.4], [0, -0.1, 0], [0, 0, 0])
    own.last_values[0] = 0.8
    found, complete = own_turn_advantages(own, GAMMA, LAMBDA)
    assert complete[0, :, 0].tolist() == [True, False, False]
    assert found[0, 0, 0] == pytest.approx(-0.1 + GAMMA * 0.4 - 0.5)
    own.to_move[0] = True  # it is to move again
    found, complete = own_turn_advantages(own, GAMMA, LAMBDA)
    assert complete[0, 2, 0]
    assert found[0, 2, 0] == pytest.approx(GAMMA * 0.8 - 0.4)


def test_own_turns__do_not_earn_rewards_of_the_next_game():
    own = game([1, 0, 1], [0.5, 0, 0.2], [-1, 3, 1], [1, 0, 1])  # the game of turn 1 pays 3 before its own turn
    found, _ = own_turn_advantages(own, GAMMA, LAMBDA)
    assert found[0, :, 0].tolist() == pytest.approx([-1.5, 0, 0.8])


def test_situations__show_each_agent_what_it_may_know():
    game = Game(GameSettings(protocol="critique", rewards="hidden"))
    games = ObservedGames(game, 2)
    games.start(np.arange(2), np.array([0, 1]), np.array([Intent.DECEPTIVE, Intent.HELPFUL]))
    rows = np.arange(2)
    _, context = read_situations(games, Role.PROPOSER, rows)
    assert context[:, INTENT].tolist() == [2, 1]
    stop, add = 0, 1
    games.step(np.array([stop, add]), np.zeros(2, np.int64))
    items, context = read_situations(games, Role.VERIFIER, rows)
    assert context[:, PENDING].tolist() == [STOP_PENDING, EDIT_PENDING]
    assert not context[:, INTENT].any()
    capacity = items.shape[2]
    edited = game.dynamics.step(games.mdp(1), game.dynamics.appearance.decode(add)).state
    assert np.array_equal(items[0], item_array(games.mdp(0).scene, capacity))
    assert np.array_equal(items[1], item_array(edited.scene, capacity))
    games.step(np.zeros(2, np.int64), np.zeros(2, np.int64))  # both proposals are rejected
    assert read_situations(games, Role.PROPOSER, rows)[1][:, REFUSED].tolist() == [1 + stop, 1 + add]


def test_without_refused__leaves_out_the_action_refused_last_unless_it_is_the_only_one():
    legal = np.array([[True, True, False], [True, False, False], [True, True, True]])
    found = without_refused(legal, np.array([0, 0, NO_CHOICE]))
    assert found.tolist() == [[False, True, False], [True, False, False], [True, True, True]]
