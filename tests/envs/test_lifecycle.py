"""Closing environments, copying them, and finding their methods through wrappers."""

import copy
import pickle
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import vector as vector_wrappers

import lilgym_mp
from lilgym_mp.envs.workers import WorkerVectorEnv
from lilgym_mp.testing import assert_same
from lilgym_mp.wrappers import ActionMask, TextObservation, potential_shaping_v0

TOWER = "lilgym_mp/TowerFlipIt-v0"
MAKERS = {
    "single": partial(gym.make, TOWER, render_mode="rgb_array"),
    "batch": partial(gym.make_vec, TOWER, num_envs=2, render_mode="rgb_array"),
    "workers": partial(WorkerVectorEnv, TOWER, 2, num_workers=2),
}
ARGUMENTS = {
    "step": (0,),
    "restore_state": ([],),
    "change_tasks": (lambda tasks: tasks,),
    "last_states": (np.zeros(1, np.int64),),
}
EPISODE = ("reset", "step", "render", "action_masks", "goal_reached", "steps", "state", "scene", "task", "states")
BATCH = ("scene_array", "task_indices", "evaluation_finished", "save_state", "restore_state", "last_states")


def check_raises(env, names, error, message):
    """Whatever of these parts an environment has raises the error."""
    for name in names:
        if hasattr(type(env.unwrapped), name):
            with pytest.raises(error, match=message):
                getattr(env.unwrapped, name)(*ARGUMENTS.get(name, ()))


@pytest.mark.parametrize("kind", MAKERS)
@pytest.mark.parametrize("is_reset", [False, True])
def test_after_close__everything_raises(kind, is_reset):
    env = MAKERS[kind]()
    if is_reset:
        env.reset(seed=0)
    env.close()
    env.close()
    check_raises(env, (*EPISODE, *BATCH, "change_tasks"), gym.error.ClosedEnvironmentError, "make a new one")


@pytest.mark.parametrize("kind", MAKERS)
def test_before_reset__what_an_episode_has_raises_reset_needed(kind):
    env = MAKERS[kind]()
    names = ("step", "action_masks", "goal_reached", "state", "scene", "task", "states")
    check_raises(env, names, gym.error.ResetNeeded, "call reset first")
    env.close()


DUPLICATES = [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))]


@pytest.mark.parametrize("other", [lambda env: gym.make(TOWER, render_mode="human"), *DUPLICATES])
def test_windows__of_two_environments_or_of_copies_are_closed_apart(other, monkeypatch):
    pygame = pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setattr("lilgym_mp.envs.rendering.RENDER_FPS", 1000)
    first = gym.make(TOWER, render_mode="human")
    first.reset(seed=0)
    second = other(first)
    second.reset(seed=0)
    first.close()
    second.step(1)
    assert pygame.display.get_surface() is not None
    with pytest.raises(gym.error.ClosedEnvironmentError):
        first.render()
    second.close()
    assert pygame.display.get_surface() is None


def tasks_of(env, count=12):
    return [env.reset()[1]["task"] for _ in range(count)]


@pytest.mark.parametrize("duplicate", DUPLICATES)
def test_copies__of_an_environment_that_was_never_seeded_draw_on_their_own(duplicate):
    env = ActionMask(gym.make(TOWER))
    for prepare in (lambda: None, lambda: env.np_random, env.reset):
        prepare()
        assert tasks_of(duplicate(env)) != tasks_of(duplicate(env))
    env.reset(seed=3)
    assert tasks_of(duplicate(env)) == tasks_of(duplicate(env)) == tasks_of(env)


@pytest.mark.parametrize("wrappers", [[], [TextObservation]])
def test_async__refuses_shared_memory_for_texts(wrappers):
    with pytest.raises(ValueError, match=r'vector_kwargs={"shared_memory": False}, or observation="arrays"'):
        gym.make_vec(TOWER, num_envs=2, wrappers=wrappers, vectorization_mode="async")


@pytest.mark.parametrize("settings", [{"vector_kwargs": {"shared_memory": False}}, {"observation": "arrays"}])
def test_async__plays_texts_without_shared_memory_and_arrays_with_it(settings):
    each = gym.make_vec(TOWER, num_envs=2, vectorization_mode="async", **settings)
    expected = gym.make_vec(TOWER, num_envs=2, observation=settings.get("observation", "text"))
    assert_same(each.reset(seed=1)[0], expected.reset(seed=1)[0])
    each.close()


def test_masks__pass_through_vector_wrappers_of_the_package_and_of_gymnasium():
    envs = gym.make_vec(TOWER, num_envs=3)
    own = potential_shaping_v0(envs)
    wrapped = vector_wrappers.TransformReward(own, lambda reward: 2 * reward)
    wrapped = vector_wrappers.TransformObservation(wrapped, lambda observation: observation)
    wrapped = vector_wrappers.RecordEpisodeStatistics(vector_wrappers.NormalizeReward(wrapped))
    wrapped = vector_wrappers.DictInfoToList(wrapped)
    wrapped.reset(seed=0)
    for masks in (lilgym_mp.action_masks(wrapped), own.action_masks()):
        assert np.array_equal(masks, envs.action_masks())
    assert np.array_equal(own.goal_reached(), envs.goal_reached())
    assert not hasattr(gym.vector.VectorWrapper, "action_masks")  # Gymnasium's own classes are left alone


def test_masks__other_environments_have_none():
    envs = vector_wrappers.NormalizeReward(gym.make_vec("CartPole-v1", num_envs=2))
    with pytest.raises(TypeError, match="one of this package's environments"):
        lilgym_mp.action_masks(envs)


def test_actions__in_array_form_name_what_takes_them():
    single, envs = gym.make(TOWER), gym.make_vec(TOWER, num_envs=3)
    single.reset()
    with pytest.raises(ValueError, match=r"env\.unwrapped\.encode_action, or the wrapper MultiDiscreteActions"):
        single.step([1, 0, 2])
    envs.reset()
    with pytest.raises(ValueError, match="multi_discrete_actions_v0 for batches"):
        envs.step([[1, 0, 2]] * 3)
    assert envs.unwrapped.encode_action([1, 0, 2]) == single.unwrapped.encode_action([1, 0, 2])


def test_parts__that_do_not_exist_are_attribute_errors():
    for package in (lilgym_mp, lilgym_mp.envs, lilgym_mp.envs.cores, lilgym_mp.scene.render):
        with pytest.raises(AttributeError, match=f"module '{package.__name__}' has no attribute 'nothing'"):
            _ = package.nothing
