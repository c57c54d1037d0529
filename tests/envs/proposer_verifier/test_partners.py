"""Partners, SingleAgentView and measures."""

import re
import warnings
from unittest.mock import Mock

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env

from lilgym_mp.envs.proposer_verifier import (
    AGENTS,
    ALWAYS_ACCEPT,
    PROTOCOLS,
    SCRIPTED,
    ClaimingProposer,
    OracleVerifier,
    PartnerError,
    RandomPartner,
    SingleAgentView,
    env,
    measure,
    metrics,
    play_games,
    raw_env,
    summarise,
)
from lilgym_mp.envs.proposer_verifier.metrics import GameRecord
from lilgym_mp.envs.proposer_verifier.rewards import Judgement
from lilgym_mp.envs.rules import Outcome
from tests.envs.proposer_verifier.games import ADD_BLUE, STOPS, WAIT

PROPOSER, VERIFIER = AGENTS
GAMES = 60


def some_tasks(game):
    """About GAMES tasks spread over the split, to keep the test short."""
    ids = game.unwrapped.tasks.ids
    return ids[:: max(1, len(ids) // GAMES)]


CLAIMING = ClaimingProposer()  # helpful or deceptive by the episode's intent


@pytest.mark.parametrize(
    ("verifier", "rates"),
    [
        (OracleVerifier(), (1.0, 0.0)),
        (OracleVerifier(error_rate=1.0), (0.0, 1.0)),
        (OracleVerifier(error_rate=0.25), (pytest.approx(0.75, abs=0.15), pytest.approx(0.25, abs=0.15))),
        (ALWAYS_ACCEPT, (1.0, 1.0)),
        (SCRIPTED["always_reject"], (0.0, 0.0)),
    ],
)
def test_scripted_verifiers__accept_true_and_false_claims(verifier, rates):
    game = env(protocol="audit", start="flipit", rewards="hidden")
    measured = measure(game, CLAIMING, verifier, tasks=some_tasks(game))
    assert (measured.true_accept_rate, measured.false_accept_rate) == rates


@pytest.mark.parametrize(("protocol", "agent"), [("joint", PROPOSER), ("audit", VERIFIER), ("critique", PROPOSER)])
def test_single_agent_view__passes_gymnasiums_check(protocol, agent):
    view = SingleAgentView(raw_env(protocol=protocol, rewards="hidden"), agent, "random")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(view, skip_render_check=True)


def test_single_agent_view__sums_rewards_since_the_last_action():
    view = SingleAgentView(env(), PROPOSER, "always_reject")
    view.reset(seed=0)
    _, reward, *_ = view.step(ADD_BLUE)
    assert reward == -0.1
    view = SingleAgentView(env(), VERIFIER, RandomPartner())
    view.reset(seed=0)
    assert view.unwrapped.engine.state.proposal is not None


def test_single_agent_view__skips_games_that_end_before_its_turn():
    view = SingleAgentView(env(protocol="audit", horizon=2), VERIFIER, RandomPartner())
    skipped = [view.reset(seed=seed)[1]["skipped_games"] for seed in range(20)]
    assert max(skipped) > 0


@pytest.mark.long
def test_single_agent_view__raises_if_it_never_has_a_turn():
    view = SingleAgentView(env(protocol="audit", horizon=1), VERIFIER, lambda turn: ADD_BLUE)
    with pytest.raises(RuntimeError, match="verifier_0 had no turn in 1000 games"):
        view.reset(seed=0)


def test_single_agent_view__refuses_invalid_arguments():
    refused = [
        ((gym.make("CartPole-v1"), VERIFIER, "random"), "needs a proposer-verifier environment, not"),
        ((env(), "judge", "random"), "'judge'; choose from proposer_0, verifier_0"),
        ((env(), VERIFIER, "friend"), "'friend'; choose from always_accept, always_reject"),
        ((env(), VERIFIER, 3), "callable with a PartnerTurn, not 3"),
    ]
    for arguments, message in refused:
        with pytest.raises((TypeError, ValueError), match=message):
            SingleAgentView(*arguments)
    with pytest.raises(ValueError, match="between 0 and 1, not 2"):
        OracleVerifier(error_rate=2)


@pytest.mark.parametrize(
    ("action", "message"),
    [
        (WAIT, r"chose 13 \(wait\), which is not legal for proposer_0 now"),
        (99, "99 of proposer_0 is out of range"),
        ("add", "a whole number 0 .. 13, not 'add'"),
    ],
)
def test_illegal_action_of_a_partner__raises_naming_it(action, message):
    def bad_partner(turn):
        return action

    with pytest.raises(PartnerError, match=message) as caught:
        SingleAgentView(env(), VERIFIER, bad_partner).reset(seed=0)
    assert "bad_partner" in str(caught.value)


def test_single_agent_view__after_the_end_needs_a_reset():
    view = SingleAgentView(env(), PROPOSER, "always_accept")
    with pytest.raises(ResetNeeded):
        view.step(STOPS)
    view.reset(seed=0)
    view.step(STOPS)
    with pytest.raises(ResetNeeded, match="the game is over; call reset"):
        view.step(STOPS)


def record(*answers, rounds=2, outcome=Outcome.SUCCESS):
    judgements = tuple(Judgement(accepted, True, holds) for accepted, holds in answers)
    return GameRecord("task", "A statement.", True, outcome, rounds, (1.0, -1.0), judgements)


def test_measures__of_literal_games():
    measured = summarise(
        [
            record((True, True), (True, True), (False, True), rounds=4),
            record((False, False), (True, False), outcome=Outcome.WRONG_STOP),
        ]
    )
    assert (measured.games, measured.claims, measured.mean_rounds) == (2, 5, 3.0)
    assert (measured.success_rate, measured.mean_return_proposer, measured.mean_return_verifier) == (0.5, 1.0, -1.0)
    assert measured.true_accept_rate == pytest.approx(2 / 3)
    assert measured.false_accept_rate == pytest.approx(1 / 2)


def test_j__of_a_verifier_that_knows_the_target_alone_is_zero():
    """Its pooled rates are 3/4 and 1/4: claims hold mostly where the target is false."""
    claims = [(True, holds) for holds in (True, False, False, False)] + [
        (False, holds) for holds in (True,) * 3 + (False,)
    ]
    measured = summarise([record((not target, holds))._replace(target=target) for target, holds in claims])
    assert (measured.true_accept_rate, measured.false_accept_rate) == (0.75, 0.25)
    names = ("games", "success_rate", "true_accept_rate", "false_accept_rate", "j")
    assert tuple(map(measured.by_target["true"].get, names)) == (4, 1.0, 0.0, 0.0, 0.0)
    assert tuple(map(measured.by_target["false"].get, names)) == (4, 1.0, 1.0, 1.0, 0.0)
    assert measured.j == 0.0


def test_j__is_the_mean_over_targets_with_an_interval_over_statements():
    right, wrong = (record((True, True), (False, False)), record((False, True), (True, False)))
    games = [game._replace(statement=str(index)) for index, game in enumerate([right, right, right, wrong])]
    measured = summarise(games)
    assert measured.j == pytest.approx(0.5)
    assert measured.j_interval == (pytest.approx(-0.5), 1.0)
    assert summarise([right] * 4).j_interval == (1.0, 1.0)
    assert summarise([record((True, True))]).j is None
    without_claims = summarise([record()])
    assert (without_claims.true_accept_rate, without_claims.false_accept_rate) == (None, None)
    with pytest.raises(ValueError, match="cannot summarise zero games"):
        summarise([])


def test_accepted_false_claims__are_those_that_end_the_game():
    lie, continued = Judgement(True, True, False), Judgement(True, False, False)
    games = [
        record()._replace(judgements=judged)
        for judged in [(lie,), (continued,), (lie, Judgement(False, False, False)), ()]
    ]
    assert summarise(games).accepted_false_claims == 0.25


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_records__depend_on_the_seed_but_not_on_the_other_games_of_the_batch(protocol, monkeypatch):
    game = env(protocol=protocol, start="flipit", rewards="hidden")
    tasks = some_tasks(game)[:12]
    together = play_games(game, CLAIMING, OracleVerifier(0.3), tasks=tasks, seed=5)
    assert tuple(record.task for record in together) == tasks
    assert play_games(game, CLAIMING, OracleVerifier(0.3), tasks=tasks, seed=8) != together
    monkeypatch.setattr(metrics, "LARGEST_BATCH", 1)
    assert play_games(game, CLAIMING, OracleVerifier(0.3), tasks=tasks, seed=5) == together


@pytest.mark.parametrize("partner", ["oracle", "always_accept", "target_only"])
def test_scripted__play_alike_singly_and_in_batches(partner):
    game = env(protocol="veto", start="flipit")
    single, tasks = SCRIPTED[partner], some_tasks(game)[:20]
    batched = play_games(game, CLAIMING, single, tasks=tasks)
    assert play_games(game, CLAIMING, lambda turn: single(turn), tasks=tasks) == batched


@pytest.mark.parametrize(
    ("actions", "message"),
    [
        (lambda count: np.full(count, 10_000), "chose 10000, which is not legal for verifier_0 now"),
        (lambda count: np.zeros(count + 1, int), "must return 3 whole numbers"),
        (lambda count: np.zeros(count), "must return 3 whole numbers"),
    ],
)
def test_batch_partner__that_breaks_the_rules_is_named(actions, message):
    game, partner = env(protocol="joint"), Mock(batch=lambda turn: actions(len(turn.indices)))
    with pytest.raises(PartnerError, match=rf"partner {re.escape(repr(partner))}.* {message}"):
        play_games(game, RandomPartner(), partner, tasks=some_tasks(game)[:3])
    partner.assert_not_called()  # singly
