"""Expert proposers in the two-agent game."""

import pytest

from lilgym_mp.envs.proposer_verifier import (
    ALWAYS_ACCEPT,
    SCRIPTED,
    Intent,
    OracleVerifier,
    PartnerError,
    env,
    measure,
    play_games,
)
from lilgym_mp.evaluation.game_partners import Builder, ChangedMessages, ExpertProposer, Guide
from lilgym_mp.scene.appearances import make_appearance

SETTINGS = [  # in joint the verifier alone may stop
    {"protocol": protocol, "appearance": appearance}
    for protocol, appearance in (("veto", "tower"), ("audit", "scatter"), ("critique", "scatter"))
]


def some_tasks(game):
    return game.unwrapped.tasks.ids[::100]


@pytest.mark.parametrize("settings", SETTINGS, ids=str)
@pytest.mark.long
def test_expert__tells_the_truth_in_the_fewest_actions(settings):
    game = env(start="flipit", **settings)
    expert = ExpertProposer(game.unwrapped.dynamics)
    records = play_games(game, expert, OracleVerifier(), tasks=some_tasks(game))
    tasks = [game.unwrapped.tasks.by_id(record.task) for record in records]
    solutions = [expert._solver.solve(task).actions for task in tasks]
    assert [record.rounds for record in records] == [len(actions or ()) for actions in solutions]
    assert all(judged.holds for record in records for judged in record.judgements[-1:])


@pytest.mark.parametrize("settings", SETTINGS, ids=str)
def test_deceptive_expert__claims_falsely_one_edit_before_a_solution(settings):
    game = env(start="flipit", **settings)
    expert = ExpertProposer(game.unwrapped.dynamics, Intent.DECEPTIVE)
    measured = measure(game, expert, ALWAYS_ACCEPT, tasks=some_tasks(game))
    assert (measured.accepted_false_claims, measured.success_rate) == (1.0, 0.0)


def test_deceptive_expert__leaves_a_scene_where_its_claim_would_be_true():
    game = env(protocol="audit", start="scratch")
    solved = [task.id for task in game.unwrapped.tasks if task.solved_by(task.start)][:5]
    assert solved
    expert = ExpertProposer(game.unwrapped.dynamics, Intent.DECEPTIVE)
    measured = measure(game, expert, ALWAYS_ACCEPT, tasks=solved)
    assert measured.success_rate == 0.0
    assert measured.accepted_false_claims > 0.5  # some statements stay true under most edits


def test_expert__by_intent_lies_in_deceptive_episodes_alone():
    game = env(protocol="audit", start="flipit", rewards="hidden")
    measured = measure(game, ExpertProposer(game.unwrapped.dynamics, None), SCRIPTED["oracle"], tasks=some_tasks(game))
    assert 0.2 < measured.success_rate < 0.8
    assert (measured.true_accept_rate, measured.false_accept_rate) == (1.0, 0.0)


@pytest.mark.parametrize(("protocol", "appearance"), [("critique", "scatter"), ("veto", "tower"), ("joint", "tower")])
def test_guide_and_builder__solve_every_task_by_messages_alone(protocol, appearance):
    count = make_appearance(appearance).action_count
    sizes = {"proposer_0": 0, "verifier_0": count}
    game = env(protocol=protocol, appearance=appearance, views="guide", message_size=sizes, split="dev")
    tasks, guide = game.unwrapped.tasks.ids[::10], Guide(game.unwrapped.dynamics)
    told = measure(game, Builder(), guide, tasks=tasks)
    assert told.success_rate == 1.0
    silenced = measure(game, Builder(), ChangedMessages(guide, "silenced"), tasks=tasks)
    at_random = measure(game, Builder(), ChangedMessages(guide, "random"), tasks=tasks)
    assert max(silenced.success_rate, at_random.success_rate) < 0.7


def test_guide__needs_a_message_for_each_action():
    game = env(protocol="critique", split="dev")
    with pytest.raises(PartnerError, match=r"Guide\(\) needs message_size 13 for verifier_0.*this game has 4"):
        measure(game, Builder(), Guide(game.unwrapped.dynamics), tasks=game.unwrapped.tasks.ids[:1])


def test_changed_messages__keep_the_choices_of_both_agents():
    sizes = {"proposer_0": 2, "verifier_0": 3}
    game = env(protocol="veto", message_size=sizes, split="dev")
    players = SCRIPTED["helpful"], SCRIPTED["oracle"]
    tasks = game.unwrapped.tasks.ids[:20]
    changed = [ChangedMessages(partner, "random") for partner in players]
    expected = measure(game, *players, tasks=tasks)
    assert measure(game, *[ChangedMessages(partner, "silenced") for partner in players], tasks=tasks) == expected
    assert measure(game, *changed, tasks=tasks).games == 20
