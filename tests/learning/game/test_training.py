"""Runs that learn the game: learning, saving, resuming, partners and invalid input."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from lilgym_mp.cli.training import resumed
from lilgym_mp.corpus import load_tasks
from lilgym_mp.envs.observation import scene_of
from lilgym_mp.envs.proposer_verifier import (
    SCRIPTED,
    GameSettings,
    Role,
    measure,
    parallel_env,
)
from lilgym_mp.evaluation import Settings
from lilgym_mp.learning.common.agents import AgentError, open_agent
from lilgym_mp.learning.common.run_directory import TrainingRunError
from lilgym_mp.learning.game.agent import load_agent
from lilgym_mp.learning.game.learner import LEARNER
from lilgym_mp.learning.game.rollout import RolloutPlayer
from lilgym_mp.learning.game.training import GameRun, train_game
from lilgym_mp.learning.ppo.training import train_ppo
from lilgym_mp.programs import compile_program
from tests.command_line import error_of, lilgym, output_of, succeeds
from tests.json_files import read_json, read_json_lines
from tests.learning.conftest import SMALL_GAME as SMALL
from tests.learning.conftest import SMALL_PPO, equal, interrupt_at_64_steps, weights

LEARNING = replace(SMALL, envs=64, rollout=1024, batch_size=256, learning_rate=3e-3, width=32)
INDEPENDENT = replace(SMALL, algorithm="independent")
JOINT = GameSettings(protocol="joint")


def trained(path, steps=128, recipe=SMALL, settings=JOINT, **options):
    return train_game(settings, recipe, path, steps=steps, device="cpu", **options)


# Learning


@pytest.mark.long
@pytest.mark.parametrize(("algorithm", "verifier"), [("independent", "ppo"), ("shared", "both")])
def test_train__both_agents_solve_three_statements(tmp_path, three, algorithm, verifier):
    recipe = replace(LEARNING, algorithm=algorithm, verifier=verifier, epochs=2)
    settings = GameSettings(protocol="joint", corpus=three)
    env = parallel_env(protocol="joint", corpus=three, split="dev")
    agent = trained(tmp_path, 12_288, recipe, settings)
    players = (agent.partner(role, sampled=True) for role in Role)
    assert measure(env, *players, tasks=list(env.tasks.ids) * 30).success_rate > 0.85


@pytest.mark.long
def test_train__a_verifier_alone_learns_to_judge_claims(tmp_path, three):
    recipe = replace(LEARNING, verifier="cross-entropy")
    settings = GameSettings(protocol="audit", rewards="correctness", corpus=three)
    proposers = [SCRIPTED["helpful"], SCRIPTED["deceptive"]]
    agent = trained(tmp_path, 12_288, recipe, settings, proposers=proposers)
    assert agent.partner(Role.PROPOSER) is None
    env = parallel_env(protocol="audit", rewards="correctness", corpus=three, split="dev")
    helpful, deceptive = (
        measure(env, SCRIPTED[proposer], agent.partner(Role.VERIFIER), tasks=list(env.tasks.ids) * 30)
        for proposer in ("helpful", "deceptive")
    )
    assert helpful.true_accept_rate > 0.8
    assert deceptive.false_accept_rate < 0.2


# Every game


@pytest.mark.parametrize(
    ("verifier", "protocol", "rewards", "changes"),
    [
        ("cross-entropy", "veto", "correctness", {}),
        ("both", "joint", "common", {"configuration": "ScatterFlipIt"}),
        ("both", "audit", "hidden", {}),
        ("both", "critique", "common", {"message_size": 3, "message_cost": 0.01}),
    ],
)
@pytest.mark.long
def test_train__every_protocol_gives_agents_that_play(tmp_path, own, verifier, protocol, rewards, changes):
    changes = {"configuration": "TowerFlipIt", "horizon": 4, **changes}
    settings = GameSettings(corpus=own, protocol=protocol, rewards=rewards, **changes)
    recipe = replace(SMALL, verifier=verifier, mask=verifier == "both", empty_starts=0.25)
    trained(tmp_path, recipe=recipe, settings=settings)
    agent = open_agent(tmp_path, "cpu")
    env = parallel_env(protocol=protocol, rewards=rewards, corpus=own, split="dev", **changes)
    players = [*map(agent.partner, Role)]
    batched = measure(env, *players)
    single = measure(env, *(lambda turn, one=one: one(turn) for one in players))
    assert batched == single
    with pytest.raises(AgentError, match="lilgym-mp evaluate"):
        agent.policy(Settings("TowerFlipIt"))
    with pytest.raises(AgentError, match=f"trained on protocol '{protocol}'"):
        measure(parallel_env(protocol="audit" if protocol != "audit" else "veto", split="dev"), *players)


@pytest.mark.long
@pytest.mark.parametrize("protocol", ["joint", "critique"])
def test_claims__are_of_the_scene_that_was_judged(tmp_path, own, protocol, monkeypatch):
    found = []
    play = RolloutPlayer.play
    monkeypatch.setattr(RolloutPlayer, "play", lambda self, *args: found.append(play(self, *args)) or found[-1])
    settings = GameSettings(corpus=own, protocol=protocol)
    trained(tmp_path, recipe=replace(SMALL, rollout=512, verifier="both"), settings=settings)
    programs = {task.statement: task.program for task in load_tasks(own, "tower", "flipit", "train")}
    claims, statements = found[0].claims, found[0].statements
    assert len(claims.items) > 20
    for items, statement, target, holds in zip(*claims, strict=True):
        assert (compile_program(programs[statements[statement]])(scene_of(items)) == bool(target)) == holds


# Runs on disk


@pytest.mark.long
def test_train__reports_each_rollout_and_is_reproducible_by_seed(tmp_path):
    heard = []
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        trained(tmp_path / name, recipe=replace(SMALL, seed=seed), on_progress=heard.append)
    assert [progress.steps for progress in heard] == [64, 128] * 3
    recorded = read_json_lines(tmp_path / "a" / "progress.jsonl")
    assert [line["steps"] for line in recorded] == [64, 128]
    assert equal(tmp_path / "a", tmp_path / "b")
    assert not equal(tmp_path / "a", tmp_path / "c")


@pytest.mark.long
def test_resume__gives_the_same_agents_as_an_uninterrupted_run(tmp_path):
    trained(tmp_path / "whole", 128, INDEPENDENT)
    with pytest.raises(KeyboardInterrupt):
        trained(tmp_path / "cut", 128, INDEPENDENT, on_progress=interrupt_at_64_steps)
    details = open_agent(tmp_path / "cut").description.details
    assert (details["steps"], details["interrupted"]) == (64, True)
    assert lilgym("train game --resume --out", tmp_path / "cut") == 0  # to the steps it was begun with
    assert equal(tmp_path / "whole", tmp_path / "cut")


# Partners and warm starts


@pytest.mark.long
def test_train__a_partner_from_a_run_keeps_its_weights_and_the_other_agent_learns(tmp_path):
    trained(tmp_path / "both")
    before = weights(tmp_path / "both")
    alone = trained(tmp_path / "alone", proposers=[tmp_path / "both"], start_from=tmp_path / "both")
    assert alone.partner(Role.PROPOSER) is None
    assert set(alone.networks) == {Role.VERIFIER}
    assert equal(before, tmp_path / "both")
    with pytest.raises(AgentError, match="no trained proposer_0"):
        trained(tmp_path / "third", proposers=[tmp_path / "alone"])
    veto = GameSettings(protocol="veto")
    trained(tmp_path / "scripted", settings=veto, verifiers=[Path("always-accept")])
    identity = read_json(tmp_path / "scripted" / "run.json")["identity"]
    assert identity["partners"] == {"verifier": ["always-accept"]}
    assert resumed(tmp_path / "scripted", "game", LEARNER, {}, {}, {})[2].verifiers == [Path("always-accept")]
    with pytest.raises(AgentError, match="trained on protocol 'joint'; this game has 'veto'"):
        trained(tmp_path / "fourth", settings=veto, proposers=[tmp_path / "both"])
    with pytest.raises(ValueError, match="no agent is left to learn"):
        trained(tmp_path / "fifth", proposers=[tmp_path / "both"], verifiers=[tmp_path / "both"])


def test_train__starts_with_the_weights_of_a_single_agent_run(tmp_path):
    agent = train_ppo(Settings("TowerScratch"), SMALL_PPO, tmp_path / "single", steps=32, device="cpu")
    wide = replace(SMALL, width=112)
    run = GameRun(JOINT, wide, tmp_path / "game", steps=64, start_from=tmp_path / "single", device="cpu")
    own = run.networks["shared"].state_dict()
    assert all(torch.equal(tensor, own[name]) for name, tensor in agent.network.state_dict().items())
    with pytest.raises(ValueError, match="the agents to start from have width 112, not 16"):
        GameRun(JOINT, SMALL, tmp_path / "other", steps=64, start_from=Path("ppo-tower"), device="cpu")


# Invalid input


@pytest.mark.long
def test_resume__rejects_other_games_and_damaged_checkpoints(tmp_path):
    trained(tmp_path / "run")
    with pytest.raises(TrainingRunError, match="has protocol joint, but veto was requested"):
        resumed(tmp_path / "run", "game", LEARNER, {"protocol": "veto"}, {}, {})
    copy = shutil.copytree(tmp_path / "run", tmp_path / "copy")
    state = torch.load(copy / "checkpoint.pt", weights_only=True)
    torch.save({**state, "networks": {}}, copy / "checkpoint.pt")
    with pytest.raises(TrainingRunError, match="not a checkpoint of this run"):
        trained(copy, 256, resume=True)


# The command


SMALL_RUN = "--envs 8 --same-statement 2 --rollout 64 --batch-size 64 --no-recolour --steps 64"


@pytest.mark.long
def test_command__trains_with_rewards_as_json_and_against_a_run(tmp_path, capsys):
    rewards = json.dumps({"proposer_0": {"hidden": 1, "mdp": 0.2}, "verifier_0": "correctness"})
    audit = f"train game TowerScratch --protocol audit --rewards '{rewards}' --seed 3 {SMALL_RUN} --out"
    shown = output_of(capsys, audit, tmp_path / "audit")
    assert "proposer_0 and verifier_0 learn" in shown
    assert "lilgym-mp evaluate" in shown
    assert load_agent(tmp_path / "audit" / "agent.safetensors").recipe.seed == 3
    succeeds(audit, tmp_path / "against", "--verifiers", tmp_path / "audit")
    assert load_agent(tmp_path / "against" / "agent.safetensors").partner(Role.VERIFIER) is None


@pytest.mark.parametrize(
    ("wrong", "error"),
    {
        "--minutes 0": "minutes must be above 0, not 0",
        "--rewards {": "--rewards: not valid JSON",
        "--rewards none": "unknown rewards 'none'; choose from",
        "--proposers nowhere": "no trained agent at",
    }.items(),
)
def test_command__wrong_options_are_reported(wrong, error, tmp_path, capsys):
    command = f"train game TowerFlipIt --protocol joint {SMALL_RUN} {wrong} --out"
    assert error in error_of(capsys, command, tmp_path / "bad")
    assert not (tmp_path / "bad").exists()
