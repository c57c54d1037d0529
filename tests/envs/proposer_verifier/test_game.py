"""The rules of each protocol, and the rewards."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from hypothesis import given
from hypothesis import strategies as st

from lilgym_mp.envs.proposer_verifier import PROTOCOLS, Intent, Role, TurnError
from lilgym_mp.envs.proposer_verifier.engine import GameEngine
from lilgym_mp.envs.proposer_verifier.protocols import PROPOSER, VERIFIER
from lilgym_mp.envs.rules import Outcome
from lilgym_mp.scene.actions import ActionError
from tests.envs.proposer_verifier.games import (
    ACCEPT,
    ADD_BLACK,
    ADD_BLUE,
    CONTINUE,
    REJECT,
    REMOVE_FROM_EMPTY,
    STOP_NOW,
    STOPS,
    VERIFIER_STOPS,
    WAIT,
    OneGame,
    all_steps,
    final_step,
    game,
    setup,
)


def items(step: Any) -> int:
    return sum(1 for _ in step.state.mdp.scene.items())


def test_veto__a_proposal_has_no_effect_until_answered():
    step = final_step(game(), ADD_BLUE)
    assert step.outcome is None
    assert step.rewards == (0.0, 0.0)
    assert (step.state.movers, step.state.proposal, step.state.mdp.steps) == ((VERIFIER,), ADD_BLUE, 0)


def test_veto__an_accepted_edit_is_a_step_of_the_mdp():
    step = final_step(game(), ADD_BLUE, ACCEPT)
    assert (step.outcome, step.rewards, items(step)) == (Outcome.CONTINUES, (-0.1, -0.1), 1)
    assert (step.state.movers, step.state.proposal, step.state.mdp.steps) == ((PROPOSER,), None, 1)


def test_veto__a_rejection_keeps_the_scene_and_uses_up_a_step():
    step = final_step(game(), ADD_BLUE, REJECT)
    assert (step.outcome, step.rewards, items(step)) == (Outcome.CONTINUES, (-0.1, -0.1), 0)
    assert step.state.mdp.steps == 1


def test_veto__an_accepted_stop_ends_the_episode_as_the_mdp_does():
    right = final_step(game(), ADD_BLUE, ACCEPT, STOPS, ACCEPT)
    wrong = final_step(game(), ADD_BLACK, ACCEPT, STOPS, ACCEPT)
    assert (right.outcome, right.rewards, right.terminated) == (Outcome.SUCCESS, (1.0, 1.0), True)
    assert (wrong.outcome, wrong.rewards, wrong.terminated) == (Outcome.WRONG_STOP, (-1.0, -1.0), True)
    assert right.state.movers == ()


def test_veto__a_rejected_stop_does_not_end_the_episode():
    step = final_step(game(), STOPS, REJECT)
    assert (step.outcome, step.terminated, step.state.movers) == (Outcome.CONTINUES, False, (PROPOSER,))


def test_veto__an_accepted_invalid_action_ends_the_episode_a_rejected_one_does_not():
    assert final_step(game(), REMOVE_FROM_EMPTY, ACCEPT).outcome is Outcome.INVALID_ACTION
    assert final_step(game(), REMOVE_FROM_EMPTY, REJECT).outcome is Outcome.CONTINUES


@pytest.mark.parametrize("answer", [ACCEPT, REJECT])
def test_veto__the_horizon_counts_rounds(answer: int):
    step = final_step(game(horizon=2), ADD_BLUE, REJECT, ADD_BLUE, answer)
    assert (step.outcome, step.terminated, step.rewards) == (Outcome.HORIZON, True, (-1.0, -1.0))


def test_veto__under_the_release_rules_the_horizon_truncates():
    step = final_step(game(horizon=1, rules="release"), ADD_BLUE, REJECT)
    assert (step.terminated, step.truncated, step.rewards) == (False, True, (-0.1, -0.1))


@pytest.mark.parametrize("ending", ["proposer", "either"])
def test_ending__by_the_proposer_its_stop_needs_no_answer(ending: str):
    assert final_step(game(ending=ending), STOPS).outcome is Outcome.WRONG_STOP


@pytest.mark.parametrize("ending", ["verifier", "either"])
def test_ending__by_the_verifier_its_stop_is_judged_on_the_scene_before_the_proposal(ending: str):
    step = final_step(game(ending=ending), ADD_BLUE, VERIFIER_STOPS)
    assert (step.outcome, items(step)) == (Outcome.WRONG_STOP, 0)
    assert step.judgement is not None
    assert (step.judgement.accepted, step.judgement.holds) == (True, False)


@pytest.mark.parametrize("protocol", ["veto", "critique"])
def test_ending__determines_whether_the_verifier_can_choose_stop(protocol: str):
    assert game(protocol=protocol, message_size=0).action_counts[Role.VERIFIER] == 3
    assert game(protocol=protocol, message_size=0, ending="verifier").action_counts[Role.VERIFIER] == 4


@pytest.mark.parametrize("protocol", ["veto", "joint"])
def test_ending__by_the_verifier_alone_the_proposer_cannot_stop(protocol: str):
    this = game(protocol=protocol, ending="verifier")
    played = OneGame(this)
    assert not played.games.masks(Role.PROPOSER, 0)[STOPS]
    step = played.step(STOPS, *([CONTINUE] if protocol == "joint" else []))
    assert (step.illegal[Role.PROPOSER], step.outcome, items(step)) == (True, Outcome.CONTINUES, 0)


def test_joint__the_edit_is_made_while_the_verifier_continues():
    step = final_step(game(protocol="joint"), (ADD_BLUE, CONTINUE))
    assert (step.outcome, items(step), step.state.movers) == (Outcome.CONTINUES, 1, (PROPOSER, VERIFIER))


def test_joint__a_stop_is_judged_on_the_scene_before_the_edit():
    assert final_step(game(protocol="joint"), (ADD_BLUE, STOP_NOW)).outcome is Outcome.WRONG_STOP
    step = final_step(game(protocol="joint"), (ADD_BLUE, CONTINUE), (ADD_BLACK, STOP_NOW))
    assert (step.outcome, items(step)) == (Outcome.SUCCESS, 1)


def test_joint__by_agreement_only_both_stops_together_end_the_episode():
    this = game(protocol="joint", ending="agreement")
    assert final_step(this, (STOPS, CONTINUE)).outcome is Outcome.CONTINUES
    step = final_step(this, (ADD_BLUE, STOP_NOW))
    assert (step.outcome, items(step)) == (Outcome.CONTINUES, 1)
    assert final_step(this, (STOPS, STOP_NOW)).outcome is Outcome.WRONG_STOP


def test_joint__by_either_each_stop_ends_the_episode():
    this = game(protocol="joint", ending="either")
    assert final_step(this, (STOPS, CONTINUE)).outcome is Outcome.WRONG_STOP
    assert final_step(this, (ADD_BLUE, STOP_NOW)).outcome is Outcome.WRONG_STOP


def test_audit__the_proposer_moves_until_it_stops():
    steps = all_steps(game(protocol="audit"), ADD_BLACK, ADD_BLUE, STOPS)
    assert [step.state.movers for step in steps] == [(PROPOSER,), (PROPOSER,), (VERIFIER,)]
    assert [step.outcome for step in steps] == [Outcome.CONTINUES, Outcome.CONTINUES, None]


@pytest.mark.parametrize("verdict", [0, 1])
def test_audit__the_verdict_ends_the_episode_whatever_it_is(verdict: int):
    step = final_step(game(protocol="audit"), ADD_BLUE, STOPS, verdict)
    assert (step.outcome, step.judgement.probability, step.judgement.holds) == (Outcome.SUCCESS, float(verdict), True)


def test_audit__without_a_stop_there_is_no_verdict():
    step = final_step(game(protocol="audit", horizon=1), ADD_BLUE)
    assert (step.outcome, step.judgement, step.state.movers) == (Outcome.HORIZON, None, ())


@pytest.mark.parametrize(("bins", "expected"), [(2, [0.25, 0.75]), (4, [0.125, 0.375, 0.625, 0.875])])
def test_audit__bins_state_their_midpoints(bins: int, expected: list[float]):
    this = game(protocol="audit", verdict_bins=bins)
    stated = [final_step(this, STOPS, verdict).judgement.probability for verdict in range(bins)]
    assert stated == pytest.approx(expected)


def test_critique__a_rejection_is_free_and_the_proposer_moves_again():
    step = final_step(game(protocol="critique"), ADD_BLUE, REJECT)
    assert (step.outcome, step.rewards) == (None, (0.0, 0.0))
    assert (step.state.movers, step.state.rejections, step.state.mdp.steps) == ((PROPOSER,), 1, 0)


def test_critique__after_the_last_exchange_the_next_proposal_needs_no_answer():
    this = game(protocol="critique", exchanges=1)
    step = final_step(this, ADD_BLACK, REJECT, ADD_BLUE)
    assert (step.outcome, items(step), step.state.movers) == (Outcome.CONTINUES, 1, (PROPOSER,))
    assert step.state.rejections == 0


def test_critique__a_rejection_can_carry_a_message():
    this = game(protocol="critique")
    step = final_step(this, ADD_BLUE, this.encode_action(Role.VERIFIER, REJECT, message=3))
    assert step.state.messages == (0, 3)


def test_message__costs_its_sender():
    this = game(message_size=2, message_cost=0.25)
    steps = all_steps(
        this,
        this.encode_action(Role.PROPOSER, ADD_BLUE, message=2),
        this.encode_action(Role.VERIFIER, ACCEPT),
        ADD_BLACK * 3,
    )
    assert steps[0].rewards == (-0.25, 0.0)
    assert steps[1].rewards == (-0.1, -0.1)
    assert steps[1].state.messages == (2, 0)


ILLEGAL = [
    ("veto", (WAIT,), "the round is spent"),
    ("veto", (ADD_BLUE, 2), "the proposal is rejected"),
    ("audit", (STOPS, 2), "nothing is believed"),
    ("joint", ((STOPS, CONTINUE),), "no edit is made"),
]


@pytest.mark.parametrize(("protocol", "actions", "meaning"), ILLEGAL, ids=[meaning for *_, meaning in ILLEGAL])
def test_illegal_choice__counts_as_no_choice(protocol: str, actions: Any, meaning: str):
    step = final_step(game(protocol=protocol), *actions)
    assert any(step.illegal)
    assert items(step) == 0
    assert step.judgement is None or step.judgement.probability == 0.0
    assert step.state.mdp.steps == 1


REWARDED: list[tuple[str, dict[str, Any], tuple[int, ...], Intent, tuple[float, float]]] = [
    # rewards, settings, actions in an audit, intent, expected
    ("common", {}, (ADD_BLUE, STOPS, 1), Intent.HELPFUL, (1.0, 1.0)),
    ("common", {}, (STOPS, 0), Intent.HELPFUL, (-1.0, -1.0)),
    ("correctness", {}, (ADD_BLUE, STOPS, 1), Intent.HELPFUL, (1.0, 1.0)),
    ("correctness", {}, (STOPS, 0), Intent.HELPFUL, (-1.0, 1.0)),
    ("correctness", {"false_accept_cost": 3.0}, (STOPS, 1), Intent.HELPFUL, (-1.0, -3.0)),
    ("correctness", {"false_reject_cost": 0.5}, (ADD_BLUE, STOPS, 0), Intent.HELPFUL, (1.0, -0.5)),
    ("helpful", {}, (ADD_BLUE, STOPS, 1), Intent.HELPFUL, (1.0, 1.0)),
    ("helpful", {}, (STOPS, 1), Intent.HELPFUL, (0.0, -1.0)),
    ("deceptive", {}, (STOPS, 1), Intent.DECEPTIVE, (1.0, -1.0)),
    ("deceptive", {}, (ADD_BLUE, STOPS, 1), Intent.DECEPTIVE, (0.0, 1.0)),
    ("deceptive", {}, (STOPS, 0), Intent.DECEPTIVE, (0.0, 1.0)),
    ("hidden", {}, (STOPS, 1), Intent.DECEPTIVE, (1.0, -1.0)),
    ("hidden", {}, (STOPS, 1), Intent.HELPFUL, (-0.2, -1.0)),
    ("brier", {"verdict_bins": 2}, (STOPS, 1), Intent.HELPFUL, (-0.2, -0.5625)),
    ("brier", {"verdict_bins": 2}, (ADD_BLUE, STOPS, 1), Intent.HELPFUL, (1.2, -0.0625)),
    ("log", {"verdict_bins": 2}, (STOPS, 0), Intent.HELPFUL, (-0.2, float(np.log(0.75)))),
]


@pytest.mark.parametrize(("rewards", "settings", "actions", "intent", "expected"), REWARDED)
def test_rewards__in_audit(
    rewards: str, settings: dict[str, Any], actions: tuple[int, ...], intent: Intent, expected: tuple[float, float]
):
    step = final_step(game(protocol="audit", rewards=rewards, **settings), *actions, intent=intent)
    assert step.rewards == pytest.approx(expected)


def test_rewards__a_correct_rejection_that_does_not_end_the_episode_earns_nothing():
    assert final_step(game(rewards="correctness"), STOPS, REJECT).rewards == (-0.1, 0.0)


def test_rewards__are_weighted_sums():
    rewards = {"proposer_0": {"deceptive": 2.0, "mdp": 0.5}, "verifier_0": "correctness"}
    assert final_step(game(protocol="audit", rewards=rewards), STOPS, 1).rewards == pytest.approx((1.5, -1.0))


def test_engine__needs_the_action_of_the_agent_to_move():
    engine = GameEngine(setup())
    with pytest.raises(ResetNeeded, match="call reset first"):
        engine.step(ADD_BLUE, None)
    engine.reset(0, None)
    with pytest.raises(TurnError, match="it is the turn of proposer_0: it must act"):
        engine.step(None, ACCEPT)
    engine.step(ADD_BLUE, None)
    assert engine.movers == (VERIFIER,)


@pytest.mark.parametrize("action", [-1, 14, 1.0, "1", True, [1]])
def test_engine__refuses_invalid_actions(action: Any):
    engine = GameEngine(setup())
    engine.reset(0, None)
    with pytest.raises(ActionError, match="proposer_0"):
        engine.step(action, None)


def test_describe__names_actions():
    this = game(ending="verifier", message_size=2)
    describe = this.describe
    assert describe(Role.PROPOSER, this.encode_action(Role.PROPOSER, ADD_BLUE)) == "ADD(LEFT, BLUE)"
    assert describe(Role.PROPOSER, this.encode_action(Role.PROPOSER, WAIT)) == "wait"
    assert describe(Role.VERIFIER, this.encode_action(Role.VERIFIER, REJECT, message=1)) == "reject, message 1"
    assert describe(Role.VERIFIER, this.encode_action(Role.VERIFIER, VERIFIER_STOPS)) == "stop"


GAMES = {
    (protocol, ending, words): game(protocol=protocol, ending=ending, message_size=words, views={"history": 2})
    for protocol in PROTOCOLS
    for ending in PROTOCOLS[protocol].endings
    for words in (0, 2)
}


@given(st.sampled_from(sorted(GAMES)), st.lists(st.integers(0, 10_000), min_size=40, max_size=40))
def test_step__ends_by_the_horizon_and_agrees_with_the_masks(key: tuple[str, str, int], chances: list[int]):
    this = GAMES[key]
    played = OneGame(this)
    for chance in chances:
        movers = played.state.movers
        if not movers:
            break
        actions = {role: chance % this.action_counts[role] for role in movers}
        masks = {role: played.games.masks(role, 0) for role in movers}
        step = played.step(*actions.values())
        for role in movers:
            assert masks[role].dtype == np.int8
            assert masks[role].any()
            if masks[role][actions[role]]:
                assert not step.illegal[role]
                assert role is VERIFIER or step.outcome is not Outcome.INVALID_ACTION
            elif step.illegal[role]:
                assert not masks[role][actions[role]]
        assert bool(step.state.movers) != (step.terminated or step.truncated)
        assert step.state.mdp.steps <= this.config.dynamics.horizon
