"""Imitation runs: training, resuming, saving and loading."""

import signal

import numpy as np
import pytest
import torch

from lilgym_mp.evaluation import Observations, Settings, evaluate
from lilgym_mp.learning.common.agents import open_agent
from lilgym_mp.learning.common.model_file import precision
from lilgym_mp.learning.common.run_directory import AGENT_FILE
from lilgym_mp.learning.imitation import training
from lilgym_mp.learning.imitation.dataset import DataCollector
from lilgym_mp.learning.imitation.pretraining import TextPretraining
from lilgym_mp.learning.imitation.training import train_imitation
from lilgym_mp.scene import Scene
from lilgym_mp.scene.render import draw
from tests.learning.conftest import accuracy, equal
from tests.learning.imitation.conftest import progress_lines, small_recipe

UPDATES = 110


def train(statements, name, out, updates=UPDATES, **changes):
    settings = Settings(name, corpus=statements)
    return train_imitation(settings, small_recipe(settings, **changes), out, updates=updates), settings


@pytest.mark.long
def test_training__solves_three_statements_in_seconds(statements, tmp_path):
    agent, settings = train(statements, "TowerFlipIt", tmp_path / "run")
    assert accuracy(agent, settings) == 1
    assert progress_lines(tmp_path / "run")[-1]["truth_accuracy"] > 0.85


@pytest.mark.long
def test_resume__continues_interrupted_pretraining(statements, tmp_path, monkeypatch):
    settings = Settings("ScatterFlipIt", corpus=statements)
    recipe = small_recipe(settings, pretraining=0.4)
    learnt = []
    step = TextPretraining.step

    def interrupted(pretraining, done):
        learnt.append(done)
        if len(learnt) == 8:
            signal.raise_signal(signal.SIGINT)
        return step(pretraining, done)

    monkeypatch.setattr(TextPretraining, "step", interrupted)
    with pytest.raises(KeyboardInterrupt):
        train_imitation(settings, recipe, tmp_path / "run", updates=40)
    agent = train_imitation(settings, recipe, tmp_path / "run", updates=40, resume=True)
    assert learnt[8:] == pytest.approx([place / 16 for place in range(8, 16)])
    assert agent.description.details["updates"] == 40


@pytest.mark.long
def test_training__with_random_labels_learns_nothing(statements, tmp_path, monkeypatch):
    add = DataCollector.add

    def shuffled(collector, entry, scene, *, solve):
        known = len(entry.scenes)
        index = add(collector, entry, scene, solve=solve)
        if index == known:  # a label independent of the scene's content
            entry.truths[index] = bool(hash(tuple(entry.scenes[index])) & 64)
        if entry.actions[index] is not None:
            entry.actions[index] = collector.heads.recoloured[0][1 + (index * 7) % 12 :][:1]
        return index

    monkeypatch.setattr(DataCollector, "add", shuffled)
    agent, settings = train(statements, "TowerFlipIt", tmp_path / "run")
    assert accuracy(agent, settings) < 0.7


@pytest.mark.parametrize("name", ["TowerScratch", "ScatterFlipIt"])
def test_training__saved_agent_plays_like_the_trained_one_and_equal_seeds_give_equal_agents(name, statements, tmp_path):
    agent, settings = train(statements, name, tmp_path / "run", updates=4)
    loaded = open_agent(tmp_path / "run", "cpu")
    assert loaded.description == agent.description
    assert evaluate(loaded.policy(settings), settings, "dev") == evaluate(agent.policy(settings), settings, "dev")
    train(statements, name, tmp_path / "again", updates=4)
    assert equal(tmp_path / "run", tmp_path / "again")


@pytest.mark.long
def test_resume__continues_a_killed_run(statements, tmp_path):
    settings = Settings("TowerFlipIt", corpus=statements)
    recipe = small_recipe(settings)

    def killed(progress):
        signal.raise_signal(signal.SIGTERM)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lilgym_mp.learning.common.run.REPORT_SECONDS", 0.0)
        with pytest.raises(KeyboardInterrupt):
            train_imitation(settings, recipe, tmp_path, updates=20, on_progress=killed)
    assert not (tmp_path / AGENT_FILE).exists()
    agent = train_imitation(settings, recipe, tmp_path, updates=20, resume=True)
    assert agent.description.details["updates"] == 20
    assert [line["updates"] for line in progress_lines(tmp_path)] == [1, 20]


@pytest.mark.long
def test_resume__with_more_updates_neither_pretrains_again_nor_has_negative_rates(statements, tmp_path, monkeypatch):
    settings = Settings("TowerFlipIt", corpus=statements)
    recipe = small_recipe(settings, pretraining=0.5)
    train_imitation(settings, recipe, tmp_path, updates=4)
    rates = []
    monkeypatch.setattr(TextPretraining, "step", None)
    monkeypatch.setattr(training, "optimise", lambda *given, **parts: rates.append(given[3]))
    train_imitation(settings, recipe, tmp_path, updates=12, resume=True)
    assert len(rates) == 8
    assert min(rates) >= 0


def test_policy__handles_unknown_empty_and_very_long_statements(statements, tmp_path):
    agent, settings = train(statements, "TowerFlipIt", tmp_path, updates=1)
    said = ("", "zxqv", "blue " * 10_000)
    images = np.stack([draw(Scene.empty(), "half")] * 3)
    seen = Observations(images, said, np.ones(3, np.int64), np.zeros(3, np.int64), np.arange(3))
    chosen = agent.policy(settings)(seen, np.zeros((3, 0), np.bool_), np.random.default_rng(0))
    assert ((chosen >= 0) & (chosen < 13)).all()


@pytest.mark.parametrize(("capability", "dtype"), [("AVX512", torch.bfloat16), ("AVX2", torch.float32)])
def test_precision__is_reduced_only_where_that_is_faster(capability, dtype, monkeypatch):
    monkeypatch.setattr(torch.backends.cpu, "get_cpu_capability", lambda: capability)
    with precision(torch.device("cpu")):
        assert (torch.ones(2, 2) @ torch.ones(2, 2)).dtype == dtype
