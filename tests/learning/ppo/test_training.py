"""PPO runs: training, saving, resuming, validation, tasks and invalid input."""

import json
import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from statistics import fmean
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from lilgym_mp.cli.training import resumed
from lilgym_mp.corpus import load_tasks
from lilgym_mp.evaluation import Settings, evaluate
from lilgym_mp.evaluation.files import OutputError
from lilgym_mp.learning.common.agents import AgentError, open_agent
from lilgym_mp.learning.common.factored_policy import FactoredPolicy
from lilgym_mp.learning.common.run_directory import AGENT_FILE, TrainingRunError, begin_run
from lilgym_mp.learning.common.tasks import TaskSampler, training_tasks
from lilgym_mp.learning.ppo import validation
from lilgym_mp.learning.ppo.agent import make_model
from lilgym_mp.learning.ppo.learner import LEARNER, PPOOptions, PPORecipe
from lilgym_mp.learning.ppo.learning_curve import LearningCurve
from lilgym_mp.learning.ppo.rollout import RolloutCollector
from lilgym_mp.learning.ppo.training import train_ppo
from lilgym_mp.scene.appearances import Tower
from tests.corpora import write_own_corpus, write_three_statements
from tests.json_files import read_json, read_json_lines
from tests.learning.conftest import SMALL_PPO as SMALL
from tests.learning.conftest import equal, interrupt_at_64_steps, weights

TOWER = Settings("TowerScratch")

NLVR = replace(SMALL, nlvr_reward=True)


def trained(path, steps=64, recipe=SMALL, settings=TOWER, **options):
    return train_ppo(settings, recipe, path, steps=steps, device="cpu", **options)


@pytest.fixture(scope="module")
def begun_run(tmp_path_factory):
    """A run of 32 steps; read-only."""
    place = tmp_path_factory.mktemp("begun") / "run"
    trained(place, 32)
    return place


@pytest.fixture
def begun(begun_run, tmp_path):
    """A copy of that run."""
    return shutil.copytree(begun_run, tmp_path / "run")


@pytest.fixture
def flipit(own):
    return Settings("TowerFlipIt", corpus=own)


# Learning


def accuracy(path, corpus):
    """Accuracy on a corpus after 5,120 steps on it."""
    recipe = replace(
        SMALL, envs=32, rollout=256, batch_size=128, epochs=2, learning_rate=2e-3, stop_forcing=True, entropy=0.05
    )
    settings = Settings("TowerScratch", corpus=corpus)
    agent = trained(path, 5_120, recipe, settings)
    episodes = evaluate(agent.policy(settings, sampled=True), settings, "dev", passes=20)
    return fmean(episode.is_success for episode in episodes)


@pytest.mark.long
def test_train__solves_three_statements(tmp_path, three):
    assert accuracy(tmp_path, three) > 0.85


@pytest.mark.long
def test_train__does_not_solve_three_statements_with_shuffled_rewards(tmp_path, three, monkeypatch):
    play = RolloutCollector.collect

    def shuffled(self, *args):
        found = play(self, *args)
        mixed = np.random.default_rng(0).permutation(found.rewards.reshape(-1)).reshape(found.rewards.shape)
        return found._replace(rewards=mixed)

    monkeypatch.setattr(RolloutCollector, "collect", shuffled)
    assert accuracy(tmp_path, three) < 0.6


# Runs on disk


def test_train__reports_and_records_each_rollout(tmp_path):
    heard = []
    agent = trained(tmp_path, 80, on_progress=heard.append)
    assert [progress.steps for progress in heard] == [32, 64, 96]
    files = {path.name for path in tmp_path.iterdir()}
    assert files == {"run.json", "checkpoint.pt", "progress.jsonl", "agent.safetensors"}
    assert [line["steps"] for line in read_json_lines(tmp_path / "progress.jsonl")] == [32, 64, 96]
    assert sum(heard[-1].outcomes.values()) == pytest.approx(1)
    details = agent.description.details
    assert (details["steps"], details["episodes"], details["mask"]) == (96, heard[-1].episodes, False)
    assert agent.description.supervision == "rewards alone (corpus builtin); no mask of legal actions"
    with pytest.raises(TrainingRunError, match="already has 96 steps; request more"):
        trained(tmp_path, 96, resume=True)


@pytest.mark.long
def test_resume__cuts_progress_back_to_the_checkpoint_of_a_killed_run(begun):
    identity, progress = read_json(begun / "run.json"), begun / "progress.jsonl"
    (begun / "run.json").write_text(json.dumps({**identity, "finished": False}))
    with progress.open("a") as file:
        file.write('{"steps": 64, "note": "after the checkpoint"}\n{"steps": 9')
    trained(begun, 64, resume=True)
    assert [line["steps"] for line in read_json_lines(progress)] == [32, 64]


@pytest.mark.long
def test_resume__of_a_finished_run_says_that_the_learning_rate_rises_again(begun):
    said = []
    trained(begun, 64, resume=True, say=said.append)
    assert said[0] == f"{begun} had finished; over the larger budget its learning rate rises again"


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"same_statement": 2, "recolour": True, "stop_forcing": True, "held_out": 0.3},
    ],
)
@pytest.mark.long
def test_resume__gives_the_same_agent_as_an_uninterrupted_run(tmp_path, flipit, changes):
    recipe = replace(SMALL, validate_every=32, **changes)
    trained(tmp_path / "whole", 128, recipe, flipit)
    with pytest.raises(KeyboardInterrupt):
        trained(tmp_path / "cut", 128, recipe, flipit, on_progress=interrupt_at_64_steps)
    details = open_agent(tmp_path / "cut", "cpu").description.details
    assert (details["steps"], details["interrupted"]) == (64, True)
    trained(tmp_path / "cut", 128, recipe, flipit, resume=True)
    assert equal(tmp_path / "whole", tmp_path / "cut")
    whole, resumed = (read_json_lines(tmp_path / name / "progress.jsonl") for name in ("whole", "cut"))
    for line in (*whole, *resumed):
        del line["cpu_seconds"], line["steps_per_second"]
    assert whole == resumed


@pytest.mark.long
def test_train__works_outside_the_main_thread(tmp_path):
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(trained, tmp_path, 32).result().description.details["steps"] == 32


@pytest.mark.long
def test_train__evaluates_on_dev_at_the_start_periodically_and_at_the_end(tmp_path, own):
    settings = Settings("TowerScratch", corpus=own)
    agent = trained(tmp_path / "curve", 112, settings=settings, evaluate_every=64)
    points = read_json_lines(tmp_path / "curve" / "evaluations.jsonl")
    assert [point["steps"] for point in points] == [0, 64, 128]
    episodes = evaluate(agent.policy(settings, sampled=True), settings, "dev", seed=SMALL.seed)
    assert points[-1]["accuracy"] == fmean(episode.is_success for episode in episodes)
    trained(tmp_path / "plain", 112, settings=settings)
    assert equal(tmp_path / "curve", tmp_path / "plain")  # training is unaffected


def test_learning_curve__image_accuracy_counts_only_scenes_of_the_corpus(own, flipit, tmp_path):
    def adds(count):
        blue_left, stop = 3, 0
        return lambda seen, legal, rng: np.where(seen.steps < count, blue_left, stop)

    run = begin_run(tmp_path, {})
    curve = LearningCurve(Settings("TowerScratch", corpus=own), SMALL, 1, run)
    one, two = (curve.evaluation(adds(count), 0) for count in (1, 2))
    # Of "something yellow", "something blue" and two items, the corpus has one blue block for the second.
    assert (one.start_scenes_with_image, one.image_accuracy, one.accuracy_with_image) == (3, 1 / 3, 1 / 3)
    assert (two.image_accuracy, two.accuracy) == (0, 2 / 3)
    assert LearningCurve(flipit, SMALL, 1, run).evaluation(adds(1), 0).image_accuracy is None


@pytest.mark.long
def test_train__keeps_the_best_validated_weights_and_stops_by_patience(tmp_path, own, flipit, monkeypatch):
    shares = iter([0.2, 0.6, 0.6, 0.1, 0.9])
    kept = []

    def played(policy, settings, split, **options):
        assert split == "train"
        assert {*options["task_ids"]} <= {*load_tasks(own, "tower", "flipit", "train").ids}
        kept.append({name: tensor.clone() for name, tensor in policy._model.state_dict().items()})
        share = next(shares)
        return [SimpleNamespace(is_success=index < 10 * share) for index in range(10)]

    monkeypatch.setattr(validation, "evaluate", played)
    recipe = replace(SMALL, held_out=0.3, validate_every=32, patience=2)
    agent = trained(tmp_path, 320, recipe, flipit)
    details = agent.description.details
    assert (details["steps"], details["validation_steps"], details["validation_accuracy"]) == (128, 64, 0.6)
    assert equal(tmp_path, kept[1])
    assert [line["best_steps"] for line in read_json_lines(tmp_path / "validations.jsonl")] == [32, 64, 64, 64]


def test_tasks__held_out_statements_are_in_no_training_task(own, flipit):
    tasks = training_tasks(flipit, PPORecipe.of("TowerFlipIt", held_out=0.34))
    train = load_tasks(own, "tower", "flipit", "train")
    held_out = {train.by_id(name).statement for name in tasks.validation}
    assert len(held_out) == 1
    assert not held_out & set(tasks.statements)
    assert {task.id.split("#")[0].removeprefix("empty:") for task in tasks.tasks}.isdisjoint(tasks.validation)


def test_tasks__of_ours_include_recoloured_and_empty_starts(flipit):
    tasks = training_tasks(flipit, PPORecipe.of("TowerFlipIt", held_out=0))
    assert "There is something blue." in tasks.statements  # of yellow and black ones
    empty = [task for task, begins in zip(tasks.tasks, tasks.from_empty, strict=True) if begins]
    assert empty
    assert all(task.target and not any(task.start.items()) for task in empty)
    for task in tasks.tasks:
        assert tasks.from_empty[tasks.tasks.index_of(task.id)] or not task.solved_by(task.start)


def test_tasks__of_the_paper_are_the_corpus_sampled_uniformly_or_in_groups_of_one_statement(own, flipit):
    tasks = training_tasks(flipit, PPORecipe.of("TowerFlipIt", "paper", held_out=0))
    assert list(tasks.tasks) == list(load_tasks(own, "tower", "flipit", "train"))
    rng = np.random.default_rng(0)
    sampler = TaskSampler(tasks, replace(SMALL, envs=4))
    counts = np.bincount([task for _ in range(2_000) for task in sampler.sample(np.arange(4), rng)])
    assert counts.min() > 0.85 * counts.mean()
    sampler = TaskSampler(tasks, replace(SMALL, envs=8, same_statement=4))
    sampler.resample_statements(rng)
    statements = sampler.statement_of[sampler.sample(np.arange(8), rng)]
    assert len(set(statements[:4].tolist())) == len(set(statements[4:].tolist())) == 1


def test_train__nlvr_reward_drops_tasks_without_a_matching_scene(tmp_path, own):
    settings = Settings("TowerScratch", corpus=own)
    tasks = training_tasks(settings, NLVR, matching=True)
    task = tasks.tasks.by_id("tower-train-has-yellow")
    yellow_on_the_left = next(iter(load_tasks(own, "tower", "flipit", "train"))).start
    assert (task.truth(yellow_on_the_left), task.solved_by(yellow_on_the_left)) == (True, True)
    in_the_middle = yellow_on_the_left.permuted((1, 0, 2))
    assert (task.truth(in_the_middle), task.solved_by(in_the_middle)) == (True, False)
    trained(tmp_path, 64, replace(NLVR, stop_forcing=True), settings)


# Rollouts


def test_collect__forces_successful_stops_with_the_unforced_policys_probability(flipit):
    recipe = replace(SMALL, envs=16, rollout=256, stop_forcing=True)
    tasks = training_tasks(flipit, recipe)
    torch.manual_seed(0)
    model = make_model(recipe, Tower(), statements=tasks.statements)
    rng = np.random.default_rng(0)
    collector = RolloutCollector(flipit, recipe, tasks)
    collector.reset(rng)
    rollout = collector.collect(model, rng)
    assert 0 < rollout.forced.sum() < rollout.forced.size
    assert (rollout.actions[rollout.forced] == 0).all()
    assert (rollout.rewards[rollout.forced] == 1).all()
    assert rollout.ended[rollout.forced].all()
    assert not (rollout.rewards[~rollout.forced] == 1).any()
    with torch.no_grad():
        found = model(rollout.states(np.arange(rollout.actions.size)))
    unforced = FactoredPolicy(model.factorisation, found.types, found.heads).type_log_probs[:, 0].numpy()
    wanted = unforced.reshape(rollout.actions.shape)[rollout.forced]
    np.testing.assert_allclose(rollout.log_probabilities[rollout.forced], wanted, atol=1e-5, rtol=1e-4)
    collector.close()


@pytest.mark.parametrize("mask", [False, True])
@pytest.mark.long
def test_train__masks_only_if_the_recipe_does_and_the_description_states_it(tmp_path, mask):
    agent = trained(tmp_path, 64, replace(SMALL, mask=mask))
    assert agent.policy(TOWER).needs_masks is mask
    said = "illegal actions masked in training and in play" if mask else "no mask of legal actions"
    assert said in agent.description.supervision
    outcomes = [line["outcomes"].get("invalid_action", 0) for line in read_json_lines(tmp_path / "progress.jsonl")]
    assert (max(outcomes) == 0) is mask


@pytest.mark.parametrize(
    ("recipe_name", "configuration"),
    [
        ("ours", "TowerFlipIt"),
        ("paper", "ScatterFlipIt"),
        ("release", "ScatterScratch"),
    ],
)
def test_train__every_recipe_and_configuration_gives_an_agent(tmp_path, own, recipe_name, configuration):
    short = {"rollout": 16, "batch_size": 16, "epochs": 1, "envs": 2, "same_statement": 1, "held_out": 0.0}
    recipe = PPORecipe.of(configuration, recipe_name, stop_forcing=True, patience=0, **short)
    settings = Settings(configuration, corpus=own, horizon=2)
    trained(tmp_path, 16, recipe, settings, recipe_name=recipe_name)
    agent = open_agent(tmp_path, "cpu")
    assert len(agent.description.configurations) == 1 + (recipe_name == "ours" and configuration.endswith("FlipIt"))
    for name in agent.description.configurations:
        played = replace(settings, configuration=name)
        for sampled in (False, True):
            assert evaluate(agent.policy(played, sampled=sampled), played, "dev")
    with pytest.raises(AgentError, match="was trained on the grid"):
        agent.policy(replace(settings, grid=(38, 10)))


@pytest.mark.long
def test_train__accumulated_gradient_equals_the_full_one(tmp_path):
    for name, size in (("whole", 0), ("parts", 5)):
        trained(tmp_path / name, 32, replace(SMALL, microbatch=size))
    one, other = weights(tmp_path / "whole"), weights(tmp_path / "parts")
    for name in one:
        torch.testing.assert_close(one[name], other[name], atol=2e-3, rtol=0)


# Invalid input


@pytest.mark.parametrize(
    ("required", "error"),
    [
        ({"environment": {"configuration": "ScatterFlipIt"}}, "has configuration TowerScratch, but ScatterFlipIt was"),
        ({"environment": {"rules": "release"}}, "has rules paper, but release was requested"),
        ({"recipe": {"learning_rate": 0.5}}, "has learning_rate 0.001, but 0.5 was requested"),
        ({"recipe": {"stop_forcing": True}}, "has stop_forcing off, but on was requested"),
        ({"recipe_name": "paper"}, "has recipe_name ours, but paper was requested"),
    ],
)
def test_resume__rejects_a_different_run_naming_both_values(begun_run, required, error):
    environment, recipe = required.pop("environment", {}), required.pop("recipe", {})
    with pytest.raises(TrainingRunError, match=error):
        resumed(begun_run, "ppo", LEARNER, environment, recipe, required)
    assert resumed(begun_run, "ppo", LEARNER, {}, {}, {}) == (TOWER, SMALL, PPOOptions(steps=32))


def test_resume__rejects_a_changed_corpus(tmp_path):
    corpus = write_own_corpus(tmp_path / "own.jsonl")
    settings = Settings("TowerScratch", corpus=str(corpus))
    trained(tmp_path / "run", 32, settings=settings)
    write_three_statements(corpus)
    with pytest.raises(TrainingRunError, match="has tasks_sha256"):
        trained(tmp_path / "run", 64, settings=settings, resume=True)


@pytest.mark.parametrize(
    ("part", "value"),
    [
        ("network", {}),
        ("network", {"value.bias": torch.tensor([float("nan")])}),
        ("optimiser", {}),
        ("counters", {"steps": 3, "luck": 1}),
        ("episodes", {"tasks": [0]}),
        ("random", "{}"),
    ],
)
@pytest.mark.long
def test_resume__rejects_a_checkpoint_of_another_run(begun, part, value):
    state = torch.load(begun / "checkpoint.pt", weights_only=True)
    torch.save({**state, part: value}, begun / "checkpoint.pt")
    with pytest.raises(TrainingRunError, match="not a checkpoint of this run"):
        trained(begun, 64, resume=True)


@pytest.mark.parametrize(
    ("invalid", "error"),
    [
        ({"settings": Settings("TowerScratch", corpus="nowhere")}, "nowhere"),
        ({"settings": Settings("TowerScratch", rules="house")}, "house"),
        ({"settings": Settings("ScatterScratch", grid="native")}, "1,064,001 actions"),
        ({"recipe": replace(SMALL, patience=2)}, "patience needs held-out statements"),
        ({"recipe": NLVR, "settings": Settings("TowerFlipIt")}, "requires Scratch tasks"),
    ],
)
def test_train__invalid_settings_create_no_directory(tmp_path, invalid, error):
    with pytest.raises(ValueError, match=error):
        trained(tmp_path / "run", **invalid)
    assert not (tmp_path / "run").exists()


def test_train__rejects_used_and_unwritable_directories(tmp_path, begun_run):
    with pytest.raises(TrainingRunError, match="already holds a run"):
        trained(begun_run, 32)
    (tmp_path / AGENT_FILE).write_bytes(b"of another run")
    with pytest.raises(TrainingRunError, match="already holds a run"):
        trained(tmp_path, 32)
    (tmp_path / "run.json").write_bytes((begun_run / "run.json").read_bytes())
    with pytest.raises(TrainingRunError, match="has an agent, but no checkpoint to continue from"):
        trained(tmp_path, 64, resume=True)
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot write results to"):
        trained(tmp_path / "file" / "run", 32)
