"""`EnvConfig`: what derives from the fields of an environment."""

import json
from functools import partial
from pathlib import Path

import gymnasium as gym
import pytest
from gymnasium.envs.registration import EnvSpec

from lilgym_mp.cli import parse_args
from lilgym_mp.corpus import Vocabulary
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.envs.workers import WorkerVectorEnv
from lilgym_mp.testing import assert_same
from lilgym_mp.wrappers import FlatObservation, StopForcing, TokenizedStatement, action_mask_v0, tokenized_statement_v0
from tests.command_line import python
from tests.corpora import write_own_corpus

# Run with a further field in the source of `EnvConfig`, which is the only edit.
ONE_EDIT = """
import sys
from importlib.machinery import SourceFileLoader
from unittest import mock

read = SourceFileLoader.get_data

def get_data(loader, path):
    if path.endswith(".pyc") and "envs/__pycache__/config." in path:
        raise OSError(path)
    field = b"    gravity: float = setting(1.0, 'pull')\\n"
    data = read(loader, path)
    return data.replace(b"    rules: str", field + b"    rules: str", 1) if path.endswith("envs/config.py") else data

SourceFileLoader.get_data, sys.dont_write_bytecode = get_data, True
import argparse
from pathlib import Path
import gymnasium as gym
from lilgym_mp.cli import make_parser
from lilgym_mp.cli.experiment_plan import read_plan
from lilgym_mp.contrib.report.report_data import SHARED_SETTINGS
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.envs.proposer_verifier import Game
from lilgym_mp.envs.proposer_verifier.settings import GameSettings
from lilgym_mp.envs.workers import WorkerVectorEnv

made = []
dynamics = EnvConfig.dynamics
EnvConfig.dynamics = lambda self: made.append(self.gravity) or dynamics(self)

config = EnvConfig("TowerScratch", gravity=2.0)
assert config.to_json()["gravity"] == 2.0
assert EnvConfig.from_json(config.to_json()) == config
assert EnvConfig.from_json({"configuration": "TowerScratch", "grid": [19, 5]}).gravity == 1.0, "as in an older file"
assert GameSettings.from_json(GameSettings(gravity=2.0).to_json()).single() == config
assert "gravity" in SHARED_SETTINGS
for make in (
    lambda: config.make("dev"),
    lambda: config.make_batch("dev", 2),
    lambda: gym.make(config.id, gravity=2.0),
    lambda: gym.make_vec(config.id, num_envs=2, gravity=2.0),
    lambda: WorkerVectorEnv(config.id, 2, 1, gravity=2.0),
    lambda: Game(GameSettings.of({"configuration": config.id, "gravity": 2.0})),
):
    made.clear()
    make()
    assert set(made) == {2.0}

def parsers(parser):
    yield parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for each in action.choices.values():
                yield from parsers(each)

with_rules = [each for each in parsers(make_parser()) if "--rules" in each.format_help()]
assert len(with_rules) >= 8
assert all("--gravity" in each.format_help() for each in with_rules), [each.prog for each in with_rules]

file = Path(sys.argv[1])
file.write_text('gravity = 2.5\\nconfigurations = ["TowerScratch"]\\n[[learners]]\\nlearner = "ppo"\\n')
(run,) = read_plan(file)
assert all("--gravity 2.5" in " ".join(words) for words in run.commands)
print("found everywhere")
"""


def test_new_field__is_one_edit(tmp_path):
    done = python("-c", ONE_EDIT, tmp_path / "experiment.toml")
    assert (done.returncode, done.stdout) == (0, "found everywhere\n"), done.stderr


@pytest.mark.parametrize("grid", [(38, 10), "native"])
def test_json__is_read_back_as_it_was_written(grid):
    config = EnvConfig("lilgym_mp/ScatterFlipIt-v0", rules="release", horizon=5, grid=grid)
    written = config.to_json()
    assert EnvConfig.from_json(json.loads(json.dumps(written))) == config
    assert list(written) == ["configuration", "corpus", "rules", "horizon", "grid"], "as in recordings and model files"


@pytest.mark.parametrize(
    ("wrong", "error"),
    [({"rules": 3}, "unknown rules 3"), ({"corpus": 3}, "os.PathLike"), ({"gravity": 1}, "gravity")],
)
def test_json__with_wrong_values_is_refused(wrong, error):
    with pytest.raises((ValueError, TypeError), match=error):
        EnvConfig.from_json({**EnvConfig("TowerScratch").to_json(), **wrong})


def test_corpus__a_relative_path_is_absolute_from_the_start(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert EnvConfig("TowerScratch", "own.jsonl").corpus == str(tmp_path / "own.jsonl")
    assert EnvConfig("TowerScratch", Path("~/own.jsonl")).corpus == str(tmp_path / "home" / "own.jsonl")
    for name in ("builtin", "lilgym", "builtin:form", "generated:1:0"):
        assert EnvConfig("TowerScratch", name).corpus == name


@pytest.mark.parametrize("command", ["train ppo TowerScratch", "evaluate", "train parse-and-plan"])
def test_options__a_tilde_is_the_home_directory(command, monkeypatch):
    monkeypatch.setenv("HOME", "/somewhere")
    args = parse_args([*command.split(), "--corpus=~/own.jsonl", "--out=~/x"])
    assert (args.corpus, args.out) == ("/somewhere/own.jsonl", Path("/somewhere/x"))


WORDS = Vocabulary(("a", "box", "block"))


RELEASED = {"split": "dev", "rules": "release", "grid": (38, 10), "image_size": "native", "horizon": 7}


@pytest.mark.parametrize(
    ("settings", "wrap"),
    [
        ({"observation": "arrays", "vocabulary": WORDS, "length": 60}, lambda env: env),
        ({}, lambda env: TokenizedStatement(env, vocabulary=WORDS, length=60)),
        ({}, lambda env: FlatObservation(TokenizedStatement(StopForcing(env), vocabulary=WORDS, length=60))),
        ({**RELEASED, "render_mode": "rgb_array"}, lambda env: env),
    ],
)
@pytest.mark.parametrize("configuration", ["TowerScratch", "ScatterFlipIt"])
def test_spec__from_json_makes_the_same_environment(configuration, settings, wrap):
    env = wrap(gym.make(f"lilgym_mp/{configuration}-v0", **settings))
    again = gym.make(EnvSpec.from_json(env.spec.to_json()))
    assert str(again) == str(env)
    assert again.observation_space == env.observation_space
    for name in ("dynamics", "tasks", "render_mode"):
        assert getattr(again.unwrapped, name) == getattr(env.unwrapped, name)
    assert_same(again.reset(seed=1), env.reset(seed=1))


@pytest.mark.parametrize(
    "make",
    [
        gym.make,
        partial(gym.make_vec, num_envs=2),
        partial(WorkerVectorEnv, num_envs=2, num_workers=1),
        lambda id, corpus, vocabulary, observation: TokenizedStatement(gym.make(id, corpus=corpus), vocabulary),
    ],
)
def test_spec__of_relative_paths_is_the_same_in_another_directory(make, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_own_corpus(tmp_path / "own.jsonl")
    WORDS.save("words.json")
    env = make("lilgym_mp/TowerFlipIt-v0", corpus="own.jsonl", vocabulary="words.json", observation="arrays")
    spec = env.spec
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir("elsewhere")
    assert spec.kwargs["corpus"] == str(tmp_path / "own.jsonl")
    again = gym.make_vec(spec) if "num_envs" in spec.kwargs else gym.make(EnvSpec.from_json(spec.to_json()))
    assert again.observation_space == env.observation_space


def test_spec__of_workers_keeps_the_render_mode():
    envs = WorkerVectorEnv("lilgym_mp/TowerScratch-v0", 2, 1, render_mode="rgb_array")
    assert gym.make_vec(envs.spec).render_mode == "rgb_array"


def test_vocabulary__of_batches_can_be_read():
    batch = gym.make_vec("lilgym_mp/TowerScratch-v0", num_envs=2, observation="arrays", vocabulary=WORDS, length=60)
    assert batch.unwrapped.vocabulary == WORDS
    wrapped = tokenized_statement_v0(gym.make_vec("lilgym_mp/TowerScratch-v0", num_envs=2), WORDS, 60)
    assert wrapped.vocabulary == action_mask_v0(wrapped).vocabulary == WORDS
    with pytest.raises(AttributeError, match="TokenizedStatement"):
        _ = gym.make("lilgym_mp/TowerScratch-v0").unwrapped.vocabulary
