"""Data sets of episodes: what they hold, in each format, from agents, recordings and the browser's episodes."""

import errno
import gzip
import json
from itertools import pairwise

import gymnasium as gym
import numpy as np
import pytest

from lilgym_mp import action_masks
from lilgym_mp.corpus import Vocabulary, load_tasks
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.evaluation import Episode, datasets
from lilgym_mp.scene.actions import STOP
from lilgym_mp.wrappers import StructuredObservation, TextObservation
from tests.command_line import error_of, lilgym, succeeds
from tests.json_files import read_json_lines

PARTS = {
    "image": {"image"},
    "tokens": {"image", "tokens"},
    "structured": {"item_array", "present", "tokens"},
    "text": {"text"},
}


@pytest.fixture
def collect(tmp_path):
    """Writes an npz file with `lilgym-mp data collect` and reads it."""

    def collected(arguments):
        succeeds(f"data collect {arguments} --split dev --force --out", tmp_path / "own.npz")
        with np.load(tmp_path / "own.npz") as file:
            return dict(file)

    return collected


def environment(configuration, form):
    observation = "text" if form in ("image", "text") else "arrays"
    env = gym.make(f"lilgym_mp/{configuration}-v0", split="dev", observation=observation)
    return {"text": TextObservation, "structured": StructuredObservation}.get(form, lambda env: env)(env)


@pytest.mark.parametrize(
    ("configuration", "quality", "form"),
    [
        ("TowerFlipIt", "random-legal", "image"),
        ("ScatterScratch", "expert", "tokens"),
        ("ScatterScratch", "random-legal", "structured"),
        ("TowerFlipIt", "expert", "text"),
    ],
)
def test_fields__are_what_the_environment_shows(collect, configuration, form, quality):
    found = collect(f"{configuration} --episodes 4 --quality {quality} --observation {form} --returns-to-go")
    env = environment(configuration, form)
    for index, (begin, end) in enumerate(pairwise(found["starts"])):
        observed, info = env.reset(options={"task": str(found["task"][index])})
        if "tokens" in PARTS[form]:
            assert np.array_equal(found["tokens"][index], observed["statement"])
        returned, ends = 0.0, [False]
        for step in range(begin, end):
            shown = {"text": observed} if form == "text" else observed
            for name in PARTS[form] - {"tokens"}:
                kept = np.asarray(found[name][step])
                assert np.array_equal(
                    shown[name], kept[tuple(map(slice, np.shape(shown[name])))]
                )  # dev has fewer slots
            assert np.array_equal(action_masks(env), found["legal"][step])
            observed, reward, *ends, info = env.step(int(found["action"][step]))
            assert (reward, *ends) == (found["reward"][step], found["terminated"][step], found["truncated"][step])
            returned += float(reward)
        assert any(ends)
        assert found["return_to_go"][begin] == pytest.approx(returned)
        assert info["outcome"] == found["outcome"][index]
    assert set(found) >= PARTS[form] | {"statement", "program", "target", "agent", "split", "about"}
    assert (found["outcome"] == "success").all() == (quality == "expert")
    about = json.loads(str(found["about"]))
    assert about["wrappers"] == {"structured": ["StructuredObservation"], "text": ["TextObservation"]}.get(form, [])
    if "tokens" in PARTS[form]:
        ids = found["tokens"][0]
        assert about["length"] == len(ids)
        statement = str(found["statement"][0])
        assert np.array_equal(Vocabulary(tuple(about["vocabulary"])).encode(statement, len(ids)), ids)


def test_mixed__has_a_third_of_each_quality(collect):
    found = collect("TowerScratch --episodes 9 --quality mixed")
    assert found["agent"].tolist() == ["expert"] * 3 + ["imitation-tower"] * 3 + ["random-legal"] * 3


def test_optimal__has_all_first_actions_of_shortest_solutions(collect):
    found = collect("TowerScratch --episodes 5 --optimal-actions")
    taken = found["optimal"][np.arange(len(found["action"])), found["action"]]
    assert taken.all()
    assert found["optimal"].sum() > len(taken)
    assert not (found["optimal"] & ~found["legal"]).any()


def test_steps__of_the_releases_rules_are_never_both_terminated_and_truncated():
    settings = EnvConfig("TowerScratch", rules="release")
    env = settings.make("dev")
    env.reset(options={"task": env.tasks[0].id})
    actions = [1, 10] * 5 + [0]  # a block is added and removed again
    results = [env.step(action)[2:4] for action in actions]
    assert results[-1] == (True, True)
    outcome = "success" if env.goal_reached() else "wrong_stop"
    episode = Episode.of(env.tasks[0], [*map(env.dynamics.appearance.decode, actions)], outcome, env.dynamics)
    sources = [datasets.Source(settings, "dev", "own", [episode])]
    (rollout,) = datasets.rollouts(sources, datasets.environments(settings, ["dev"], "image"))
    assert rollout.steps["terminated"].tolist() == [False] * 10 + [True]
    assert not rollout.steps["truncated"].any()


def test_files__of_equal_options_and_seeds_are_equal(tmp_path):
    first, again = tmp_path / "first.jsonl.gz", tmp_path / "again.jsonl.gz"
    for place in (first, again):
        succeeds("data collect ScatterScratch --episodes 7 --seed 3 --out", place)
    assert first.read_bytes() == again.read_bytes()


def test_json_lines__hold_sets_of_actions_as_indices_and_images_as_png(collect, tmp_path):
    command = "TowerFlipIt --episodes 3 --optimal-actions"
    arrays = collect(command)
    succeeds(f"data collect {command} --split dev --out", tmp_path / "own.jsonl.gz")
    with gzip.open(tmp_path / "own.jsonl.gz", "rt") as file:
        rows = [json.loads(line) for line in file]
    assert [row["statement"] for row in rows] == arrays["statement"].tolist()
    assert [action for row in rows for action in row["action"]] == arrays["action"].tolist()
    assert rows[0]["legal"][0] == np.flatnonzero(arrays["legal"][0]).tolist()
    assert rows[0]["image"][0].startswith("iVBORw0KGgo")  # PNG in base64


def test_parquet__holds_the_rows_of_json_lines(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    for name in ("own.parquet", "own.jsonl"):
        succeeds("data collect TowerScratch --episodes 4 --observation structured --out", tmp_path / name)
    rows = read_json_lines(tmp_path / "own.jsonl")
    assert parquet.read_table(tmp_path / "own.parquet").to_pylist() == rows


# Recordings


@pytest.mark.long
def test_recordings__become_a_data_set(tmp_path, capsys):
    out = tmp_path / "own.npz"
    played = "evaluate --policy random-legal --configuration TowerScratch ScatterScratch --record"
    succeeds(played, tmp_path / "runs")
    command = f"data from-recordings {tmp_path / 'runs'} --out {out}"
    assert "episodes of ScatterScratch, TowerScratch cannot be one data set; choose with" in error_of(capsys, command)
    assert not out.exists()
    succeeds(f"{command} --configuration TowerScratch")
    with np.load(out) as found:
        assert found["task"].tolist() == list(load_tasks("builtin", "tower", "scratch", "dev").ids)
        assert set(found["agent"]) == {"random legal"}
    assert "no finished episodes of TowerFlipIt" in error_of(capsys, f"{command} --configuration TowerFlipIt --force")


def test_played_episodes__become_a_data_set(tmp_path):
    database = pytest.importorskip("lilgym_mp.contrib.web.database")
    task = load_tasks("builtin", "tower", "scratch", "dev").by_id("tower-dev-001")  # I can see a blue block.
    fields = {"corpus": "builtin", "split": "dev", "player": "Ada", "task_id": task.id}
    with database.Database(tmp_path / "web.sqlite3").write() as connection:
        for actions, outcome in (([3, 0], "success"), ([3], None)):  # 3 adds a blue block
            played = {"id": str(outcome), "configuration": "TowerScratch", "actions": actions, "outcome": outcome}
            database.save_episode(connection, database.PlayedEpisode(**fields, **played))
    succeeds(f"data from-recordings {tmp_path / 'web.sqlite3'} --out", tmp_path / "own.npz")
    with np.load(tmp_path / "own.npz") as found:
        assert (found["agent"].tolist(), found["action"].tolist()) == (["Ada"], [3, 0])


@pytest.mark.parametrize(
    ("content", "message"),
    [(None, "No such file"), (b"SQLite format 3\0", "no played episodes that can be read"), (b"text", "damaged")],
)
def test_sources__that_cannot_be_read_are_named(content, message, tmp_path, capsys):
    source = tmp_path / "source"
    if content is not None:
        source.write_bytes(content)
    assert lilgym(f"data from-recordings {source} --out", tmp_path / "own.npz") != 0
    printed = capsys.readouterr().err
    assert str(source) in printed
    assert message in printed
    assert not (tmp_path / "own.npz").exists()


@pytest.mark.parametrize(("actions", "outcome"), [([STOP], "horizon"), ([STOP, STOP], "wrong_stop")])
def test_rollouts__that_end_differently_are_refused(actions, outcome):
    settings = datasets.EnvConfig("TowerScratch")
    task = load_tasks("builtin", "tower", "scratch", "dev")[0]
    episode = datasets.Episode.of(task, actions, outcome, settings.dynamics())
    sources = [datasets.Source(settings, "dev", "agent", [episode])]
    ended = f"ended as {outcome}, but as wrong_stop when played again, after 1 of {len(actions)} actions"
    with pytest.raises(datasets.DatasetError, match=ended):
        list(datasets.rollouts(sources, datasets.environments(settings, ["dev"], "image")))


# Output


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("", "name an output"),
        ("--out own.txt", "must end in .jsonl, .jsonl.gz, .npz, .parquet, unlike 'own.txt'"),
        ("--out own.npz --episodes 0", "--episodes must be at least 1"),
        ("--out own.npz --seed -1", "--seed must be at least 0"),
        ("--out own.npz --agent x", "--agent needs --quality medium or mixed"),
        ("--out own.npz --quality medium --agent x", "no trained agent at x"),
        ("--out old.npz", "old.npz exists; --force overwrites it"),
    ],
)
def test_collect__names_the_mistake(options, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "old.npz").write_bytes(b"precious")
    assert message in error_of(capsys, f"data collect TowerFlipIt {options}")
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"precious"]


def test_file__does_not_remain_if_the_disk_is_full(tmp_path, monkeypatch, capsys):
    def fail(path, *_):
        path.write_bytes(b"some")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(datasets, "WRITERS", {".npz": fail})
    place = tmp_path / "own.npz"
    assert lilgym("data collect TowerScratch --episodes 2 --out", place) == 1
    assert f"{place}: No space left on device" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_minari__missing_is_an_error_before_any_work(monkeypatch, capsys):
    monkeypatch.setattr(datasets, "find_spec", lambda name: None)
    assert 'needs Minari: pip install "minari[hdf5]' in error_of(
        capsys, "data collect TowerFlipIt --minari lilgym/own-v0"
    )


@pytest.fixture
def minari(tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    return pytest.importorskip("minari")


@pytest.mark.parametrize("form", PARTS)
def test_minari__replays_in_the_recovered_environments(minari, form, capsys):
    command = f"data collect TowerFlipIt --episodes 5 --minari lilgym/own-v0 --observation {form}"
    succeeds(command)
    dataset = minari.load_dataset("lilgym/own-v0")
    env, eval_env = dataset.recover_environment(), dataset.recover_environment(eval_env=True)
    assert (env.unwrapped.tasks.provenance.split, eval_env.unwrapped.tasks.provenance.split) == ("train", "dev")
    assert env.observation_space == eval_env.observation_space == dataset.observation_space
    assert dataset.total_episodes == 5
    for episode in dataset.iterate_episodes():
        observed, info = env.reset(options={"task": episode.infos["task"][0].decode()})
        for step, action in enumerate(episode.actions):
            seen = episode.observations
            if form == "text":
                assert observed == seen[step]
            else:
                assert all(np.array_equal(observed[name], seen[name][step]) for name in observed)
            assert np.array_equal(action_masks(env), episode.infos["legal"][step])
            observed, *_, info = env.step(int(action))
        assert info["is_success"]
    assert "exists already" in error_of(capsys, command)


def test_minari__a_name_without_version_is_refused_before_any_episode(minari, capsys):
    assert "'tower-expert' cannot name a Minari data set" in error_of(
        capsys, "data collect TowerFlipIt --minari tower-expert"
    )


def test_minari__leaves_no_files_if_writing_fails(minari, tmp_path, monkeypatch):
    def fail(rollout):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(datasets, "_buffer", fail)
    assert lilgym("data collect TowerScratch --episodes 2 --minari lilgym/own-v0") == 1
    assert not list(tmp_path.rglob("*"))
