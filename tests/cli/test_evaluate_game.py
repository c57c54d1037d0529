"""`lilgym-mp evaluate` of the two-agent game."""

import csv
import json
from dataclasses import replace

import pytest

from lilgym_mp.envs.proposer_verifier import SCRIPTED, GameSettings, Role
from lilgym_mp.evaluation import Settings, random_legal
from lilgym_mp.evaluation.game_partners import SCRIPTED_VERIFIERS
from lilgym_mp.learning.common.agents import Agent
from lilgym_mp.learning.common.run_directory import FORMAT, VERSION
from tests.command_line import error_of, succeeds
from tests.json_files import read_json


class Trained(Agent):
    """A trained agent of the game, as `open_agent` gives it."""

    game = None

    def __init__(self, corpus, protocol="audit"):
        self.game = GameSettings(corpus=corpus, protocol=protocol)

    def policy(self, settings, *, sampled=False):
        raise NotImplementedError

    def partner(self, role, game, *, sampled=False):
        return SCRIPTED["by_intent" if role is Role.PROPOSER else "oracle"]


class Single(Agent):
    """A trained agent of the single-agent environment that says on which settings it was trained, as PPO's does."""

    settings = Settings("TowerScratch")

    def policy(self, settings, *, sampled=False):
        return random_legal


def results(directory, arguments):
    """What `lilgym-mp evaluate ARGUMENTS` writes in the directory, by proposer and verifier."""
    succeeds(f"evaluate {arguments} --force --out", directory / "results.json")
    found = read_json(directory / "results.json")["results"]
    return {(entry["proposer"], entry["verifier"]): entry for entry in found}


@pytest.fixture
def runs(monkeypatch):
    """Runs by path, to be filled in by the test."""
    trained = {}
    monkeypatch.setattr("lilgym_mp.learning.common.agents.open_agent", lambda path, device: trained[str(path)])
    return trained


def test_without_runs__scripted_partners_play_each_other(tmp_path, own, capsys):
    found = results(tmp_path, f"--protocol audit --configuration TowerScratch --corpus {own}")
    assert len(found) == 5 * len(SCRIPTED_VERIFIERS)
    lie = found["expert-deceptive", "always-accept"]
    assert lie["success"] == 0.0
    assert lie["accepted_false_claims"] > 0.9
    assert lie["by_target"] == {
        "true": {"games": 3, "success_rate": 0.0, "true_accept_rate": None, "false_accept_rate": 1.0, "j": None}
    }
    assert found["random", "target-only"]["j"] == 0.0
    assert found["helpful", "oracle"]["configuration"] == "TowerScratch"
    assert f"TowerScratch, audit, dev, corpus {own}" in capsys.readouterr().out


def test_cross_play__is_also_a_table_with_a_remark_on_pairs_that_learned_for_other_rewards(tmp_path, own, runs):
    runs.update(a=Trained(own), b=Trained(own))
    runs["b"].game = replace(runs["b"].game, rewards="hidden")
    written = results(tmp_path, "a b --cross-play")
    assert len(written) == (2 + 5) * (2 + len(SCRIPTED_VERIFIERS))
    with (tmp_path / "results.csv").open(newline="") as table:
        rows = {(row["proposer"], row["verifier"]): row for row in csv.DictReader(table)}
    assert rows.keys() == written.keys()
    row, found = rows["a", "b"], written["a", "b"]
    assert float(row["success"]) == found["success"]
    assert [float(row[f"success_interval_{end}"]) for end in ("low", "high")] == found["success_interval"]
    assert row["remark"] == found["remark"] == "trained with other rewards"
    assert rows["a", "a"]["remark"] == rows["a", "oracle"]["remark"] == ""


@pytest.mark.parametrize("single", [False, True])
def test_run__plays_with_its_own_other_side_an_oracle_and_the_baseline(tmp_path, own, runs, single):
    runs["a"] = Single() if single else Trained(own)
    game = f"--protocol audit --configuration TowerScratch --corpus {own}" if single else ""
    pairs = {("a", "a"), ("a", "oracle"), ("a", "target-only"), ("expert", "a"), ("expert-deceptive", "a")}
    assert results(tmp_path, f"a {game}").keys() == pairs


def test_run__plays_the_requested_configurations(tmp_path, own, runs):
    runs["a"] = Trained(own)  # on TowerScratch
    succeeds("evaluate a --configuration TowerFlipIt TowerScratch --out", tmp_path / "results.json")
    entries = read_json(tmp_path / "results.json")["results"]
    assert list(dict.fromkeys(entry["configuration"] for entry in entries)) == ["TowerFlipIt", "TowerScratch"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("audit veto", "audit and veto play different games: protocol 'audit' and 'veto'"),
        ("audit --protocol veto", "audit was trained for audit; leave --protocol out"),
        ("guided critique", "and {'proposer_0': 0, 'verifier_0': 4}"),
        ("guided --views guide", "guided sees what it learned with; leave --views out"),
        ("--protocol vote", "invalid choice: 'vote' (choose from "),
        ("--protocol veto --configuration Towers", "unknown configuration 'Towers'"),
        ("--protocol veto --passes 3", "--passes is for the single-agent environment"),
        ("--cross-play --seed -1", "seed"),
    ],
)
def test_what_cannot_be_played__is_one_line(arguments, message, runs, capsys):
    runs |= {protocol: Trained("builtin", protocol) for protocol in ("audit", "veto", "critique")}
    runs["guided"] = Trained("builtin")
    runs["guided"].game = GameSettings(protocol="critique", views="guide")
    (line,) = error_of(capsys, f"evaluate {arguments}").splitlines()
    assert message in line


@pytest.mark.long
def test_scripted_guide__plays_where_there_is_a_message_for_each_action(tmp_path, own):
    game = f"--protocol critique --configuration TowerScratch --corpus {own}"
    assert not [pair for pair in results(tmp_path, game) if "guide" in pair or "builder" in pair]
    for messages, success in ((None, 1.0), ("silenced", 0.0)):
        silence = f"--messages {messages}" if messages else ""
        found = results(tmp_path, f"{game} --views guide {silence}")["builder", "guide"]
        assert (found["success"], found["messages"]) == (success, messages)


def test_actions__are_greedy_sampled_or_both(tmp_path, own, runs):
    asked = []

    class Sampled(Trained):
        def partner(self, role, game, *, sampled=False):
            asked.append(sampled)
            return super().partner(role, game)

    runs["a"] = Sampled(own)
    succeeds("evaluate a --actions greedy sampled --out", tmp_path / "results.json")
    assert asked == [False, False, True, True]
    entries = read_json(tmp_path / "results.json")["results"]
    assert [entry["actions"] for entry in entries][::5] == ["greedy", "sampled"]


def test_report__plays_the_pairs_of_game_runs_in_its_paths(tmp_path, own, runs):
    for name, protocol in (("a", "audit"), ("b", "veto")):
        directory = tmp_path / "runs" / name
        directory.mkdir(parents=True)
        run = {"format": FORMAT, "version": VERSION, "identity": {"learner": "game"}, "made": {}}
        (directory / "run.json").write_text(json.dumps(run))
        (directory / "agent.safetensors").touch()
        runs[str(directory)] = Trained(own, protocol)
    succeeds(f"report {tmp_path / 'runs'} --out", tmp_path / "report")
    (matrix,) = (tmp_path / "report" / "tables").glob("*success*audit*.csv")
    with matrix.open(newline="") as table:
        rows = {row["proposer"]: row for row in csv.DictReader(table)}
    run = str(tmp_path / "runs" / "a")
    assert rows[run]["oracle low"] != ""
    assert rows["expert"][f"{run} mean"] != ""
    assert len(list((tmp_path / "report" / "tables").glob("*.csv"))) == 2  # a matrix for each game
