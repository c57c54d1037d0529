"""Short runs of the game's examples."""

from __future__ import annotations

import runpy
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[3] / "examples"

Run = Callable[..., str]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs an example and returns its output; skips the test if its extra is not installed."""

    def run_example(name: str, *arguments: str) -> str:
        monkeypatch.setattr(sys, "argv", [name, *arguments])
        monkeypatch.syspath_prepend(str(EXAMPLES))
        try:
            runpy.run_path(str(EXAMPLES / name), run_name="__main__")
        except SystemExit as left:
            if "SKIPPED" not in str(left.code):
                raise
            pytest.skip(str(left.code))
        return capsys.readouterr().out

    return run_example


def test_audit__trains_a_verifier_and_writes_its_curve(run: Run, tmp_path: Path):
    printed = run(
        "proposer_verifier_audit.py", "--steps", "32", "--rollout", "32", "--tasks", "20", "--out", str(tmp_path)
    )
    assert "always accepting" in printed
    assert "true accepts" in printed
    assert {path.name for path in tmp_path.iterdir()} == {"curve.csv", "curve.svg", "verifier.zip"}


def test_game_ppo__plays_and_reports(run: Run):
    header, last = run("game_ppo.py", "--steps", "4096").splitlines()
    assert header.split() == ["turns", "CPU", "s", "success"]
    assert last.split()[0] == "4,096"
    assert 0 <= float(last.split()[2]) <= 1


@pytest.mark.long
@pytest.mark.filterwarnings("default:The `render_mode` attribute is not defined:UserWarning")  # from SuperSuit
def test_supersuit__one_policy_for_both_agents_learns(run: Run):
    returns = [float(line.split()[-1]) for line in run("supersuit_ppo.py", "--steps", "24576").splitlines()]
    assert returns[-1] > returns[0] + 0.3
