"""The rules of each protocol, and the rewards."""

import pytest
from gymnasium.error import ResetNeeded

from lilgym_mp.envs.proposer_verifier import Intent, Role, TurnError
from lilgym_mp.envs.proposer_verifier.engine import GameEngine
from lilgym_mp.envs.proposer_verifier.protocols import PROPOSER, VERIFIER
from lilgym_mp.scene.actions import ActionError
from tests.envs.proposer_verifier.games import (
    ACCEPT,
    ACTIONS,
    ADD_BLACK,
    ADD_BLUE,
    REJECT,
    STOPS,
    OneGame,
    all_steps,
    final_step,
    game,
)

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


def items(step):
    return sum(1 for _ in step.state.mdp.scene.items())


@pytest.mark.parametrize("drawn", TURNS.strip().splitlines())
def test_game__of_these_actions(drawn):
    played, (outcome, movers, *numbers) = drawn.split("|")[0].split(), drawn.split("|")[1].split()
    settings = dict(word.split("=") for word in played[1:] if "=" in word)
    options = {name: int(value) if value.isdigit() else value for name, value in settings.items()}
    this = game(protocol=played[0], message_size=0, **options)
    step = final_step(this, *turns_of(word for word in played[1:] if "=" not in word))
    assert str(step.outcome).lower() == outcome
    assert step.movers == {"nobody": (), "proposer": (PROPOSER,), "verifier": (VERIFIER,), "both": tuple(Role)}[movers]
    assert [items(step), step.state.mdp.steps, *step.rewards] == [*map(float, numbers), float(numbers[-1])]
    assert step.terminated == (movers == "nobody")


def test_horizon__truncates_under_the_release_rules():
    step = final_step(game(horizon=1, rules="release"), ADD_BLUE, REJECT)
    assert (step.terminated, step.truncated, step.rewards) == (False, True, (-0.1, -0.1))


def test_joint__the_proposer_cannot_stop():
    assert not OneGame(game(protocol="joint")).games.masks(Role.PROPOSER, 0)[STOPS]


def test_message__reaches_the_state_and_costs_its_sender():
    this = game(message_size=2, message_cost=0.25)
    steps = all_steps(
        this,
        this.encode_action(Role.PROPOSER, ADD_BLUE, message=2),
        this.encode_action(Role.VERIFIER, ACCEPT),
        ADD_BLACK * 3,
    )
    assert steps[0].rewards == (-0.25, 0.0)
    assert steps[1].rewards == (-0.1, -0.1)
    assert steps[1].messages == (2, 0)
    assert this.describe(Role.VERIFIER, this.encode_action(Role.VERIFIER, REJECT, message=1)) == "reject, message 1"
    critique = game(protocol="critique")
    step = final_step(critique, ADD_BLUE, critique.encode_action(Role.VERIFIER, REJECT, message=3))
    assert step.messages == (0, 3)


ILLEGAL = {
    "the round is spent": "veto wait",
    "the proposal is rejected": "veto blue waits",
    "nothing is believed": "audit STOP waits",
    "no edit is made": "joint STOP+continue",
}


@pytest.mark.parametrize("meaning", ILLEGAL)
def test_illegal_choice__counts_as_no_choice(meaning):
    protocol, *words = ILLEGAL[meaning].split()
    step = final_step(game(protocol=protocol), *turns_of(words))
    assert any(step.illegal)
    assert items(step) == 0
    assert step.judgement is None or not step.judgement.accepted
    assert step.state.mdp.steps == 1


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
    played, expected = line.split("|")
    rewards, intent, *words = played.split()
    step = final_step(game(protocol="audit", rewards=rewards), *turns_of(words), intent=Intent[intent.upper()])
    assert step.rewards == pytest.approx([*map(float, expected.split())])


def test_rewards__a_correct_rejection_that_does_not_end_the_episode_earns_nothing():
    assert final_step(game(rewards="correctness"), STOPS, REJECT).rewards == (-0.1, 0.0)


def test_rewards__are_weighted_sums():
    rewards = {"proposer_0": {"hidden": 2.0, "mdp": 0.5}, "verifier_0": "correctness"}
    this = game(protocol="audit", rewards=rewards)
    assert final_step(this, STOPS, 1, intent=Intent.DECEPTIVE).rewards == pytest.approx((1.5, -1.0))


def test_engine__needs_the_action_of_the_agent_to_move():
    engine = GameEngine(game())
    with pytest.raises(ResetNeeded, match="call reset first"):
        engine.step(ADD_BLUE, None)
    engine.reset(0, None)
    with pytest.raises(TurnError, match="it is the turn of proposer_0: it must act"):
        engine.step(None, ACCEPT)
    engine.step(ADD_BLUE, None)
    assert engine.movers == (VERIFIER,)


@pytest.mark.parametrize("action", [-1, 14, 1.0, True, [1]])
def test_engine__refuses_invalid_actions(action):
    engine = GameEngine(game())
    engine.reset(0, None)
    with pytest.raises(ActionError, match="proposer_0"):
        engine.step(action, None)
