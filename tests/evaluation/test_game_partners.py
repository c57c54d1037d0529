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


def measured_lies(game, tasks):
    """What a deceptive expert reaches with a verifier that accepts everything."""
    return measure(game, ExpertProposer(game.unwrapped.dynamics, Intent.DECEPTIVE), ALWAYS_ACCEPT, tasks=tasks)


@pytest.mark.parametrize("settings", SETTINGS, ids=str)
def test_deceptive_expert__claims_falsely_one_edit_before_a_solution(settings):
    game = env(start="flipit", **settings)
    measured = measured_lies(game, some_tasks(game))
    assert (measured.accepted_false_claims, measured.success_rate) == (1.0, 0.0)


def test_deceptive_expert__leaves_a_scene_where_its_claim_would_be_true():
    game = env(protocol="audit", start="scratch")
    solved = [task.id for task in game.unwrapped.tasks if task.solved_by(task.start)][:5]
    assert solved
    measured = measured_lies(game, solved)
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
    assert measure(game, Builder(), guide, tasks=tasks).success_rate == 1.0
    for change in ("silenced", "random"):
        assert measure(game, Builder(), ChangedMessages(guide, change), tasks=tasks).success_rate < 0.7


def test_guide__needs_a_message_for_each_action():
    game = env(protocol="critique", split="dev")
    with pytest.raises(PartnerError, match=r"Guide\(\) needs message_size 13 for verifier_0.*this game has 4"):
        measure(game, Builder(), Guide(game.unwrapped.dynamics), tasks=game.unwrapped.tasks.ids[:1])


def test_changed_messages__keep_the_choices_of_both_agents():
    game = env(protocol="veto", message_size={"proposer_0": 2, "verifier_0": 3}, split="dev")
    players = SCRIPTED["helpful"], SCRIPTED["oracle"]
    tasks = game.unwrapped.tasks.ids[:20]
    silenced, at_random = (
        measure(game, *[ChangedMessages(partner, change) for partner in players], tasks=tasks)
        for change in ("silenced", "random")
    )
    assert silenced == measure(game, *players, tasks=tasks)
    assert at_random.games == 20
