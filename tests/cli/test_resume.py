"""`lilgym-mp train LEARNER --resume --out DIR`: a run goes on as it was begun, without repeating its options."""

import os
import signal

import pytest

from lilgym_mp.evaluation import Settings
from lilgym_mp.learning.common.agents import open_agent
from lilgym_mp.learning.common.run_directory import begin_run
from lilgym_mp.learning.ppo.learner import PPORecipe
from lilgym_mp.learning.ppo.training import train_ppo
from tests.command_line import error_of
from tests.json_files import read_json

PPO = {"envs": 2, "same_statement": 1, "rollout": 32, "batch_size": 16, "epochs": 1}


def interrupt(progress):
    """Ctrl-C."""
    os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.long
def test_ppo__interrupted_after_its_last_rollout_is_finished_by_resuming(own, tmp_path):
    settings, recipe = Settings("TowerScratch", corpus=own), PPORecipe.of("TowerScratch", **PPO)
    with pytest.raises(KeyboardInterrupt):
        train_ppo(settings, recipe, tmp_path, steps=32, device="cpu", on_progress=interrupt)
    assert open_agent(tmp_path).description.details["interrupted"]
    train_ppo(settings, recipe, tmp_path, steps=32, device="cpu", resume=True)
    assert not open_agent(tmp_path).description.details["interrupted"]
    train_ppo(settings, recipe, tmp_path, steps=64, device="cpu", resume=True)
    assert read_json(tmp_path / "run.json")["options"]["steps"] == 64, "a budget given again is kept"


@pytest.mark.parametrize("learner", ["ppo", "imitation"])
def test_resume__rejects_a_run_of_another_learner(learner, tmp_path, capsys):
    begin_run(tmp_path, {"learner": "other"})
    assert f"has learner other, but {learner} was requested" in error_of(
        capsys, f"train {learner} --resume --out", tmp_path
    )
