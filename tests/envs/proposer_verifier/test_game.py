"""The rules of each protocol, and the rewards."""

import pytest

from lilgym_mp.envs.proposer_verifier import Role
from lilgym_mp.envs.proposer_verifier.protocols import PROPOSER, VERIFIER
from tests.envs.proposer_verifier.games import ACCEPT, ACTIONS, ADD_BLUE, REJECT, STOPS, game, played

# Games of the task "Some block is blue.": settings, actions, and after the last one the outcome, the agents to move,
# the items in the scene, the rounds and both rewards.
TURNS = """
veto                       blue                      | none           verifier  0 0  0.0
veto                       blue accept               | continues      proposer 1 1 -0.1
veto                       blue reject               | continues      proposer 0 1 -0.1
veto                       blue accept STOP accept   | success        nobody    1 2  1.0
veto                       STOP accept               | wrong_stop     nobody    0 1 -1.0
veto                       STOP reject               | continues      proposer 0 1 -0.1
veto                       remove accept             | invalid_action nobody    0 1 -1.0
veto                       remove reject             | continues      proposer 0 1 -0.1
veto horizon=2             blue reject blue reject   | horizon        nobody    0 2 -1.0
veto horizon=2             blue reject blue accept   | horizon        nobody    1 2 -1.0
joint                      blue+continue             | continues      both     1 1 -0.1
joint                      blue+halt                 | wrong_stop     nobody    0 1 -1.0
joint                      blue+continue black+halt  | success        nobody    1 2  1.0
audit                      black blue                | continues      proposer 2 2 -0.1
audit                      STOP                      | none           verifier  0 0  0.0
audit                      blue STOP refuse          | success        nobody    1 2  1.0
audit                      blue STOP believe         | success        nobody    1 2  1.0
audit horizon=1            blue                      | horizon        nobody    1 1 -1.0
critique                   blue reject               | none           proposer 0 0  0.0
critique exchanges=1       black reject blue         | continues      proposer 1 1 -0.1
"""


def turns_of(words):
    """The actions of each turn; a pair where both agents move."""
    turns = [tuple(ACTIONS[name] for name in word.split("+")) for word in words]
    return [turn if len(turn) > 1 else turn[0] for turn in turns]


def items(engine):
    return sum(1 for _ in engine.state.mdp.scene.items())


@pytest.mark.parametrize("drawn", TURNS.strip().splitlines())
def test_game__of_these_actions(drawn):
    given, (outcome, movers, *numbers) = drawn.split("|")[0].split(), drawn.split("|")[1].split()
    settings = dict(word.split("=") for word in given[1:] if "=" in word)
    options = {name: int(value) if value.isdigit() else value for name, value in settings.items()}
    this = game(protocol=given[0], message_size=0, **options)
    engine, results = played(this, *turns_of(word for word in given[1:] if "=" not in word))
    assert str(engine.games.last_outcome(0)).lower() == outcome
    assert engine.movers == {"nobody": (), "proposer": (PROPOSER,), "verifier": (VERIFIER,), "both": (*Role,)}[movers]
    step = results[-1]
    assert [items(engine), engine.state.mdp.steps, *step.rewards] == [*map(float, numbers), float(numbers[-1])]
    assert step.terminated == (movers == "nobody")


def test_horizon__truncates_under_the_release_rules():
    _, (_, step) = played(game(horizon=1, rules="release"), ADD_BLUE, REJECT)
    assert step[:3] == ((-0.1, -0.1), False, True)


def test_joint__the_proposer_cannot_stop():
    assert not played(game(protocol="joint"))[0].mask(PROPOSER)[STOPS]


def test_message__reaches_the_state_and_costs_its_sender():
    this = game(message_size=2, message_cost=0.25)
    proposal = this.encode_action(PROPOSER, ADD_BLUE, message=2)
    engine, (first, second) = played(this, proposal, this.encode_action(VERIFIER, ACCEPT))
    assert first.rewards == (-0.25, 0.0)
    assert second.rewards == (-0.1, -0.1)
    assert engine.games.messages.tolist() == [[2], [0]]
    assert this.describe(VERIFIER, this.encode_action(VERIFIER, REJECT, message=1)) == "reject, message 1"
    critique = game(protocol="critique")
    engine, _ = played(critique, ADD_BLUE, critique.encode_action(VERIFIER, REJECT, message=3))
    assert engine.games.messages.tolist() == [[0], [3]]


ILLEGAL = {
    "the round is spent": "veto wait",
    "the proposal is rejected": "veto blue waits",
    "nothing is believed": "audit STOP waits",
    "no edit is made": "joint STOP+continue",
}


@pytest.mark.parametrize("meaning", ILLEGAL)
def test_illegal_choice__counts_as_no_choice(meaning):
    protocol, *words = ILLEGAL[meaning].split()
    engine, results = played(game(protocol=protocol), *turns_of(words))
    assert any("illegal_choice" in info for info in results[-1].infos)
    assert items(engine) == 0
    judgement = engine.games.last_judgement(0)
    assert judgement is None or not judgement.accepted
    assert engine.state.mdp.steps == 1


# Rewards, intent and actions in an audit, and both rewards.
REWARDED = """
common      helpful   blue STOP believe | 1.0 1.0
common      helpful   STOP refuse       | -1.0 -1.0
correctness helpful   blue STOP believe | 1.0 1.0
correctness helpful   STOP refuse       | -1.0 1.0
correctness helpful   STOP believe      | -1.0 -1.0
correctness helpful   blue STOP refuse  | 1.0 -1.0
hidden      deceptive STOP believe      | 1.0 -1.0
hidden      helpful   STOP believe      | -0.2 -1.0
hidden      helpful   blue STOP believe | 1.2 1.0
hidden      deceptive blue STOP believe | 0.0 1.0
hidden      deceptive STOP refuse       | 0.0 1.0
"""


@pytest.mark.parametrize("line", REWARDED.strip().splitlines())
def test_rewards__in_audit(line):
    given, expected = line.split("|")
    rewards, intent, *words = given.split()
    _, results = played(game(protocol="audit", rewards=rewards), *turns_of(words), intent=intent)
    assert results[-1].rewards == pytest.approx([*map(float, expected.split())])


def test_rewards__a_correct_rejection_that_does_not_end_the_episode_earns_nothing():
    _, (_, step) = played(game(rewards="correctness"), STOPS, REJECT)
    assert step.rewards == (-0.1, 0.0)


def test_rewards__are_weighted_sums():
    rewards = {"proposer_0": {"hidden": 2.0, "mdp": 0.5}, "verifier_0": "correctness"}
    _, (_, step) = played(game(protocol="audit", rewards=rewards), STOPS, ACTIONS["believe"], intent="deceptive")
    assert step.rewards == pytest.approx((1.5, -1.0))
