"""Single environments, batches, workers and SB3's adapter check alike what they are given."""

import multiprocessing
from functools import partial
from unittest import mock

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import WrapperSpec

from lilgym_mp.envs.workers import WorkerVectorEnv
from lilgym_mp.testing import assert_same
from tests.stress.program_language import run_limited

TOWER, SCATTER = "lilgym_mp/TowerFlipIt-v0", "lilgym_mp/ScatterFlipIt-v0"
BATCHES = pytest.mark.parametrize("make", ["batch", "workers"], indirect=True)
WRAPPER = WrapperSpec("TransformReward", "gymnasium.wrappers:TransformReward", {"func": float})


@BATCHES
@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"max_episode_steps": 3}, TypeError, "'max_episode_steps'; use horizon=N"),
        ({"additional_wrappers": (WRAPPER,)}, gym.error.Error, "additional_wrappers"),
    ],
)
def test_own_id__with_a_limit_of_steps_or_wrappers_is_refused_by_batches(make, settings, error, message):
    with mock.patch.dict(gym.registry):
        gym.register(
            "OwnLimit-v0",
            "lilgym_mp.envs.single:LilGymEnv",
            vector_entry_point="lilgym_mp.envs.batched:BatchedEnv",
            kwargs={"configuration": "TowerFlipIt"},
            **settings,
        )
        with pytest.raises(error, match=message):
            make("OwnLimit-v0")


def test_id__may_name_the_module_to_import(make):
    make(f"lilgym_mp:{TOWER}").reset(seed=0)


def test_settings__take_whole_numbers_of_any_type(make):
    given = {"horizon": np.int64(8), "grid": np.array([38, 10]), "length": np.int8(40), "observation": "arrays"}
    env = make(SCATTER, **given).unwrapped
    assert env.horizon == 8
    assert env.dynamics.appearance.grid == (38, 10)


@pytest.mark.parametrize("value", [8.0, True, np.bool_(True)])
def test_settings__refuse_floats_and_booleans(make, value):
    for name in ("horizon", "length"):
        with pytest.raises(ValueError, match=f"{name} must be a positive whole number"):
            make(SCATTER, **{name: value, "observation": "arrays"})


def test_seed__an_invalid_one_is_refused_and_changes_nothing(make):
    env, other = make(TOWER), make(TOWER)
    for each in (env, other):
        each.reset(seed=7)
    for seed in (-1, 1.5, "a", True, [[0], 1]):
        with pytest.raises(ValueError, match="0 or larger, not "):
            env.reset(seed=seed)
    assert_same(env.reset(), other.reset())
    assert_same(env.reset(seed=np.int64(3)), other.reset(seed=3))


def test_render__without_a_mode_warns(make):
    env = make(TOWER)
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="render_mode"):
        assert env.render() is None


def test_ids_of_the_release__name_the_new_one(make):
    with pytest.raises(gym.error.NameNotFound, match="'lilgym_mp/ScatterFlipIt-v0'"):
        make("ScatterFlipIt-v0", data="data")


OTHERS = [(SCATTER, {}), (TOWER, {"rules": "release"}), (TOWER, {"horizon": 5})]
SAVED = "tower, grid=None, start='flipit', rules='paper', horizon=12; this batch is (tower|scatter), grid="


@BATCHES
@pytest.mark.parametrize(("id", "settings"), OTHERS)
def test_restore_state__of_another_configuration_is_refused(make, id, settings):
    envs = gym.make_vec(TOWER, num_envs=2)
    envs.reset(seed=0)
    with pytest.raises(ValueError, match=SAVED):
        make(id, **settings).restore_state(envs.save_state())


@pytest.mark.parametrize("name", ["np_random", "sampler", "tasks"])
def test_attributes_of_batches__that_would_do_nothing_cannot_be_set(name):
    envs = gym.make_vec(TOWER, num_envs=2).unwrapped
    with pytest.raises(AttributeError, match="of a batch"):
        setattr(envs, name, getattr(envs, name))


def tasks_of(env, *, reset):
    """The tasks of eight episodes, started by `reset` or by a batch itself."""
    if reset:
        return [str(env.reset()[1]["task"]) for _ in range(8)]
    return [str(env.step(np.zeros(env.num_envs, np.int64))[-1].get("task")) for _ in range(16)]


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize(("make", "reset"), [("single", True), ("batch", True), ("batch", False)], indirect=["make"])
@pytest.mark.parametrize("seed", [None, 3])
def test_fork__draws_other_tasks_unless_seeded(make, reset, seed):
    env = make(TOWER)
    env.reset(seed=seed)
    one, other = (run_limited(partial(tasks_of, env, reset=reset)) for _ in range(2))
    assert "tower-" in one[-1]
    assert (one == other) is (seed is not None)


@pytest.mark.parametrize("start_method", [None, "forkserver"])
def test_workers__leave_the_start_method_of_the_process_alone(start_method):
    before = multiprocessing.get_start_method(allow_none=True)
    multiprocessing.set_start_method(None, force=True)
    try:
        WorkerVectorEnv(TOWER, 2, 2, start_method=start_method).close()
        assert multiprocessing.get_start_method(allow_none=True) is None
    finally:
        multiprocessing.set_start_method(before, force=True)
