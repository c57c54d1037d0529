"""Imitation runs: training, resuming, saving and loading."""

import signal
from dataclasses import replace

import numpy as np
import pytest
import torch

from lilgym_mp.evaluation import Observations, evaluate
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


def train(settings, out, updates=110):
    return train_imitation(settings, small_recipe(settings), out, updates=updates)


@pytest.mark.long
def test_training__solves_three_statements_in_seconds(settings, tmp_path):
    agent = train(settings, tmp_path)
    assert accuracy(agent, settings) == 1
    assert progress_lines(tmp_path)[-1]["truth_accuracy"] > 0.85


@pytest.mark.long
def test_resume__continues_interrupted_pretraining(settings, tmp_path, monkeypatch):
    settings = replace(settings, configuration="ScatterFlipIt")
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
        train_imitation(settings, recipe, tmp_path, updates=40)
    agent = train_imitation(settings, recipe, tmp_path, updates=40, resume=True)
    assert learnt[8:] == pytest.approx([place / 16 for place in range(8, 16)])
    assert agent.description.details["updates"] == 40


@pytest.mark.long
def test_training__with_random_labels_learns_nothing(settings, tmp_path, monkeypatch):
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
    assert accuracy(train(settings, tmp_path), settings) < 0.7


@pytest.mark.parametrize("name", ["TowerScratch", "ScatterFlipIt"])
@pytest.mark.long
def test_training__saved_agent_plays_like_the_trained_one_and_equal_seeds_give_equal_agents(name, settings, tmp_path):
    settings = replace(settings, configuration=name)
    agent = train(settings, tmp_path / "run", 4)
    loaded = open_agent(tmp_path / "run", "cpu")
    assert loaded.description == agent.description
    assert evaluate(loaded.policy(settings), settings, "dev") == evaluate(agent.policy(settings), settings, "dev")
    train(settings, tmp_path / "again", 4)
    assert equal(tmp_path / "run", tmp_path / "again")


@pytest.mark.long
def test_resume__continues_a_killed_run(settings, tmp_path):
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
def test_resume__with_more_updates_neither_pretrains_again_nor_has_negative_rates(settings, tmp_path, monkeypatch):
    recipe = small_recipe(settings, pretraining=0.5)
    train_imitation(settings, recipe, tmp_path, updates=4)
    rates = []
    monkeypatch.setattr(TextPretraining, "step", None)
    monkeypatch.setattr(training, "optimise", lambda *given, **parts: rates.append(given[3]))
    train_imitation(settings, recipe, tmp_path, updates=12, resume=True)
    assert len(rates) == 8
    assert min(rates) >= 0


def test_policy__handles_odd_statements_and_stops_where_it_cannot_read_the_image(settings, tmp_path):
    agent = train(settings, tmp_path, 1)
    said = ("", "zxqv", "blue " * 10_000, "blue")
    images = np.stack([draw(Scene.empty(), "half")] * 4)
    images[3] = 7
    seen = Observations(images, said, np.ones(4, np.int64), np.zeros(4, np.int64), np.arange(4))
    chosen = agent.policy(settings)(seen, np.zeros((4, 0), np.bool_), np.random.default_rng(0))
    assert all(0 < action < 13 for action in chosen[:3])
    assert chosen[3] == 0


@pytest.mark.parametrize(("capability", "dtype"), [("AVX512", torch.bfloat16), ("AVX2", torch.float32)])
def test_precision__is_reduced_only_where_that_is_faster(capability, dtype, monkeypatch):
    monkeypatch.setattr(torch.backends.cpu, "get_cpu_capability", lambda: capability)
    with precision(torch.device("cpu")):
        assert (torch.ones(2, 2) @ torch.ones(2, 2)).dtype == dtype
