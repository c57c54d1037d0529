"""Training runs: begun, saved, resumed, refused. A few dozen steps each."""

from __future__ import annotations

import json
import os
import signal
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from lilgym_mp.corpus import CorpusError, Vocabulary, load_tasks
from lilgym_mp.evaluation import Settings, evaluate
from lilgym_mp.evaluation.files import OutputError
from lilgym_mp.learning.dev_evaluation import DevEvaluator
from lilgym_mp.learning.environments import make_training_envs
from lilgym_mp.learning.recipe import Recipe
from lilgym_mp.learning.run_directory import RunError
from lilgym_mp.learning.training import Progress, Run, begin_run, open_run, train

TOWER = Settings("TowerScratch")
SMALL = Recipe(envs=2, rollout=32, batch_size=16, epochs=1)


def trained(path: Path, steps: int = 64, recipe: Recipe = SMALL, settings: Settings = TOWER, **options: Any) -> Run:
    return go_on(begin_run(path, settings, recipe), steps, **options)


def go_on(run: Run, steps: int, *, backend: str = "batched", save_every: int = 10_000, **options: Any) -> Run:
    return train(run, steps, backend=backend, save_every=save_every, **options)


def weights(run: Run) -> dict[str, torch.Tensor]:
    assert run.checkpoint is not None
    return run.checkpoint.network


def equal(one: dict[str, torch.Tensor], other: dict[str, torch.Tensor]) -> bool:
    return all(torch.equal(one[name], other[name]) for name in one)


def test_train__counts_saves_and_tells_of_each_update(tmp_path: Path):
    heard: list[Progress] = []
    run = trained(tmp_path / "run", 96, on_update=heard.append)
    assert [progress.steps for progress in heard] == [32, 64, 96]
    assert run.steps == 96
    assert run.checkpoint is not None
    assert run.checkpoint.episodes == heard[-1].episodes
    assert {path.name for path in (tmp_path / "run").iterdir()} == {
        *("run.json", "vocabulary.json", "checkpoint.pt", "progress.jsonl", "tensorboard"),
    }
    lines = [json.loads(line) for line in (tmp_path / "run" / "progress.jsonl").read_text().splitlines()]
    assert [line["steps"] for line in lines] == [32, 64, 96]
    for line in lines:
        assert not line["outcomes"] or sum(line["outcomes"].values()) == pytest.approx(1)
        assert line["outcomes"].get("invalid_action", 0) == 0
    assert any((tmp_path / "run" / "tensorboard").iterdir())


def test_train__the_same_seed_gives_the_same_agent_and_another_seed_another(tmp_path: Path):
    runs = [trained(tmp_path / str(number), recipe=Recipe(**{**SMALL.to_json(), "seed": seed})) for number, seed in
            enumerate([1, 1, 2])]  # fmt: skip
    assert equal(weights(runs[0]), weights(runs[1]))
    assert not equal(weights(runs[0]), weights(runs[2]))


@pytest.mark.parametrize("backend", ["dummy", "subproc", "workers"])
def test_train__every_backend_plays_the_same_episodes(tmp_path: Path, backend: str):
    other = go_on(begin_run(tmp_path / "other", TOWER, SMALL), 32, backend=backend)
    assert equal(weights(other), weights(trained(tmp_path / "batched", 32)))


def test_train__evaluates_on_dev_at_the_beginning_the_steps_asked_for_and_the_end(tmp_path: Path, own: str):
    settings = Settings("TowerScratch", corpus=own)
    run = trained(tmp_path / "curve", 112, settings=settings, evaluate_every=64)
    file = tmp_path / "curve" / "evaluations.jsonl"
    points = [json.loads(line) for line in file.read_text().splitlines()]
    assert [point["steps"] for point in points] == [0, 64, 128]
    policy = replace(run.agent(), greedy=False)
    episodes = evaluate(policy, settings, "dev", seed=SMALL.seed)
    assert points[-1]["start_scenes"] == len(episodes)
    assert points[-1]["accuracy"] == sum(episode.is_success for episode in episodes) / len(episodes)
    assert points[-1]["mean_reward"] == pytest.approx(sum(episode.reward for episode in episodes) / len(episodes))
    go_on(open_run(tmp_path / "curve", {}), 192, evaluate_every=64)
    assert [json.loads(line)["steps"] for line in file.read_text().splitlines()] == [0, 64, 128, 192]
    assert equal(weights(run), weights(trained(tmp_path / "plain", 112, settings=settings)))  # nothing else changes


def test_evaluator__counts_scenes_of_the_corpus_apart_from_scenes_in_which_the_program_is_as_wanted(own: str):
    def adds(count: int) -> Any:
        blue_left, stop = 3, 0
        return lambda seen, legal, rng: np.where(seen.steps < count, blue_left, stop)

    evaluator = DevEvaluator(Settings("TowerScratch", corpus=own), 0)
    one, two = (evaluator(adds(count), 0, 0.0) for count in (1, 2))
    # Of "something yellow", "something blue" and two items, the corpus has one blue block for the second.
    assert (one.start_scenes_with_image, one.image_accuracy, one.accuracy_with_image) == (3, 1 / 3, 1 / 3)
    assert (two.image_accuracy, two.accuracy) == (0, 2 / 3)
    assert DevEvaluator(Settings("TowerFlipIt", corpus=own), 0)(adds(1), 0, 0.0).image_accuracy is None


def rewards_of_a_yellow_block_in_the_middle(recipe: Recipe, corpus: str) -> list[float]:
    """Of STOP after adding it, in 16 environments: right by program for some statements, but no scene of the corpus."""
    settings = Settings("TowerScratch", corpus=corpus)
    add = settings.make("train").encode_action([1, 1, 0])
    words = Vocabulary.from_statements(task.statement for task in settings.make("train").tasks)
    envs = make_training_envs(settings, replace(recipe, envs=16), words, 8, corpus, "batched")
    envs.seed(0)
    envs.reset()
    envs.step(np.full(16, add))
    rewards = envs.step(np.zeros(16, np.int64))[1]
    envs.close()
    return rewards.tolist()


def test_train__with_the_nlvr_reward_wants_scenes_of_the_corpus(tmp_path: Path, own: str):
    matching = replace(SMALL, nlvr_reward=True)
    assert max(rewards_of_a_yellow_block_in_the_middle(SMALL, own)) == 1
    assert max(rewards_of_a_yellow_block_in_the_middle(matching, own)) == -1
    forced = replace(matching, stop_forcing=True)
    run = trained(tmp_path / "a", 64, forced, Settings("TowerScratch", corpus=own), backend="workers")
    assert run.steps == 64
    with pytest.raises(CorpusError, match="Scratch tasks only"):
        begin_run(tmp_path / "b", Settings("TowerFlipIt", corpus=own), matching)
    assert not (tmp_path / "b").exists()
    with pytest.raises(ValueError, match="nlvr-reward and recolour exclude each other"):
        replace(matching, recolour=True)


def test_resume__goes_on_from_the_checkpoint_and_its_counts(tmp_path: Path):
    first = trained(tmp_path, 64)
    heard: list[Progress] = []
    opened = open_run(tmp_path, {})
    assert equal(weights(opened), weights(first))
    second = go_on(opened, 128, on_update=heard.append)
    assert [progress.steps for progress in heard] == [96, 128]
    assert first.checkpoint is not None
    assert second.checkpoint is not None
    assert second.checkpoint.updates == 2 * first.checkpoint.updates
    assert second.checkpoint.episodes > first.checkpoint.episodes
    assert second.checkpoint.seconds > first.checkpoint.seconds
    lines = (tmp_path / "progress.jsonl").read_text().splitlines()
    assert [json.loads(line)["steps"] for line in lines] == [32, 64, 96, 128]


def test_resume__the_optimiser_goes_on_too(tmp_path: Path):
    first = trained(tmp_path, 64).checkpoint
    second = go_on(open_run(tmp_path, {}), 96).checkpoint
    assert first is not None
    assert second is not None
    assert [checkpoint.optimiser["state"][0]["step"].item() for checkpoint in (first, second)] == [4, 6]


def test_resume__a_run_that_has_its_steps_is_refused(tmp_path: Path):
    trained(tmp_path, 64)
    with pytest.raises(RunError, match="has 64 steps already; ask for more"):
        go_on(open_run(tmp_path, {}), 64)


@pytest.mark.parametrize(
    ("asked", "fault"),
    [
        ({"configuration": "ScatterFlipIt"}, "has configuration TowerScratch, but ScatterFlipIt was asked for"),
        ({"grid": (38, 10)}, "has grid 19x5, but 38x10 was asked for"),
        ({"rules": "release"}, "has rules paper, but release was asked for"),
        ({"learning_rate": 0.5}, "has learning-rate 0.002, but 0.5 was asked for"),
        ({"stop_forcing": True}, "has stop-forcing off, but on was asked for"),
    ],
)
def test_open__a_run_of_another_kind_is_refused_naming_both(tmp_path: Path, asked: dict[str, Any], fault: str):
    begin_run(tmp_path, TOWER, SMALL)
    with pytest.raises(RunError, match=fault):
        open_run(tmp_path, asked)


def test_open__a_corpus_that_changed_is_refused(tmp_path: Path):
    corpus = tmp_path / "own.jsonl"
    header = '{"format": "lilgym_mp-corpus", "version": 1, "name": "own", "licence": "MIT"}\n'
    entry = {"id": "a", "appearance": "tower", "split": "train", "statement": "One.", "starts": []}
    corpus.write_text(header + json.dumps({**entry, "program": "count(all_items) == 1"}))
    begin_run(tmp_path / "run", Settings("TowerScratch", corpus=str(corpus)), SMALL)
    corpus.write_text(header + json.dumps({**entry, "program": "ge(count(all_items), 1)"}))
    with pytest.raises(RunError, match=r"own\.jsonl is not the file that the run in .* was trained on"):
        open_run(tmp_path / "run", {})


def test_open__no_run_and_no_checkpoint_are_told_apart(tmp_path: Path):
    with pytest.raises(RunError, match=r"no training run in .*: it has no run\.json"):
        open_run(tmp_path, {})
    begin_run(tmp_path, TOWER, SMALL)
    with pytest.raises(RunError, match="no checkpoint in"):
        open_run(tmp_path, {})
    assert open_run(tmp_path, {}, untrained=True).steps == 0


@pytest.mark.parametrize("spoil", [lambda data: b"", lambda data: data[: len(data) // 2], lambda data: b"{}" * 400])
def test_open__a_damaged_checkpoint_is_refused_by_name(tmp_path: Path, spoil: Any):
    trained(tmp_path, 32)
    file = tmp_path / "checkpoint.pt"
    file.write_bytes(spoil(file.read_bytes()))
    with pytest.raises(RunError, match=r"checkpoint\.pt: damaged"):
        open_run(tmp_path, {})


@pytest.mark.parametrize("text", ["", "{}", '{"format": "lilgym_mp-run", "version": 99}'])
def test_open__a_damaged_description_is_refused_by_name(tmp_path: Path, text: str):
    begin_run(tmp_path, TOWER, SMALL)
    (tmp_path / "run.json").write_text(text)
    with pytest.raises(RunError, match=r"run\.json: cannot be used"):
        open_run(tmp_path, {})


def test_open__a_checkpoint_of_another_network_is_refused(tmp_path: Path):
    trained(tmp_path / "scatter", 32, settings=Settings("ScatterScratch"))
    tower = begin_run(tmp_path / "tower", TOWER, SMALL)
    tower.directory.checkpoint_file.write_bytes((tmp_path / "scatter" / "checkpoint.pt").read_bytes())
    with pytest.raises(RunError, match=r"checkpoint\.pt: not of the network that .*tower/run\.json describes"):
        open_run(tmp_path / "tower", {}).agent()


def test_begin__a_directory_with_a_run_is_refused(tmp_path: Path):
    begin_run(tmp_path, TOWER, SMALL)
    with pytest.raises(RunError, match="holds a training run already"):
        begin_run(tmp_path, TOWER, SMALL)


@pytest.mark.parametrize(
    "settings",
    [Settings("TowerScratch", corpus="nowhere"), Settings("TowerScratch", rules="house"),
     Settings("ScatterScratch", grid="native")],
)  # fmt: skip
def test_begin__what_cannot_be_trained_on_leaves_no_trace(tmp_path: Path, settings: Settings):
    with pytest.raises(ValueError, match=r"nowhere|house|1,064,001 actions"):
        begin_run(tmp_path / "run", settings, SMALL)
    assert not (tmp_path / "run").exists()


def test_begin__a_place_that_cannot_be_written_is_refused(tmp_path: Path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot write results to"):
        begin_run(tmp_path / "file" / "run", TOWER, SMALL)


def test_begin__recoloured_tasks_are_written_and_learnt_from(tmp_path: Path, own: str):
    run = begin_run(tmp_path, Settings("TowerScratch", corpus=own), Recipe(recolour=True))
    assert len(run.tasks) > len(load_tasks(own, "tower", "scratch", "train"))
    assert run.tasks.provenance.path == str(tmp_path / "training_tasks.jsonl")
    assert open_run(tmp_path, {}, untrained=True).tasks.ids == run.tasks.ids


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_train__a_signal_ends_it_saved(tmp_path: Path, number: signal.Signals):
    run = trained(tmp_path, 10_000_000, on_update=lambda progress: os.kill(os.getpid(), number))
    assert run.steps < 100
    assert open_run(tmp_path, {}).steps == run.steps
    assert signal.getsignal(number) in (signal.default_int_handler, signal.SIG_DFL)


def test_train__a_second_signal_interrupts_at_once(tmp_path: Path):
    def twice(progress: Progress) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        trained(tmp_path, 10_000_000, on_update=twice)


def test_train__saves_every_so_many_steps(tmp_path: Path):
    saved: list[int] = []

    def look(progress: Progress) -> None:
        if (tmp_path / "checkpoint.pt").exists():
            saved.append(open_run(tmp_path, {}).steps)

    trained(tmp_path, 160, save_every=64, on_update=look)
    assert saved == [64, 64, 128]


@pytest.mark.parametrize("name", ["TowerFlipIt", "ScatterScratch", "ScatterFlipIt"])
def test_train__every_configuration_with_stop_forcing_gives_an_agent(tmp_path: Path, own: str, name: str):
    recipe = Recipe(envs=2, rollout=16, batch_size=16, epochs=1, stop_forcing=True, recolour=True)
    run = trained(tmp_path, 16, recipe, Settings(name, corpus=own))
    episodes = evaluate(run.agent(), Settings(name, corpus=own, horizon=2), "dev")
    assert {episode.outcome for episode in episodes} <= {"success", "wrong_stop", "horizon"}


def test_train__an_unknown_backend_is_refused_with_the_choices(tmp_path: Path):
    with pytest.raises(ValueError, match="unknown backend 'threads'; choose from batched, dummy"):
        go_on(begin_run(tmp_path, TOWER, SMALL), 32, backend="threads")


def test_train__works_beside_the_main_thread(tmp_path: Path):
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(trained, tmp_path, 32).result().steps == 32
