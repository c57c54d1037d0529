"""Invalid settings are refused."""

import pytest

from lilgym_mp.envs.proposer_verifier import PROTOCOLS, BatchedGames, env, parallel_env, raw_env

REFUSED = [
    ({"protocol": "vote"}, f"'vote'; choose from {', '.join(sorted(PROTOCOLS))}"),
    ({"colour": 1}, "'colour'; choose from corpus, split, rules"),
    ({"rules": "house"}, "'house'; choose from paper, release"),  # and other settings of single environments
    ({"rewards": "kind"}, "'kind'; choose from common, correctness, hidden"),
    ({"rewards": {"proposer_0": "mdp"}}, "rewards must name proposer_0 and verifier_0, not proposer_0"),
    (
        {"rewards": {"proposer_0": "mdp", "verifier_0": "truth"}},
        "'truth'; choose from correctness, hidden",
    ),
    ({"rewards": {"proposer_0": {"mdp": "much"}, "verifier_0": "mdp"}}, "the weight of reward 'mdp' must be a finite"),
    ({"rewards": 3}, "rewards must be a preset, a mapping by agent or a function, not 3"),
    ({"rewards": lambda mdp, judgement, intent: mdp}, "must return the two rewards of proposer_0 and verifier_0, not"),
    (
        {"rewards": lambda mdp, judgement, intent: (mdp, None)},
        "the verifier's reward must be a finite number, not None",
    ),
    ({"configuration": "Tower"}, "'Tower'; choose from ScatterFlipIt, ScatterScratch"),
    ({"configuration": "TowerFlipIt", "start": "scratch"}, "give a configuration, or appearance and start, not both"),
    ({"exchanges": -1}, "exchanges must be a whole number, 0 or more, not -1"),
    ({"message_size": 1.5}, "message_size must be a whole number, 0 or more, not 1.5"),
    ({"message_size": {"verifier_0": 2}}, "name both proposer_0 and verifier_0, not only verifier_0"),
    ({"message_cost": float("nan")}, "message_cost must be a finite number, not nan"),
    ({"deceptive_share": 1.5}, "deceptive_share must be between 0 and 1, not 1.5"),
    ({"views": "picture"}, "'picture'; choose from guide, image, structured"),
    ({"views": {"scene": "sound"}}, "'sound'; choose from image, none, structured"),
    ({"views": {"statement": "sound"}}, "'sound'; choose from none, text, tokens"),
    ({"views": {"smell": True}}, "'smell'; choose from history, proposal, proposed_scene"),
    ({"views": {"target": 1}}, "target of a view must be True or False, not 1"),
    ({"views": {"history": -1}}, "history of a view must be a whole number, 0 or more, not -1"),
    ({"views": {"verifier_0": "image"}}, "name both proposer_0 and verifier_0, not only verifier_0"),
    ({"reveal_truth": "yes"}, "reveal_truth must be True or False, not 'yes'"),
    ({"homogeneous": 1}, "homogeneous must be True or False, not 1"),
    (
        {"homogeneous": True, "views": {"proposer_0": {"history": 2}, "verifier_0": {"history": 3}}},
        "homogeneous agents need equal spaces for 'history'",
    ),
]


@pytest.mark.parametrize(("settings", "message"), REFUSED, ids=[message[:40] for _, message in REFUSED])
def test_settings__are_refused_with_the_value_and_the_choices(settings, message):
    with pytest.raises((ValueError, TypeError), match=message):
        parallel_env(**settings)


@pytest.mark.parametrize("make", [env, raw_env, parallel_env, lambda **how: BatchedGames(2, **how)])
def test_settings__are_validated_by_every_environment(make):
    with pytest.raises(ValueError, match="'vote'"):
        make(protocol="vote")


@pytest.mark.parametrize("name", ["ScatterFlipIt", "lilgym_mp/ScatterFlipIt-v0"])
def test_configuration__sets_appearance_and_start(name):
    for tasks in (env(name).unwrapped.tasks, parallel_env(name).tasks, BatchedGames(1, configuration=name).tasks):
        assert (tasks.provenance.appearance, tasks.provenance.start) == ("scatter", "flipit")


def test_render_mode__is_refused_with_the_choices():
    with pytest.raises(ValueError, match="'film'; choose from ansi, human, rgb_array"):
        env(render_mode="film")


@pytest.mark.parametrize("count", [0, -1, 1.5, True])
def test_number_of_games__must_be_positive(count):
    with pytest.raises(ValueError, match="num_games must be a positive"):
        BatchedGames(count)
