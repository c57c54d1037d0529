"""Runs of the reward model: what is learnt from, counting, resuming, files."""

import re
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lilgym_mp.learning import reward_model
from lilgym_mp.learning.common.agents import AgentError, open_agent
from lilgym_mp.learning.common.labelled_scenes import Collector, LabelledStatement, entries_of
from lilgym_mp.learning.common.model_file import ModelFileError, save_model
from lilgym_mp.learning.common.run_directory import AGENT_FILE, TrainingRunError
from lilgym_mp.learning.reward_model import training
from lilgym_mp.learning.reward_model.features import BoxTable
from lilgym_mp.learning.reward_model.training import train_reward_model
from lilgym_mp.scene import Scene
from tests.learning.conftest import accuracy, counted_stops, equal
from tests.learning.reward_model.conftest import small_recipe


def train(settings, out, updates, **changes):
    return train_reward_model(settings, small_recipe(settings, **changes), out, updates=updates)


@pytest.mark.long
@pytest.mark.parametrize("name", ["TowerFlipIt", "ScatterFlipIt"])
def test_training__solves_three_statements_in_seconds(settings, tmp_path, name):
    settings = replace(settings, configuration=name)
    agent = train(settings, tmp_path, 110)
    assert accuracy(agent, settings) == 1
    assert accuracy(agent, replace(settings, configuration=name.replace("FlipIt", "Scratch"))) == 1


@pytest.fixture
def scatter(settings):
    return replace(settings, configuration="ScatterFlipIt")


def labelled_entry(settings, stops):
    entry = entries_of([settings.make("train").tasks])[0]
    collector = Collector(settings.dynamics(), BoxTable(settings.appearance), np.random.default_rng(1))
    collector.explore(entry, stops)
    return entry, collector


@pytest.mark.parametrize("name", ["TowerFlipIt", pytest.param("ScatterFlipIt", marks=pytest.mark.long)])
def test_training__reads_truths_only_from_counted_stops(settings, tmp_path, name):
    settings = replace(settings, configuration=name)
    settings.make("train")
    with counted_stops() as stops:
        agent = train_reward_model(settings, small_recipe(settings, reuse=1), tmp_path, updates=6)
    assert agent.description.details["stops"] == len(stops)
    assert agent.description.details["steps"] == sum(stops)


def test_package__imports_neither_programs_nor_the_expert():
    sources = [file.read_text() for file in Path(reward_model.__file__).parent.glob("*.py")]
    found = {*re.findall(r"lilgym_mp\.(?:programs|solver)[\w.]*|lilgym_mp import.*", "".join(sources))}
    assert found <= {f"lilgym_mp.{name}" for name in ("programs.task", "solver.edit_tables", "solver.canonical_items")}


@pytest.mark.parametrize("name", ["TowerScratch", "ScatterScratch"])
def test_climb__stops_in_the_edits_that_the_model_likes_best_for_a_truth_value(settings, name):
    entry, collector = labelled_entry(replace(settings, configuration=name), 5)
    rng, liked = np.random.default_rng(2), set[Scene]()

    def judge(scenes):
        logits = rng.normal(size=(len(scenes), len(scenes[0])))
        for row, found in zip(logits, scenes, strict=True):
            liked.update((found[row.argmin()], found[row.argmax()]))
        return logits

    before = len(entry.scenes)
    collector.climb([entry], judge)
    starts = {entry.tasks[path.task].start for path in entry.paths}
    after = {collector.table.scene(boxes) for boxes in entry.scenes[before:]}
    assert after - starts
    assert after <= liked | starts


def test_collector__stops_by_the_shortest_way_from_any_start(settings):
    _, collector = labelled_entry(settings, 60)
    tasks = sorted(settings.make("train").tasks, key=lambda task: len(list(task.start.items())))
    entry, before = LabelledStatement("new", tasks[:3]), collector.steps
    scene = tasks[2].start
    path = entry.paths[collector.stop(entry, 0, scene, 5)]
    assert (entry.tasks[path.task].start, path.edits) == (scene, 0)
    assert collector.steps == before + 1


@pytest.mark.long
def test_equal_arguments__train_equal_agents(scatter, tmp_path):
    for name in ("one", "other"):
        train(scatter, tmp_path / name, 3, reuse=1, searching=1.0)
    assert equal(tmp_path / "one", tmp_path / "other")


def test_training__survives_a_search_that_begins_a_new_box_table(scatter, tmp_path, monkeypatch):
    monkeypatch.setattr("lilgym_mp.learning.reward_model.features.MOST_BOXES", 50)
    agent = train(scatter, tmp_path, 2, reuse=1, searching=1.0)
    assert agent.description.details["labels"] == 2 * 3 * 32


@pytest.mark.long
def test_interrupted_run__is_resumed(settings, tmp_path, monkeypatch):
    step = training.RewardModelRun.step
    done = []

    def interrupted(run):
        done.append(1)
        if len(done) == 8:
            signal.raise_signal(signal.SIGINT)
        return step(run)

    recipe, out = small_recipe(settings), tmp_path / "run"
    with monkeypatch.context() as patched:
        patched.setattr(training.RewardModelRun, "step", interrupted)
        with pytest.raises(KeyboardInterrupt):
            train_reward_model(settings, recipe, out, updates=20)
    before, collected = len(done), []
    monkeypatch.setattr(training.RewardModelRun, "_collect_more", lambda run: collected.append(run.counters.updates))
    agent = train_reward_model(settings, recipe, out, updates=20, resume=True)
    assert agent.description.details["labels"] == 20 * 3 * 32
    assert collected == [*range(before, 20)], "as the scenes collected before are lost"
    with pytest.raises(TrainingRunError, match="seed 0, but 1"):
        train_reward_model(settings, recipe, out, updates=20, seed=1, resume=True)
    with pytest.raises(ValueError, match="its search runs on the CPU: choose device auto or cpu"):
        train_reward_model(settings, recipe, tmp_path / "other", updates=20, device="cuda")


def test_budget_spent_before_the_first_step__saves_no_agent(settings, tmp_path):
    with pytest.raises(TrainingRunError, match="1e-05 minutes were spent before the first update"):
        train_reward_model(settings, small_recipe(settings), tmp_path, minutes=1e-5)
    assert not (tmp_path / AGENT_FILE).exists()


def test_agent_file__is_loaded_and_named_in_faults(settings, tmp_path):
    agent = train(replace(settings, configuration="TowerScratch"), tmp_path / "run", 3)
    loaded = open_agent(tmp_path / "run")
    assert loaded.description == agent.description
    assert loaded.description.supervision.startswith("rewards; knows the rules of editing")
    with pytest.raises(AgentError, match="does not play TowerFlipIt"):
        loaded.policy(settings)
    broken = replace(agent.description, details={"vocabulary": 3})
    save_model(tmp_path / "broken.safetensors", broken, agent.network.state_dict())
    with pytest.raises(ModelFileError, match=r"broken\.safetensors: its description cannot be used"):
        open_agent(tmp_path / "broken.safetensors")
