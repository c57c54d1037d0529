"""Rollouts of the game: own turns, advantages, claims and situations."""

from __future__ import annotations

import numpy as np
import pytest

from lilgym_mp.envs.observation import item_array
from lilgym_mp.envs.proposer_verifier import Game, GameSettings, Role
from lilgym_mp.envs.proposer_verifier.observations import ObservedGames
from lilgym_mp.envs.proposer_verifier.protocols import NO_CHOICE
from lilgym_mp.envs.proposer_verifier.rewards import Intent
from lilgym_mp.learning.game.rollout import Turns, own_turn_advantages, without_refused
from lilgym_mp.learning.game.situations import (
    EDIT_PENDING,
    INTENT,
    PENDING,
    REFUSED,
    STOP_PENDING,
    read_situations,
)

GAMMA, LAMBDA = 0.9, 0.8


def turns(acted: list[int], values: list[float], rewards: list[float]) -> Turns:
    """The proposer's turns in one game."""
    found = Turns(len(acted), 1, 0)
    found.acted[0, :, 0], found.values[0, :, 0], found.rewards[0, :, 0] = acted, values, rewards
    return found


def advantages(
    own: Turns, ended: list[int], last_values: tuple[float, float] = (0.0, 0.0), *, to_move: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """(2, T) advantages of one game's turns, and where they are complete; `to_move`: the proposer at the end."""
    found, complete = own_turn_advantages(
        own,
        np.array(ended, np.bool_)[:, None],
        np.array(last_values, np.float32)[:, None],
        np.array([[to_move], [False]]),
        GAMMA,
        LAMBDA,
    )
    return found[..., 0], complete[..., 0]


def test_own_turns__earn_the_rewards_up_to_the_next_own_turn_or_the_end():
    # veto: the proposer moves in turns 0, 2, 4, the verifier answers in 1, 3, 5, which ends the game
    both = turns([1, 0, 1, 0, 1, 0], [0.5, 9, 0.4, 9, 0.3, 9], [0, -0.1, 0, -0.1, 0, 1])
    both.acted[1], both.rewards[1] = ~both.acted[0], both.rewards[0]
    both.values[1, :, 0] = [9, 0.2, 9, 0.1, 9, 0.6]
    (proposer, verifier), complete = advantages(both, [0, 0, 0, 0, 0, 1], (7.0, 0.0))
    last = 1 - 0.3
    middle = -0.1 + GAMMA * 0.3 - 0.4 + GAMMA * LAMBDA * last
    first = -0.1 + GAMMA * 0.4 - 0.5 + GAMMA * LAMBDA * middle
    assert proposer.tolist() == pytest.approx([first, 0, middle, 0, last, 0])
    assert complete.tolist() == both.acted[..., 0].tolist()
    assert verifier[5] == pytest.approx(1 - 0.6)
    assert verifier[3] == pytest.approx(-0.1 + GAMMA * 0.6 - 0.1 + GAMMA * LAMBDA * (1 - 0.6))


def test_own_turns__without_a_known_successor_are_incomplete_but_lend_their_value():
    own = turns([1, 0, 1], [0.5, 0, 0.4], [0, -0.1, 0])
    (found, _), (complete, _) = advantages(own, [0, 0, 0], (0.8, 0.0))
    assert complete.tolist() == [True, False, False]
    assert found[0] == pytest.approx(-0.1 + GAMMA * 0.4 - 0.5)
    (found, _), (complete, _) = advantages(own, [0, 0, 0], (0.8, 0.0), to_move=True)
    assert complete[2]
    assert found[2] == pytest.approx(GAMMA * 0.8 - 0.4)


def test_own_turns__do_not_earn_rewards_of_the_next_game():
    own = turns([1, 0, 1], [0.5, 0, 0.2], [-1, 3, 1])  # the game that begins in turn 1 pays 3 before its own turn
    (found, _), _ = advantages(own, [1, 0, 1])
    assert found.tolist() == pytest.approx([-1.5, 0, 0.8])


def test_situations__show_each_agent_what_it_may_know():
    settings = GameSettings(protocol="critique", rewards="hidden")
    game = Game(settings)
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
    edited = game.config.dynamics.step(games.mdp(1), game.config.dynamics.appearance.decode(add)).state
    assert np.array_equal(items[0], item_array(games.mdp(0).scene, capacity))
    assert np.array_equal(items[1], item_array(edited.scene, capacity))
    games.step(np.zeros(2, np.int64), np.zeros(2, np.int64))  # both proposals are rejected
    assert read_situations(games, Role.PROPOSER, rows)[1][:, REFUSED].tolist() == [1 + stop, 1 + add]


def test_without_refused__leaves_out_the_action_refused_last_unless_it_is_the_only_one():
    legal = np.array([[True, True, False], [True, False, False], [True, True, True]])
    found = without_refused(legal, np.array([0, 0, NO_CHOICE]))
    assert found.tolist() == [[False, True, False], [True, False, False], [True, True, True]]
