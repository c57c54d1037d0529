"""`lilgym-mp play` in the two-agent game and `lilgym-mp explain --program`."""

from __future__ import annotations

import io
import sys

import pytest

from lilgym_mp.cli import USAGE_ERROR, main
from lilgym_mp.envs.proposer_verifier.protocols import PROTOCOLS

pytest.importorskip("pettingzoo", reason="needs the extra pettingzoo")

TASK = ["--split", "dev", "--task", "tower-dev-001"]  # "I can see a blue block."


@pytest.fixture
def run_with_input(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    """Plays with lines of input and returns the output."""

    def play(lines: str, *words: str) -> str:
        monkeypatch.setattr(sys, "stdin", io.StringIO(lines))
        assert main(["play", *words]) == 0
        return capsys.readouterr().out

    return play


def test_play_game__as_proposer_with_the_oracle(run_with_input):
    shown = run_with_input("add(left, blue)\nSTOP\n", "--protocol", "veto", *TASK)
    assert "verifier_0: accept" in shown
    assert shown.splitlines()[-1] == "success; proposer_0 +0.9, verifier_0 +0.9"


def test_play_game__explains_invalid_input(run_with_input):
    shown = run_with_input("nonsense\nREMOVE(LEFT)\nlegal\nquit\n", "--protocol", "veto", *TASK)
    assert "'nonsense' is not an action of proposer_0" in shown
    assert "STOP, ADD(LEFT, YELLOW)" in shown
    assert shown.splitlines()[-1] == "quit before the end of the game"


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_play_game__as_verifier_in_every_protocol(protocol: str, run_with_input):
    lines = "accept\ncontinue\n" * 30 + "quit\n"
    shown = run_with_input(lines, "--as", "verifier", "--protocol", protocol, "--seed", "0")
    assert "proposer_0: " in shown


def test_play_game__rejects_unknown_partners(capsys: pytest.CaptureFixture[str]):
    assert main(["play", "--partner", "nobody"]) == USAGE_ERROR
    assert "unknown partner 'nobody'; choose from " in capsys.readouterr().err


def test_explain_program__shows_truth_and_satisfying_items(capsys: pytest.CaptureFixture[str]):
    assert (
        main(["explain", "--program", "exist(filter_obj(all_items, lambda x: is_blue(x)))", "--task", "tower-dev-001"])
        == 0
    )
    shown = capsys.readouterr().out
    assert '"I can see a blue block."' in shown
    assert "= False" in shown
    assert "satisfied by none of 0" in shown


@pytest.mark.parametrize("source", ["exist(filter_obj(all_items, lambda x: is_blue(x)))", "exist(all_items)"])
def test_explain_program__draws_scenes_where_the_program_holds_and_where_it_fails(
    source: str, capsys: pytest.CaptureFixture[str]
):
    assert main(["explain", "--program", source, "--configuration", "ScatterScratch"]) == 0
    output = capsys.readouterr().out
    assert output.index("true in this scene") < output.index("= True") < output.index("false in this scene")
    assert "= False" in output


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["exists(all_items)", "--task", "tower-dev-001"], "did you mean exist?"),
        (["--task", "tower-dev-1"], "no task 'tower-dev-1' in corpus 'builtin'; tasks include tower-dev-"),
    ],
)
def test_explain_program__reports_errors_in_one_line(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
):
    assert main(["explain", "--program", *words]) == USAGE_ERROR
    assert message in capsys.readouterr().err
