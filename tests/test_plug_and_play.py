"""The obvious first code with Gymnasium and Stable-Baselines3 works."""

import importlib
import sys

import gymnasium as gym
import numpy as np
import pytest

from lilgym_mp.corpus import words, write_corpus
from lilgym_mp.corpus.extras import install
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.wrappers import MultiDiscreteActions, StopForcing, stop_forcing_v0
from tests.command_line import python
from tests.corpora import BLUE
from tests.scripts import needs

TOWER, SCATTER = "lilgym_mp/TowerFlipIt-v0", "lilgym_mp/ScatterFlipIt-v0"


def test_arrays__equal_the_text_observations():
    arrays = gym.make(SCATTER, observation="arrays")
    (text, _), (array, _) = gym.make(SCATTER).reset(seed=3), arrays.reset(seed=3)
    assert (array["image"] == text["image"]).all()
    assert array["target"].tolist() == [text["target"]]
    assert tuple(arrays.unwrapped.vocabulary.decode(array["statement"])) == words(text["statement"])


def test_ppo__learns_from_the_obvious_first_line():
    pytest.importorskip("stable_baselines3")
    from stable_baselines3 import PPO

    model = PPO("MultiInputPolicy", gym.make(TOWER, observation="arrays"), n_steps=16, batch_size=16, n_epochs=1)
    model.learn(16)


def test_maskable_ppo__learns_multi_discrete_actions_with_masks_by_slots():
    pytest.importorskip("sb3_contrib")
    from sb3_contrib import MaskablePPO

    env = MultiDiscreteActions(gym.make(TOWER, observation="arrays"), masks="slots")
    MaskablePPO("MultiInputPolicy", env, n_steps=16, batch_size=16, n_epochs=1).learn(16)


@pytest.mark.parametrize("id", [TOWER, SCATTER])
def test_masks_by_slots__allow_just_the_values_of_legal_actions(id):
    env = MultiDiscreteActions(gym.make(id), masks="slots")
    env.reset(seed=0)
    base = env.unwrapped
    arrays = [base.decode_action(index) for index in np.flatnonzero(base.action_masks()).tolist()]
    flags = np.split(env.action_masks(), np.cumsum(env.action_space.nvec)[:-1])
    for values, allowed in zip(zip(*arrays, strict=True), flags, strict=True):
        assert {-1, *np.flatnonzero(allowed).tolist()} == {-1, *values}


def test_masks_by_slots__allow_anything_where_stop_alone_is_legal():
    env = MultiDiscreteActions(StopForcing(gym.make(TOWER)), masks="slots")
    solved = Task("solved", "Nothing is there.", "count(all_items) == 0", True, Scene.empty())
    env.reset(options={"task": solved})
    assert env.action_masks().tolist() == [True, False, False] + [True] * 6


def test_tasks__are_found_by_number_as_by_text(tmp_path):
    path = tmp_path / "own.jsonl"
    write_corpus(path, "own", "MIT", [BLUE | {"starts": [BLUE["starts"][1] | {"id": "1757"}]}])
    env = gym.make(TOWER, corpus=path)
    tasks = env.unwrapped.tasks
    assert tasks.by_id(1757) is tasks.by_id("1757") is tasks.by_id(np.int64(1757))
    assert env.reset(options={"task": 1757})[1]["task"] == "1757"
    envs = gym.make_vec(TOWER, num_envs=2, corpus=path)
    assert envs.reset(options={"task": 1757})[1]["task"].tolist() == ["1757", "1757"]
    for unknown in (1758, True):
        with pytest.raises(ValueError, match=f"no task {unknown} in corpus"):
            tasks.by_id(unknown)


def test_vector_wrappers__when_collected_leave_their_environment_open(monkeypatch):
    """Gymnasium 1.1 to 1.2.2 closes a vector environment when its wrapper is garbage-collected."""
    monkeypatch.setattr(gym.vector.VectorEnv, "__del__", lambda self: self.close(), raising=False)
    envs = gym.make_vec(TOWER, num_envs=2)
    for _ in range(2):
        stop_forcing_v0(envs).reset(seed=0)
    envs.reset(seed=0)


def test_sb3__without_its_extra_names_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    monkeypatch.delitem(sys.modules, "lilgym_mp.sb3", raising=False)
    with pytest.raises(ModuleNotFoundError, match='pip install "stable-baselines3'):
        importlib.import_module("lilgym_mp.sb3")


def test_batched_games__work_without_pettingzoo():
    code = """
import importlib.util, sys
found = importlib.util.find_spec
importlib.util.find_spec = lambda name, *rest: None if name == "pettingzoo" else found(name, *rest)
sys.modules["pettingzoo"] = None
from lilgym_mp.envs import proposer_verifier
games = proposer_verifier.BatchedGames(2, protocol="veto")
observations, infos = games.reset(seed=0)
print(sorted(observations))
try:
    proposer_verifier.env
except ImportError as fault:
    print(fault)
"""
    done = python("-c", code)
    seen, fault = done.stdout.splitlines()
    assert seen == "['proposer_0', 'verifier_0']", done.stderr
    assert fault == f"env needs pettingzoo, BatchedGames does not: {install('pettingzoo')}"


# A script as in docs/wrappers.md: `make` refers to modules of `__main__`, which cloudpickle copies with it.
SCRIPT = """
import gymnasium as gym
import lilgym_mp
from lilgym_mp import envs, learning, programs, sb3, wrappers as w

def make():
    assert lilgym_mp.envs is envs and learning.common and programs and sb3  # some of them imported on first use
    return w.tokenized_statement_v0(gym.make("lilgym_mp/TowerFlipIt-v0"))

if __name__ == "__main__":
    {use}
"""
USES = {  # by the package that sends it
    "stable_baselines3": """
    from stable_baselines3.common.vec_env import SubprocVecEnv
    env = SubprocVecEnv([make], start_method="spawn")
    env.reset()
    print(env.step([0])[2].tolist())
    env.close()""",
    "gymnasium": """
    env = gym.vector.AsyncVectorEnv([make], context="spawn")
    env.reset(seed=0)
    print(env.step([0])[2].tolist())
    env.close()""",
    "ray": """
    import ray
    ray.init(num_cpus=1, include_dashboard=False, log_to_driver=False)

    @ray.remote
    def play():
        env = make()
        env.reset(seed=0)
        return [env.step(0)[2]]

    print(ray.get(play.remote()))
    ray.shutdown()""",
}


@pytest.mark.long
@pytest.mark.parametrize("package", USES)
def test_a_script_that_names_modules_of_the_package__is_sent_to_other_processes(package, tmp_path):
    needs(package)
    script = tmp_path / "script.py"
    script.write_text(SCRIPT.format(use=USES[package].strip()))
    done = python(script, cwd=tmp_path)
    assert done.stdout.splitlines()[-1:] == ["[True]"], done.stderr
