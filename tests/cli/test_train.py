"""`lilgym-mp train`, `evaluate` and `demo` as a person meets them. A few dozen steps each."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image

from lilgym_mp.cli import USAGE_ERROR, main
from lilgym_mp.cli.demo import PASSES, next_free
from lilgym_mp.evaluation import Settings
from tests.own_corpus import write_own_corpus

LilGym = Callable[..., str]
SMALL = ["--envs", "2", "--rollout", "32", "--batch-size", "16", "--epochs", "1"]


@pytest.fixture(autouse=True)
def _one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """The processors of a test machine are busy."""
    import torch

    torch.set_num_threads(1)
    monkeypatch.setenv("OMP_NUM_THREADS", "1")


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """A small corpus of our own."""
    return write_own_corpus(tmp_path / "own.jsonl")


@pytest.fixture
def lilgym(capsys: pytest.CaptureFixture[str]) -> LilGym:
    """Runs a command line, which must succeed; gives what it prints on standard output."""

    def run(*words: object) -> str:
        assert main([str(word) for word in words]) == 0
        return capsys.readouterr().out

    return run


def trained(lilgym: LilGym, place: Path, *options: str) -> str:
    return lilgym("train", "TowerScratch", "--out", place, "--steps", 64, *SMALL, *options)


def test_train__says_where_everything_is(lilgym: LilGym, tmp_path: Path, own: Path):
    said = trained(lilgym, tmp_path / "run", "--stop-forcing", "--recolour", "--corpus", str(own))
    assert f"TowerScratch, corpus {own}, 4 training tasks; 64 steps" in said
    assert f"tensorboard --logdir {tmp_path / 'run' / 'tensorboard'}" in said
    assert f"saved {tmp_path / 'run' / 'checkpoint.pt'} after 64 steps" in said
    assert f"lilgym-mp evaluate {tmp_path / 'run'}" in said


def test_train__takes_the_recipe_from_the_command_line(lilgym: LilGym, tmp_path: Path):
    trained(lilgym, tmp_path, "--no-anneal", "--learning-rate", "0.003", "--seed", "4", "--rules", "release")
    written = json.loads((tmp_path / "run.json").read_text())
    assert written["environment"]["rules"] == "release"
    assert written["recipe"]["rollout"] == 32
    assert written["recipe"]["learning_rate"] == 0.003
    assert (written["recipe"]["anneal"], written["recipe"]["seed"]) == (False, 4)


def test_train__resumes_with_no_more_than_the_directory(lilgym: LilGym, tmp_path: Path):
    trained(lilgym, tmp_path)
    said = lilgym("train", "--resume", "--out", tmp_path, "--steps", 128)
    assert "128 steps, after 64 before" in said
    assert "after 128 steps" in said


def test_train__resuming_another_configuration_is_refused_naming_both(
    lilgym: LilGym, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    trained(lilgym, tmp_path)
    before = (tmp_path / "checkpoint.pt").read_bytes()
    assert main(["train", "TowerFlipIt", "--resume", "--out", str(tmp_path)]) == USAGE_ERROR
    assert "has configuration TowerScratch, but TowerFlipIt was asked for" in capsys.readouterr().err
    assert (tmp_path / "checkpoint.pt").read_bytes() == before


def test_train__progress_is_told_in_lines_where_there_is_no_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert main(["train", "TowerScratch", "--out", str(tmp_path), "--steps", "640", *SMALL]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 10
    assert lines[-1].startswith("640 of 640 steps, ")


@pytest.mark.parametrize("backend", ["batched", "subproc"])
def test_train__ctrl_c_saves_says_where_and_leaves_nothing_running(tmp_path: Path, backend: str):
    """Ctrl-C in a terminal goes to the whole process group, the environments' processes included."""
    place = tmp_path / "run"
    program = "import sys; from lilgym_mp.cli import main\nif __name__ == '__main__': sys.exit(main())"
    (tmp_path / "main.py").write_text(program)
    command = [sys.executable, tmp_path / "main.py", "train", "TowerScratch", "--out", place, "--steps", "100000000"]
    with subprocess.Popen(
        [*command, *SMALL, "--backend", backend],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        while process.poll() is None and not (place / "progress.jsonl").exists():
            time.sleep(0.05)
        os.killpg(process.pid, signal.SIGINT)
        said, faults = process.communicate(timeout=120)
    assert "Traceback" not in faults
    assert process.returncode == 130, faults
    assert f"saved {place / 'checkpoint.pt'}" in said
    assert f"go on with: lilgym-mp train --resume --out {place}" in said
    assert ends(process.pid)


def ends(group: int, seconds: float = 30.0) -> bool:
    """Whether the last process of the group ends within the time."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.05)
    return False


def test_evaluate__tells_of_the_agent_beside_random_play(lilgym: LilGym, tmp_path: Path, own: Path):
    trained(lilgym, tmp_path, "--recolour", "--corpus", str(own))
    said = lilgym("evaluate", tmp_path)
    rows = [line.split("|") for line in said.splitlines() if line.startswith("|")]
    assert [row[1].strip() for row in rows[2:]] == ["trained agent", "random legal", "random unmasked"]
    assert [row[2].strip() for row in rows[2:]] == ["3", "3", "3"]
    assert "of 2" in rows[2][4]  # something yellow, and what recolouring made of something black: something blue
    assert "of 1" in rows[2][5]
    written = json.loads((tmp_path / "evaluation-dev.json").read_text())
    agent = written["trials"]["evaluation"]["policies"]["trained agent"]
    assert agent["steps"] == 64
    assert agent["trained_with"]["recipe"]["recolour"] is True
    assert len(agent["checkpoint_sha256"]) == 64
    assert [episode["task_id"] for episode in agent["episodes"]] == [
        *("tower-dev-has-yellow", "tower-dev-has-blue", "tower-dev-count"),
    ]


def test_evaluate__gives_the_same_again(lilgym: LilGym, tmp_path: Path):
    trained(lilgym, tmp_path / "run")
    for name in ("one.json", "two.json"):
        lilgym("evaluate", tmp_path / "run", "--sampled", "--seed", 3, "--split", "test", "--out", tmp_path / name)
    one, two = (json.loads((tmp_path / name).read_text())["trials"] for name in ("one.json", "two.json"))
    assert one == two


def test_evaluate__under_another_configuration_is_refused_naming_both(
    lilgym: LilGym, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    trained(lilgym, tmp_path)
    assert main(["evaluate", str(tmp_path), "--configuration", "ScatterScratch"]) == USAGE_ERROR
    assert "has configuration TowerScratch, but ScatterScratch was asked for" in capsys.readouterr().err


def test_evaluate__other_rules_are_allowed_and_told(lilgym: LilGym, tmp_path: Path):
    trained(lilgym, tmp_path)
    assert "rules release" in lilgym("evaluate", tmp_path, "--rules", "release")


def test_demo__leaves_results_films_and_the_agent(lilgym: LilGym, tmp_path: Path):
    place = tmp_path / "demo"
    said = lilgym("demo", "--out", place, "--steps", 2048)
    for name in ("results.json", "results.md", "rollouts.gif", "agent"):
        assert str(place / name) in said
        assert (place / name).exists()
    rows = [line for line in (place / "results.md").read_text().splitlines() if line.startswith("|")]
    assert [row.split("|")[1].strip() for row in rows[2:]] == [
        *("untrained agent", "trained agent", "random legal", "random unmasked"),
    ]
    policies = json.loads((place / "results.json").read_text())["trials"]["demo"]["policies"]
    tasks = Settings("TowerScratch").make("dev").evaluation_tasks()
    for policy in policies.values():
        assert [episode["task_id"] for episode in policy["episodes"]] == [*tasks] * PASSES
    with Image.open(place / "rollouts.gif") as film:
        assert getattr(film, "n_frames", 1) > 1


def test_demo__a_second_one_takes_another_directory(tmp_path: Path):
    assert next_free(tmp_path / "demo") == tmp_path / "demo"
    (tmp_path / "demo").mkdir()
    (tmp_path / "demo-2").mkdir()
    assert next_free(tmp_path / "demo") == tmp_path / "demo-3"
