"""Single environments, batches, workers and SB3's adapter check alike what they are given."""

import multiprocessing
from functools import partial

import gymnasium as gym
import numpy as np
import pytest

from lilgym_mp.envs.workers import WorkerVectorEnv
from lilgym_mp.testing import assert_same
from tests.envs.alike import in_fork

TOWER, SCATTER = "lilgym_mp/TowerFlipIt-v0", "lilgym_mp/ScatterFlipIt-v0"
MAKERS = {
    "single": gym.make,
    "batch": lambda id, **settings: gym.make_vec(id, num_envs=2, **settings),
    "workers": lambda id, **settings: WorkerVectorEnv(id, 2, **settings),
}


@pytest.fixture
def own_id():
    yield "OwnLimit-v0"
    gym.registry.pop("OwnLimit-v0", None)


def register(**settings):
    gym.register(
        "OwnLimit-v0",
        "lilgym_mp.envs.single:LilGymEnv",
        vector_entry_point="lilgym_mp.envs.batched:BatchedEnv",
        kwargs={"configuration": "TowerFlipIt"},
        **settings,
    )


@pytest.mark.parametrize("kind", ["batch", "workers"])
def test_own_id_with_a_limit_of_steps__is_refused_by_batches(own_id, kind):
    register(max_episode_steps=3)
    with pytest.raises(TypeError, match="'max_episode_steps'; use horizon=N"):
        MAKERS[kind](own_id)


@pytest.mark.parametrize("kind", ["batch", "workers"])
def test_own_id_with_wrappers__is_refused_by_batches(own_id, kind):
    wrapped = gym.wrappers.TransformReward(gym.make(TOWER), float)
    assert wrapped.spec is not None
    register(additional_wrappers=wrapped.spec.additional_wrappers)
    with pytest.raises(gym.error.Error, match="additional_wrappers"):
        MAKERS[kind](own_id)


@pytest.mark.parametrize("kind", MAKERS)
def test_id__may_name_the_module_to_import(kind):
    env = MAKERS[kind](f"lilgym_mp:{TOWER}")
    env.reset(seed=0)
    env.close()


@pytest.mark.parametrize("kind", MAKERS)
def test_settings__take_whole_numbers_of_any_type(kind):
    given = {"horizon": np.int64(8), "grid": np.array([38, 10]), "length": np.int8(40), "observation": "arrays"}
    env = MAKERS[kind](SCATTER, **given)
    assert env.unwrapped.horizon == 8
    assert env.unwrapped.dynamics.appearance.grid == (38, 10)
    env.close()


@pytest.mark.parametrize("kind", MAKERS)
@pytest.mark.parametrize("value", [8.0, True, np.bool_(True)])
def test_settings__refuse_floats_and_booleans(kind, value):
    for name in ("horizon", "length"):
        with pytest.raises(ValueError, match=f"{name} must be a positive whole number"):
            MAKERS[kind](SCATTER, **{name: value, "observation": "arrays"})


@pytest.mark.parametrize("kind", MAKERS)
def test_seed__an_invalid_one_is_refused_and_changes_nothing(kind):
    env, other = MAKERS[kind](TOWER), MAKERS[kind](TOWER)
    for each in (env, other):
        each.reset(seed=7)
    for seed in (-1, 1.5, "a", True, [[0], 1]):
        with pytest.raises(ValueError, match="0 or larger, not "):
            env.reset(seed=seed)
    assert_same(env.reset(), other.reset())
    assert_same(env.reset(seed=np.int64(3)), other.reset(seed=3))
    env.close()
    other.close()


@pytest.mark.parametrize("kind", MAKERS)
def test_render__without_a_mode_warns(kind):
    env = MAKERS[kind](TOWER)
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="render_mode"):
        assert env.render() is None
    env.close()


OTHERS = [(SCATTER, {}), (TOWER, {"rules": "release"}), (TOWER, {"horizon": 5})]
SAVED = "tower, grid=None, start='flipit', rules='paper', horizon=12; this batch is (tower|scatter), grid="


@pytest.mark.parametrize("kind", ["batch", "workers"])
@pytest.mark.parametrize(("id", "settings"), OTHERS)
def test_restore_state__of_another_configuration_is_refused(kind, id, settings):
    envs, other = MAKERS["batch"](TOWER), MAKERS[kind](id, **settings)
    envs.reset(seed=0)
    with pytest.raises(ValueError, match=SAVED):
        other.restore_state(envs.save_state())
    other.close()


@pytest.mark.parametrize("name", ["np_random", "sampler", "tasks"])
def test_attributes_of_batches__that_would_do_nothing_cannot_be_set(name):
    envs = MAKERS["batch"](TOWER).unwrapped
    with pytest.raises(AttributeError, match="of a batch"):
        setattr(envs, name, getattr(envs, name))


def tasks_of(env, *, reset):
    """The tasks of eight episodes, started by `reset` or by a batch itself."""
    if reset:
        return [str(env.reset()[1]["task"]) for _ in range(8)]
    return [str(env.step(np.zeros(env.num_envs, np.int64))[-1].get("task")) for _ in range(16)]


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize(("kind", "reset"), [("single", True), ("batch", True), ("batch", False)])
@pytest.mark.parametrize("seed", [None, 3])
def test_fork__draws_other_tasks_unless_seeded(kind, reset, seed):
    env = MAKERS[kind](TOWER)
    env.reset(seed=seed)
    one, other = (in_fork(partial(tasks_of, env, reset=reset)) for _ in range(2))
    assert "tower-" in one
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
