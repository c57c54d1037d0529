"""Agents of the game that see what their views show, and messages between them."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from lilgym_mp.envs.proposer_verifier import (
    PROTOCOLS,
    BatchedGames,
    GameSettings,
    Role,
    View,
    measure,
    parallel_env,
)
from lilgym_mp.envs.proposer_verifier.game import Game
from lilgym_mp.envs.proposer_verifier.observations import ObservedGames
from lilgym_mp.envs.proposer_verifier.partners import BatchTurn
from lilgym_mp.envs.proposer_verifier.rewards import TERMS
from lilgym_mp.learning.common.agents import AgentError, open_agent
from lilgym_mp.learning.game.situations import CONTEXT, PENDING, REFUSED, context_sizes, read_situations
from lilgym_mp.learning.game.training import GameRun, train_game
from tests.command_line import succeeds
from tests.json_files import read_json, read_json_lines
from tests.learning.conftest import SMALL_GAME as SMALL

INDEPENDENT = replace(SMALL, algorithm="independent")
GUIDED = GameSettings(protocol="critique", views="guide")
EYES_SHUT = View(statement="none", target=False)


def trained(path, settings, recipe=INDEPENDENT, **options):
    train_game(settings, recipe, path, steps=128, device="cpu", **options)
    return open_agent(path, "cpu")


def first_turns(settings, role, count=40):
    """An agent's turns in games of different tasks, all with an empty scene and no message."""
    sizes = {"proposer_0": 0, "verifier_0": 13}
    games, rows = ObservedGames(Game(replace(settings, views="image", message_size=sizes)), count), np.arange(count)
    games.start(rows, rows, np.zeros(count, np.int64))
    return BatchTurn(games, role, rows, rows, [np.random.default_rng(0)] * count)


def test_guide__hides_statement_and_target_from_the_proposer_and_gives_a_message_for_each_action():
    proposer, verifier = GUIDED.views_by_role()
    assert (proposer.statement, proposer.target, proposer.scene) == ("none", False, "image")
    assert verifier == View()
    assert GUIDED.message_sizes() == (0, 13)
    assert replace(GUIDED, protocol="joint").message_sizes() == (0, 0)
    seen = BatchedGames(2, protocol="critique", views="guide").reset(seed=0)[0]
    assert seen["proposer_0"]["observation"].keys() == {"image", "proposal", "refused", "message"}
    with pytest.raises(ValueError, match="views 'guide' are of both agents"):
        GameSettings(views={"proposer_0": "guide", "verifier_0": "image"}).views_by_role()


@pytest.mark.parametrize("algorithm", ["independent", "shared"])
@pytest.mark.long
def test_trained_builder__acts_alike_whatever_the_statement(tmp_path, algorithm):
    agent = trained(tmp_path, GUIDED, replace(SMALL, algorithm=algorithm))
    logits = {}
    for role in Role:
        turn = first_turns(GUIDED, role)
        partner = agent.partner(role)
        choice = partner._policy(turn).choice
        logits[role] = choice.probabilities() if role is Role.PROPOSER else choice._log_probs
    assert torch.allclose(logits[Role.PROPOSER], logits[Role.PROPOSER][:1], atol=1e-6)
    assert not torch.allclose(logits[Role.VERIFIER], logits[Role.VERIFIER][:1], atol=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("algorithm", ["independent", "shared"])
def test_central_critic__sees_everything_while_the_builder_does_not(tmp_path, algorithm):
    recipe = replace(SMALL, algorithm=algorithm, critic="central")
    run = GameRun(GUIDED, recipe, tmp_path / "run", steps=128)
    run.step()
    (name, critic), *_ = run._critics.items()
    actor = run._actors[name]
    rollout = run._player.play(run._evaluate, np.random.default_rng(0))
    own, central = rollout.seen
    cells = np.flatnonzero(rollout.acted[Role.PROPOSER])
    roles = np.zeros_like(cells)
    (blind, of_blind), (whole, of_whole) = (run._situation(rollout, seen, roles, cells) for seen in (own, central))
    assert blind.states.statements == ("",)
    assert len(whole.states.statements) > 1
    with torch.no_grad():
        values = critic.values(critic.encode(whole.states).rows(torch.from_numpy(of_whole)), whole.context)
        assert rollout.values[Role.PROPOSER].reshape(-1)[cells] == pytest.approx(values.numpy(), abs=1e-5)
        alone = actor.values(actor.encode(blind.states).rows(torch.from_numpy(of_blind)), blind.context)
        assert not torch.allclose(values, alone)
    agent = trained(tmp_path / "saved", GUIDED, recipe)
    assert {*agent.network.state_dict()} == {key for key in run.networks.state_dict() if not key.startswith("critic_")}


@pytest.mark.long
def test_own_protocols_and_terms__train_and_play_by_name(tmp_path, monkeypatch):
    monkeypatch.setitem(PROTOCOLS, "claims", replace(PROTOCOLS["audit"], name="claims"))
    monkeypatch.setitem(TERMS, "boldness", lambda reward, judgement, intent: float(judgement is not None))
    rewards = json.dumps({"proposer_0": {"mdp": 1, "boldness": 0.1}, "verifier_0": "correctness"})
    small = "--envs 8 --same-statement 2 --rollout 64 --batch-size 64 --width 16 --steps 64"
    succeeds(f"train game TowerScratch --protocol claims --rewards '{rewards}' {small} --out", tmp_path)
    env = parallel_env(protocol="claims", rewards=json.loads(rewards), split="dev")
    agent = open_agent(tmp_path, "cpu")
    assert measure(env, *map(agent.partner, Role), tasks=env.tasks.ids[:5]).games == 5


@pytest.mark.long
def test_saved_agents__keep_their_views_and_play_in_games_with_others(tmp_path):
    agent = trained(tmp_path, GUIDED)
    assert agent.game.views_by_role() == GUIDED.views_by_role()
    players = [*map(agent.partner, Role)]
    own, other = (
        parallel_env(protocol="critique", views=views, split="dev", message_size={"proposer_0": 0, "verifier_0": 13})
        for views in ("guide", "structured")
    )
    tasks = own.tasks.ids[:6]
    assert measure(own, *players, tasks=tasks) == measure(other, *players, tasks=tasks)


def test_settings__are_saved_with_views_unless_both_agents_see_everything():
    assert "views" not in GameSettings(views="structured").to_json()
    assert GUIDED.to_json()["views"] == "guide"
    blind = GameSettings(views={"proposer_0": EYES_SHUT, "verifier_0": View(history=2)})
    again = GameSettings.from_json(json.loads(json.dumps(blind.to_json())))
    assert again.views_by_role() == blind.views_by_role()


@pytest.mark.long
def test_train__networks_are_built_from_every_part_of_a_view(tmp_path):
    views = {
        "proposer_0": View(scene="none", history=2, refused=False),
        "verifier_0": View(scene="none", statement="tokens", history=1),
    }
    sizes = {"proposer_0": 2, "verifier_0": 3}
    settings = GameSettings(protocol="critique", views=views, message_size=sizes)
    agent = trained(tmp_path, settings)
    players = [*map(agent.partner, Role)]
    env = parallel_env(protocol="critique", views=views, message_size=sizes, split="dev")
    assert measure(env, *players, tasks=env.tasks.ids[:5]).games == 5
    short = parallel_env(protocol="critique", message_size=sizes, split="dev")
    with pytest.raises(AgentError, match="a history of 2 turns in its views; the game keeps 0"):
        measure(short, *players, tasks=env.tasks.ids[:5])


def test_situations__leave_out_what_a_view_hides_and_add_past_turns():
    views = {"proposer_0": View(refused=False, history=2), "verifier_0": View(scene="none", proposal=True)}
    game = Game(GameSettings(protocol="critique", views=views, message_size={"proposer_0": 0, "verifier_0": 4}))
    games, row = ObservedGames(game, 1), np.zeros(1, np.int64)
    games.start(row, row, row)
    edit, reject_with_message = 2, 3
    games.step(np.array([edit]), row)
    items, context = read_situations(games, Role.VERIFIER, row)
    assert (items == -1).all()
    assert context[0, PENDING] == 2
    assert context[0, -1] == edit + 1  # the proposal itself, as no scene shows it
    games.step(row, np.array([reject_with_message]))
    _, context = read_situations(games, Role.PROPOSER, row)
    assert context[0, REFUSED] == 0
    none, reject = 0, 1  # numbers are shifted by one
    turns = context[0, len(CONTEXT) : -1].reshape(2, 4).tolist()
    assert turns == [[edit + 1, none, 1, 1], [none, reject, 1, 1 + reject_with_message]]
    assert len(context_sizes(game)) == context.shape[1]


def test_views_without_a_claim__are_refused_in_one_line(tmp_path):
    blind = {"proposer_0": View(), "verifier_0": EYES_SHUT}
    with pytest.raises(ValueError, match=r"'audit' has verifier_0 judge .* views show it no statement, and proposer_0"):
        GameRun(GameSettings(protocol="audit", views=blind), SMALL, tmp_path, steps=64, device="cpu")


@pytest.mark.long
def test_partners__with_other_message_sizes_are_refused_in_one_line(tmp_path):
    trained(tmp_path / "four", GameSettings(protocol="critique"))
    sizes = r"message_size \{'proposer_0': 0, 'verifier_0': 4\}; this game has \{'proposer_0': 0, 'verifier_0': 13\}"
    with pytest.raises(AgentError, match=sizes):
        GameRun(GUIDED, INDEPENDENT, tmp_path / "other", steps=64, proposers=[tmp_path / "four"], device="cpu")
    with pytest.raises(AgentError, match="guide needs one message of verifier_0 for each action"):
        GameRun(
            GameSettings(protocol="critique"), SMALL, tmp_path / "g", steps=64, verifiers=[Path("guide")], device="cpu"
        )


@pytest.mark.long
def test_builder__learns_to_do_what_the_scripted_guide_says(tmp_path, three):
    recipe = replace(INDEPENDENT, envs=64, rollout=2048, batch_size=256, epochs=2, learning_rate=3e-3, width=32)
    settings = replace(GUIDED, corpus=three)
    train_game(settings, recipe, tmp_path, steps=40_960, device="cpu", verifiers=[Path("guide")])
    success = []
    for messages in ("", "--messages silenced"):
        succeeds(f"evaluate {tmp_path} {messages} --force --out", tmp_path / "found.json")
        found = read_json(tmp_path / "found.json")["results"]
        success += [entry["success"] for entry in found if entry["verifier"] == "guide"]
    told, silent = success
    assert told > 0.9
    assert silent < told - 0.2


@pytest.mark.long
def test_run__says_that_games_do_not_end_within_its_rollouts(tmp_path):
    said = []
    trained(tmp_path, GameSettings(protocol="veto"), replace(SMALL, envs=32), say=said.append)  # two turns
    (warning,) = [line for line in said if line.startswith("warning")]
    assert warning.startswith("warning: in a rollout of 2 turns, ")
    assert "games side by side do not end" in warning
    assert 0.1 < read_json_lines(tmp_path / "progress.jsonl")[0]["unfinished"] <= 1
