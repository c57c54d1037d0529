"""`lilgym-mp solve` and `lilgym-mp demos`."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path

import numpy as np
import pytest

from lilgym_mp.cli import main
from lilgym_mp.solver import Solution, Solver
from lilgym_mp.task import Task

Captured = pytest.CaptureFixture[str]


def test_solve__tells_shares_and_writes_solutions(tmp_path: Path, capsys: Captured):
    out = tmp_path / "solutions.json"
    assert main(["solve", "TowerFlipIt", "--limit", "12", "--jobs", "1", "--replay", "--out", str(out)]) == 0
    told = capsys.readouterr()
    assert "corpus builtin, rules paper, horizon 12, grid 19x5" in told.out
    assert "| TowerFlipIt dev | 12 | 12 (100.00 %) | 12 |" in told.out
    assert "TowerFlipIt dev: 12 of 12 solutions succeed in the environment" in told.out
    assert "12 of 12 tasks of TowerFlipIt dev" in told.err
    data = json.loads(out.read_text())
    assert data["summaries"]["TowerFlipIt dev"]["solved"] == 12
    assert {record["status"] for record in data["tasks"]} == {"solved"}


def test_solve__lists_what_has_no_solution(capsys: Captured):
    assert main(["solve", "TowerScratch", "--horizon", "1", "--limit", "4", "--jobs", "1"]) == 0
    assert "unsolvable, no scene within 0 edits has that value" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--budget", "0"], "budget must be a positive whole number of scenes"),
        (["--jobs", "0"], "jobs must be at least 1, not 0"),
        (["--limit", "0"], "--limit must be at least 1, not 0"),
        (["--horizon", "0"], "horizon must be a positive whole number"),
        (["--corpus", "nowhere.jsonl"], "nowhere.jsonl"),
        (["Sideways"], "unknown configuration 'Sideways'"),
    ],
)
def test_solve__names_the_mistake(options: list[str], message: str, capsys: Captured):
    assert main(["solve", *options]) == 2
    told = capsys.readouterr()
    assert message in told.err
    assert told.out == ""


def test_demos__are_the_same_from_one_process_and_from_two(tmp_path: Path, capsys: Captured):
    for jobs in ("1", "2"):
        place = str(tmp_path / f"{jobs}.npz")
        assert main(["demos", "ScatterScratch", "--episodes", "7", "--seed", "3", "--jobs", jobs, "--out", place]) == 0
    assert "7 demonstrations of" in capsys.readouterr().out
    assert (tmp_path / "1.npz").read_bytes() == (tmp_path / "2.npz").read_bytes()
    with np.load(tmp_path / "1.npz") as read:
        assert len(read["statement"]) == 7
        assert json.loads(str(read["about"]))["settings"]["configuration"] == "ScatterScratch"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "say where to write"),
        (["--out", "demos.txt"], "must name a file that ends in .npz"),
        (["--out", "demos.npz", "--episodes", "0"], "--episodes must be at least 1"),
        (["--out", "demos.npz", "--seed", "-1"], "--seed must be at least 0"),
    ],
)
def test_demos__name_the_mistake(
    options: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Captured
):
    monkeypatch.chdir(tmp_path)
    assert main(["demos", "TowerFlipIt", *options]) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_demos__leave_nothing_when_the_disk_is_full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Captured):
    def fail(path: Path, *_: object) -> None:
        path.write_bytes(b"some")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("lilgym_mp.cli.demos.write_npz", fail)
    place = tmp_path / "demos.npz"
    assert main(["demos", "TowerScratch", "--jobs", "1", "--out", str(place)]) == 2
    assert f"cannot write {place}: No space left on device" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_solve__says_that_a_process_was_ended(monkeypatch: pytest.MonkeyPatch, capsys: Captured):
    monkeypatch.setattr("lilgym_mp.solver.reports.Solver", _EndsItsProcess)
    assert main(["solve", "TowerScratch", "--jobs", "2"]) == 2
    assert "a process was ended from outside" in capsys.readouterr().err


class _EndsItsProcess(Solver):
    def solve(self, task: Task) -> Solution:
        os._exit(1)


def test_demos__say_what_minari_needs(monkeypatch: pytest.MonkeyPatch, capsys: Captured):
    monkeypatch.setattr("lilgym_mp.cli.demos.find_spec", lambda name: None)
    assert main(["demos", "TowerFlipIt", "--minari", "lilgym/own-v0"]) == 2
    assert 'pip install "lilgym-mp[minari]"' in capsys.readouterr().err
