"""Demonstrations as arrays, files and Minari datasets."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from lilgym_mp.cli import main
from lilgym_mp.corpus import load_tasks
from lilgym_mp.envs.observation import item_array
from lilgym_mp.scene.appearances.tower import Tower
from lilgym_mp.solver.demonstrations import Demonstration, arrays, demonstrations, drawn_tasks, write_npz
from lilgym_mp.solver.reports import solve_tasks
from tests.scenes import B, K, scene, tower
from tests.solver.tasks import mdp, task

BLUE = "exist(filter_color(all_items, Color.BLUE))"
NEVER = "count(all_items) == 99"


def demonstrate(*programs: str) -> list[Demonstration]:
    start = scene(left=tower(K))
    reports = solve_tasks([task(program, start) for program in programs], mdp("tower"), budget=10_000)
    return demonstrations(reports, mdp("tower"))


def test_demonstration__has_the_state_before_each_action():
    (episode,) = demonstrate(BLUE)
    assert [state.scene for state in episode.states] == [scene(left=tower(K)), scene(left=tower(K), right=tower(B))]
    assert (episode.rewards, episode.terminated, episode.truncated) == ((-0.1, 1.0), True, False)


def test_demonstrations__omit_unsolved_tasks():
    assert [episode.task.program for episode in demonstrate(BLUE, NEVER)] == [BLUE]


def test_draws__depend_on_the_seed():
    tasks = load_tasks("builtin", "tower", "scratch", "dev")[:6]
    assert len(drawn_tasks(tasks, 9, seed=1)) == 9
    assert drawn_tasks(tasks, 9, seed=1) == drawn_tasks(tasks, 9, seed=1) != drawn_tasks(tasks, 9, seed=2)


def test_draws__of_no_episode_are_refused():
    with pytest.raises(ValueError, match="episodes must be at least 1, not 0"):
        drawn_tasks(load_tasks("builtin", "tower", "scratch", "dev"), 0, seed=0)


def test_arrays__concatenate_the_actions_of_the_episodes():
    found = arrays(demonstrate(BLUE, "count(all_items) == 3"), mdp("tower"), images=True)
    assert found["program"].tolist() == [BLUE, "count(all_items) == 3"]
    assert found["starts"].tolist() == [0, 2, 5]
    assert found["action_array"][0].tolist() == Tower().to_array(Tower().decode(int(found["action"][0])))
    assert found["reward"].tolist() == pytest.approx([-0.1, 1, -0.1, -0.1, 1])
    assert found["items"][0].tolist() == item_array(scene(left=tower(K)), 4).tolist()
    assert found["image"].shape == (5, 50, 190, 3)


def test_arrays__of_no_episode_are_refused():
    with pytest.raises(ValueError, match="none of the tasks was solved"):
        arrays(demonstrate(NEVER), mdp("tower"))


@pytest.mark.parametrize("appearance", ["tower", "scatter"])
def test_arrays__replay_in_the_environment(appearance: str):
    tasks = load_tasks("builtin", appearance, "flipit", "dev")[:12]
    dynamics = mdp(appearance)
    found = arrays(demonstrations(solve_tasks(tasks, dynamics), dynamics), dynamics, images=True)
    env = gym.make(f"lilgym_mp/{appearance.capitalize()}FlipIt-v0", split="dev")
    for index, begin in enumerate(found["starts"][:-1].tolist()):
        observation, info = env.reset(options={"task": str(found["task"][index])})
        for step in range(begin, found["starts"][index + 1]):
            assert np.array_equal(observation["image"], found["image"][step])
            observation, reward, *_, info = env.step(int(found["action"][step]))
            assert reward == pytest.approx(found["reward"][step])
        assert info["is_success"]


def test_npz__is_reproducible_and_contains_its_metadata(tmp_path: Path):
    found = arrays(demonstrate(BLUE), mdp("tower"))
    for name in ("a.npz", "b.npz"):
        write_npz(tmp_path / name, found, {"seed": 5})
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    with np.load(tmp_path / "a.npz") as read:
        assert json.loads(str(read["about"])) == {"seed": 5}
        assert read["action"].tolist() == found["action"].tolist()


def test_minari__replays_in_the_recovered_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    minari: Any = pytest.importorskip("minari")
    from lilgym_mp.solver.minari_dataset import write_minari

    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    tasks = load_tasks("builtin", "tower", "flipit", "dev")[:3]
    episodes = demonstrations(solve_tasks(tasks, mdp("tower")), mdp("tower"))
    env = gym.make("lilgym_mp/TowerFlipIt-v0", split="dev")
    write_minari("lilgym/own-v0", episodes, env, env, "Ours.")
    dataset = minari.load_dataset("lilgym/own-v0")
    env = dataset.recover_environment()
    for episode in dataset.iterate_episodes():
        observation, info = env.reset(options={"task": episode.infos["task"][0].decode()})
        for step, action in enumerate(episode.actions):
            assert np.array_equal(observation["image"], episode.observations["image"][step])
            observation, *_, info = env.step(int(action))
        assert info["is_success"]
    with pytest.raises(ValueError, match="already"):
        write_minari("lilgym/own-v0", episodes, env, env, "Ours.")


def test_minari__is_compressed_and_extensible_and_records_its_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    minari: Any = pytest.importorskip("minari")
    from minari.data_collector import EpisodeBuffer

    from lilgym_mp.solver.minari_dataset import write_minari

    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    tasks = load_tasks("builtin", "scatter", "scratch", "dev")[:20]
    episodes = demonstrations(solve_tasks(tasks, mdp("scatter")), mdp("scatter"))
    env = gym.make("lilgym_mp/ScatterScratch-v0", split="dev")
    write_minari("own-v0", episodes, env, env, "Ours.")
    dataset = minari.load_dataset("own-v0")
    (file,) = (tmp_path / "own-v0" / "data").glob("*.hdf5")
    images = sum(episode.observations["image"].nbytes for episode in dataset.iterate_episodes())
    assert file.stat().st_size < images / 8
    stored = sum(part.stat().st_size for part in file.parent.iterdir())
    assert dataset.storage.metadata["dataset_size"] == pytest.approx(stored / 1e6, abs=0.11)
    first = dataset[0]
    buffer = EpisodeBuffer(
        observations={name: list(part) for name, part in first.observations.items()},
        actions=first.actions,
        rewards=first.rewards,
        terminations=first.terminations,
        truncations=first.truncations,
        infos={name: list(part) for name, part in first.infos.items()},
    )
    dataset.update_dataset_from_buffer([buffer])
    assert (minari.load_dataset("own-v0")[len(episodes)].observations["image"] == first.observations["image"]).all()


def test_minari__leaves_no_files_if_writing_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    pytest.importorskip("minari")
    from lilgym_mp.solver.minari_dataset import write_minari

    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    env = gym.make("lilgym_mp/TowerFlipIt-v0", split="dev")
    with pytest.raises(ValueError, match="no task"):
        write_minari("own-v0", demonstrate(BLUE), env, env, "Ours.")
    assert not (tmp_path / "own-v0").exists()


@pytest.mark.parametrize(
    ("observation", "parts"),
    [("arrays", {"image", "statement", "target"}), ("structured", {"item_array", "present", "statement", "target"})],
)
def test_minari__stores_other_observations_with_dev_for_evaluation(
    observation: str, parts: set[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    minari: Any = pytest.importorskip("minari")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    options = ["--episodes", "5", "--jobs", "1", "--minari", "own-v0", "--observation", observation]
    assert main(["demos", "TowerFlipIt", *options]) == 0
    dataset = minari.load_dataset("own-v0")
    env, eval_env = dataset.recover_environment(), dataset.recover_environment(eval_env=True)
    assert (env.unwrapped.tasks.provenance.split, eval_env.unwrapped.tasks.provenance.split) == ("train", "dev")
    assert env.observation_space == eval_env.observation_space == dataset.observation_space
    assert dataset.total_episodes == 5
    for episode in dataset.iterate_episodes():
        observed, info = env.reset(options={"task": episode.infos["task"][0].decode()})
        assert set(observed) == parts
        for step, action in enumerate(episode.actions):
            assert all(np.array_equal(observed[name], episode.observations[name][step]) for name in parts)
            observed, *_, info = env.step(int(action))
        assert info["is_success"]
