"""`lilgym-mp evaluate` of the two-agent game."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from lilgym_mp.cli import main
from lilgym_mp.envs.proposer_verifier import SCRIPTED, GameSettings, Role
from lilgym_mp.evaluation import Settings, random_legal
from lilgym_mp.evaluation.game_partners import SCRIPTED_VERIFIERS
from lilgym_mp.learning.common.agents import Agent
from lilgym_mp.learning.common.run_directory import FORMAT, VERSION
from tests.corpora import write_own_corpus


class Trained(Agent):
    """A trained agent of the game, as `open_agent` gives it."""

    game: Any = None

    def __init__(self, corpus: str, protocol: str = "audit") -> None:
        self.game = GameSettings(corpus=corpus, protocol=protocol)

    def policy(self, settings: Settings, *, sampled: bool = False) -> Any:
        raise NotImplementedError

    def partner(self, role: Role, game: GameSettings, *, sampled: bool = False) -> Any:
        return SCRIPTED["by_intent" if role is Role.PROPOSER else "oracle"]


class Single(Agent):
    """A trained agent of the single-agent environment that says on which settings it was trained, as PPO's does."""

    settings = Settings("TowerScratch")

    def policy(self, settings: Settings, *, sampled: bool = False) -> Any:
        return random_legal


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A small corpus."""
    return str(write_own_corpus(tmp_path_factory.mktemp("corpus") / "own.jsonl"))


def results(file: Path) -> dict[tuple[str, str], dict[str, Any]]:
    """By proposer and verifier."""
    return {(entry["proposer"], entry["verifier"]): entry for entry in json.loads(file.read_text())["results"]}


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch) -> dict[str, Trained]:
    """Runs by path, to be filled in by the test."""
    trained: dict[str, Trained] = {}
    monkeypatch.setattr("lilgym_mp.learning.common.agents.open_agent", lambda path, device: trained[str(path)])
    return trained


def test_without_runs__scripted_partners_play_each_other(tmp_path: Path, own: str, capsys: pytest.CaptureFixture[str]):
    file = tmp_path / "results.json"
    game = ["--protocol", "audit", "--configuration", "TowerScratch", "--corpus", own]
    assert main(["evaluate", *game, "--out", str(file)]) == 0
    found = results(file)
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


def test_results__are_also_a_table_with_a_remark_on_pairs_that_learned_for_other_rewards(
    tmp_path: Path, own: str, runs: dict[str, Any]
):
    runs.update(a=Trained(own), b=Trained(own))
    runs["b"].game = replace(runs["b"].game, rewards="hidden")
    file = tmp_path / "results.json"
    assert main(["evaluate", "a", "b", "--cross-play", "--out", str(file)]) == 0
    with file.with_suffix(".csv").open(newline="") as table:
        rows = {(row["proposer"], row["verifier"]): row for row in csv.DictReader(table)}
    assert rows.keys() == results(file).keys()
    row, found = rows["a", "b"], results(file)["a", "b"]
    assert float(row["success"]) == found["success"]
    assert [float(row[f"success_interval_{end}"]) for end in ("low", "high")] == found["success_interval"]
    assert row["remark"] == found["remark"] == "trained with other rewards"
    assert rows["a", "a"]["remark"] == rows["a", "oracle"]["remark"] == ""


@pytest.mark.parametrize("single", [False, True])
def test_run__plays_with_its_own_other_side_an_oracle_and_the_baseline(
    tmp_path: Path, own: str, runs: dict[str, Any], single: bool
):
    runs["a"] = Single() if single else Trained(own)
    file = tmp_path / "results.json"
    game = ["--protocol", "audit", "--configuration", "TowerScratch", "--corpus", own] if single else []
    assert main(["evaluate", "a", *game, "--out", str(file)]) == 0
    pairs = {("a", "a"), ("a", "oracle"), ("a", "target-only"), ("expert", "a"), ("expert-deceptive", "a")}
    assert results(file).keys() == pairs


def test_run__plays_the_requested_configurations(tmp_path: Path, runs: dict[str, Any]):
    runs["a"] = Trained("builtin")  # on TowerScratch
    file = tmp_path / "results.json"
    names = ["TowerFlipIt", "TowerScratch"]
    assert main(["evaluate", "a", "--configuration", *names, "--out", str(file)]) == 0
    entries = json.loads(file.read_text())["results"]
    assert list(dict.fromkeys(entry["configuration"] for entry in entries)) == names


def test_cross_play__plays_every_proposer_with_every_verifier(tmp_path: Path, own: str, runs: dict[str, Trained]):
    runs |= {"a": Trained(own), "b": Trained(own)}
    file = tmp_path / "results.json"
    assert main(["evaluate", "a", "b", "--cross-play", "--out", str(file)]) == 0
    assert len(results(file)) == (2 + 5) * (2 + len(SCRIPTED_VERIFIERS))


def test_runs_of_different_games__are_refused(runs: dict[str, Trained], capsys: pytest.CaptureFixture[str]):
    runs |= {"a": Trained("builtin"), "b": Trained("builtin", "veto")}
    assert main(["evaluate", "a", "b"]) == 2
    assert "a and b play different games: protocol 'audit' and 'veto'" in capsys.readouterr().err
    assert main(["evaluate", "a", "--protocol", "veto"]) == 2
    assert "a was trained for audit; leave --protocol out" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere"], "no trained agent at nowhere"),
        (["--protocol", "vote"], "invalid choice: 'vote' (choose from "),
        (["--protocol", "veto", "--configuration", "Towers"], "unknown configuration 'Towers'"),
        (["--protocol", "veto", "--passes", "3"], "--passes is for the single-agent environment"),
        (["--cross-play", "--seed", "-1"], "seed"),
    ],
)
def test_bad_arguments__give_one_line(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]):
    assert main(["evaluate", *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert len(error.splitlines()) == 1


def test_scripted_guide__plays_where_there_is_a_message_for_each_action(tmp_path: Path, own: str):
    file = tmp_path / "results.json"
    game = [
        "evaluate",
        "--protocol",
        "critique",
        "--configuration",
        "TowerScratch",
        "--corpus",
        own,
        "--out",
        str(file),
    ]
    assert main(game) == 0
    assert not [pair for pair in results(file) if "guide" in pair or "builder" in pair]
    for messages, success in (([], 1.0), (["--messages", "silenced"], 0.0)):
        assert main([*game, "--force", "--views", "guide", *messages]) == 0
        assert results(file)["builder", "guide"]["success"] == success
        assert results(file)["builder", "guide"]["messages"] == (messages or [None])[-1]


def test_actions__are_greedy_sampled_or_both(tmp_path: Path, own: str, runs: dict[str, Any]):
    asked: list[bool] = []

    class Sampled(Trained):
        def partner(self, role: Role, game: GameSettings, *, sampled: bool = False) -> Any:
            asked.append(sampled)
            return super().partner(role, game)

    runs["a"] = Sampled(own)
    file = tmp_path / "results.json"
    assert main(["evaluate", "a", "--actions", "greedy", "sampled", "--out", str(file)]) == 0
    assert asked == [False, False, True, True]
    assert [entry["actions"] for entry in json.loads(file.read_text())["results"]][::5] == ["greedy", "sampled"]


def test_runs__that_saw_other_views_play_together(runs: dict[str, Any], capsys: pytest.CaptureFixture[str]):
    runs |= {"a": Trained("builtin", "critique"), "b": Trained("builtin", "critique")}
    runs["a"].game = GameSettings(protocol="critique", views="guide")
    assert main(["evaluate", "a", "b"]) == 2
    found = capsys.readouterr().err
    assert "message_size {'proposer_0': 0, 'verifier_0': 13} and {'proposer_0': 0, 'verifier_0': 4}" in found
    assert main(["evaluate", "a", "--views", "guide"]) == 2
    assert "a sees what it learned with; leave --views out" in capsys.readouterr().err


def test_report__plays_the_pairs_of_game_runs_in_its_paths(tmp_path: Path, own: str, runs: dict[str, Any]):
    for name, protocol in (("a", "audit"), ("b", "veto")):
        directory = tmp_path / "runs" / name
        directory.mkdir(parents=True)
        run = {"format": FORMAT, "version": VERSION, "identity": {"learner": "game"}, "made": {}}
        (directory / "run.json").write_text(json.dumps(run))
        (directory / "agent.safetensors").touch()
        runs[str(directory)] = Trained(own, protocol)
    assert main(["report", str(tmp_path / "runs"), "--out", str(tmp_path / "report")]) == 0
    (matrix,) = (tmp_path / "report" / "tables").glob("*success*audit*.csv")
    with matrix.open(newline="") as table:
        rows = {row["proposer"]: row for row in csv.DictReader(table)}
    run = str(tmp_path / "runs" / "a")
    assert rows[run]["oracle low"] != ""
    assert rows["expert"][f"{run} mean"] != ""
    assert len(list((tmp_path / "report" / "tables").glob("*.csv"))) == 2  # a matrix for each game
