"""`lilgym-mp train LEARNER --resume --out DIR`: a run goes on as it was begun, without repeating its options."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import pytest

from lilgym_mp.cli import USAGE_ERROR
from lilgym_mp.evaluation import Settings
from lilgym_mp.learning.common.agents import open_agent
from lilgym_mp.learning.common.run_directory import begin_run
from lilgym_mp.learning.ppo.learner import PPORecipe
from lilgym_mp.learning.ppo.training import train_ppo
from tests.command_line import lilgym
from tests.corpora import write_own_corpus

PPO = {"envs": 2, "same_statement": 1, "rollout": 32, "batch_size": 16, "epochs": 1}


@pytest.fixture
def own(tmp_path: Path) -> str:
    return str(write_own_corpus(tmp_path / "own.jsonl"))


def interrupt(progress: object) -> None:
    """Ctrl-C."""
    os.kill(os.getpid(), signal.SIGINT)


def test_ppo__goes_on_to_the_steps_it_was_begun_with(own: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    recipe = PPORecipe.of("TowerScratch", seed=3, **PPO)
    settings = Settings("TowerScratch", corpus=own, horizon=7)
    with pytest.raises(KeyboardInterrupt):
        train_ppo(settings, recipe, tmp_path / "run", steps=96, device="cpu", on_progress=interrupt)
    assert lilgym("train ppo --resume --out", tmp_path / "run") == 0
    assert "96 steps, resumed after 32" in capsys.readouterr().out
    assert open_agent(tmp_path / "run").description.details["steps"] == 96
    assert lilgym("train ppo --resume --out", tmp_path / "run") == USAGE_ERROR
    assert "already has 96 steps; request more with --steps" in capsys.readouterr().err


def test_ppo__interrupted_after_its_last_rollout_is_finished_by_resuming(own: str, tmp_path: Path):
    settings, recipe = Settings("TowerScratch", corpus=own), PPORecipe.of("TowerScratch", **PPO)
    with pytest.raises(KeyboardInterrupt):
        train_ppo(settings, recipe, tmp_path, steps=32, device="cpu", on_progress=interrupt)
    assert open_agent(tmp_path).description.details["interrupted"]
    train_ppo(settings, recipe, tmp_path, steps=32, device="cpu", resume=True)
    assert not open_agent(tmp_path).description.details["interrupted"]
    train_ppo(settings, recipe, tmp_path, steps=64, device="cpu", resume=True)
    assert json.loads((tmp_path / "run.json").read_text())["options"]["steps"] == 64, "a budget given again is kept"


@pytest.mark.parametrize("learner", ["ppo", "imitation"])
def test_resume__rejects_a_run_of_another_learner(learner: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    begin_run(tmp_path, {"learner": "other"})
    assert lilgym(f"train {learner} --resume --out", tmp_path) == USAGE_ERROR
    assert f"has learner other, but {learner} was requested" in capsys.readouterr().err
