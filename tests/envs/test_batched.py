import copy
import pickle
import sys
import tracemalloc
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.vector.utils import batch_space

from lilgym_mp.envs.batched import BatchedEnv
from lilgym_mp.envs.workers import WorkerVectorEnv
from lilgym_mp.scene.actions import ActionError
from lilgym_mp.testing import assert_same

IDS = [f"lilgym_mp/{appearance}{start}-v0" for appearance in ("Tower", "Scatter") for start in ("Scratch", "FlipIt")]
TOWER, SCATTER = IDS[0], IDS[3]


def batch(id, count, mode=AutoresetMode.NEXT_STEP, **settings):
    env = gym.make_vec(id, num_envs=count, autoreset_mode=mode, **settings)
    assert isinstance(env, BatchedEnv)
    return env


def test_no_copy__every_step_returns_the_same_image_buffer():
    env = batch(TOWER, 2, copy=False)
    first = env.reset(seed=0)[0]["image"]
    before = first.copy()
    second = env.step(np.array([1, 1]))[0]["image"]
    assert second is first
    assert not np.array_equal(first, before)


def test_seeds__of_a_list_or_array_go_to_the_environments_in_order():
    env, other = batch(TOWER, 4), batch(TOWER, 4)
    assert_same(env.reset(seed=[8, 9, 10, 11]), other.reset(seed=8))
    assert env.np_random_seed == (8, 9, 10, 11)
    assert_same(env.reset(seed=np.arange(4)), other.reset(seed=[0, 1, 2, 3]))


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, pickle.dumps])
def test_copy_and_pickle__are_refused(copied):
    with pytest.raises(TypeError, match="BatchedEnv"):
        copied(batch(TOWER, 3))


@pytest.mark.filterwarnings("default:This process.*is multi-threaded:DeprecationWarning")
@pytest.mark.parametrize(
    ("make", "mode", "count"),
    [
        (gym.make_vec, AutoresetMode.NEXT_STEP, 1),
        (gym.make_vec, AutoresetMode.NEXT_STEP, 64),
        (gym.make_vec, AutoresetMode.SAME_STEP, 7),
        (partial(WorkerVectorEnv, num_workers=3, start_method="fork"), AutoresetMode.NEXT_STEP, 6),
    ],
)
def test_evaluation__visits_every_task_once(make, mode, count):
    env = make("lilgym_mp/TowerFlipIt-v0", num_envs=count, autoreset_mode=mode, split="dev", evaluation=True)
    visited = []
    _, infos = env.reset(seed=0)
    current = infos["task"].copy()
    for _ in range(2 * len(env.evaluation_tasks())):  # an environment takes two steps for a task
        if env.evaluation_finished:
            break
        _, _, terminated, truncated, infos = env.step(np.zeros(count, np.int64))
        end_infos = infos.get("final_info", infos)
        for number in np.flatnonzero(terminated | truncated):
            if not end_infos["repeated"][number]:
                visited.append(current[number])
        if "task" in infos:
            current = np.where(infos["_task"], infos["task"], current)
    assert sorted(visited) == sorted(env.evaluation_tasks())
    assert env.reset()[1]["task"][0] == env.evaluation_tasks()[0]
    assert not env.evaluation_finished
    env.close()


def test_scene_array__holds_the_items_of_each_box():
    env = batch("lilgym_mp/ScatterFlipIt-v0", 3)
    env.reset(seed=2)
    for array, state in zip(env.scene_array(), env.states(), strict=True):
        for slots, box in zip(array.tolist(), state.scene.boxes, strict=True):
            assert [tuple(slot) for slot in slots if slot[0] >= 0] == [tuple(item) for item in box.items]


def test_render__equals_frames_of_single_environments():
    mode = AutoresetMode.DISABLED
    ours = batch(TOWER, 2, mode, render_mode="rgb_array")
    theirs = SyncVectorEnv([lambda: gym.make(TOWER, render_mode="rgb_array")] * 2, autoreset_mode=mode)
    for actions in (None, np.array([1, 2]), np.array([10, 0])):
        for env in (ours, theirs):
            env.reset(seed=4) if actions is None else env.step(actions)
        assert_same(ours.render(), theirs.render())


@pytest.mark.parametrize(
    ("actions", "message"),
    [
        ([0, 0], r"3 whole numbers, one for each environment, not int64 of shape \(2,\)"),
        ([0.0, 1.0, 2.0], r"not float64 of shape \(3,\)"),
        ([0, 13, 0], "13 of environment 1 is out of range; choose from 0 .. 12"),
        ([0, 0, -1], "-1 of environment 2"),
        ([True, False, True], "not bool"),
        ("STOP", "not <U4"),
    ],
)
def test_step__invalid_actions_are_refused(actions, message):
    env = batch(TOWER, 3)
    env.reset(seed=0)
    before = env.states()
    with pytest.raises(ActionError, match=message):
        env.step(actions)
    assert env.states() == before


def test_step__ignores_the_action_of_an_environment_about_to_be_reset():
    env = batch(TOWER, 2)
    env.reset(seed=0)
    env.step(np.array([0, 1]))
    _, rewards, terminated, _, infos = env.step(np.array([99, 1]))
    assert (rewards[0], terminated[0], infos["_task"].tolist()) == (0.0, False, [True, False])


def test_observation_space__equals_gymnasiums_in_constant_memory():
    env = BatchedEnv(5, appearance="tower", start="scratch")
    image = env.observation_space["image"]
    assert image == batch_space(env.single_observation_space["image"], 5)
    assert all(getattr(image, name).strides[0] == 0 for name in ("low", "high", "bounded_below", "bounded_above"))
    assert env.reset(seed=0)[0] in env.observation_space
    assert image.sample().shape == (5, 50, 190, 3)


def test_step__without_autoreset_names_the_ended_environments():
    env = batch(TOWER, 3, AutoresetMode.DISABLED)
    env.reset(seed=0)
    env.step(np.array([1, 0, 0]))
    with pytest.raises(gym.error.ResetNeeded, match="environments 1, 2 have ended"):
        env.step(np.array([1, 1, 1]))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"num_envs": 0}, "not 0"),
        ({"autoreset_mode": "Never"}, "'Never'; choose from Disabled, NextStep, SameStep"),
        ({"copy": "x"}, "copy must be True or False, not 'x'"),
        ({"evaluation": "x"}, "evaluation must be True or False, not 'x'"),
        ({"render_mode": "human"}, "'human'; choose from ansi, rgb_array"),
    ],
)
def test_make__names_the_value_and_the_choices(settings, message):
    with pytest.raises(ValueError, match=message):
        BatchedEnv(**{"num_envs": 2, "appearance": "tower", "start": "scratch", **settings})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"seed": [1, 2]}, "one number or 3, one for each environment, not 2"),
        ({"seed": [1, 2, 1.5]}, "whole number, 0 or larger, not 1.5"),
        ({"options": {"tasks": "x"}}, r"\['tasks'\]; choose from reset_mask, task"),
        ({"options": {"task": []}}, "one id or 3, one for each environment, not 0"),
        ({"options": {"task": [[], 1, None]}}, r"no task \[\] in"),
        ({"options": {"reset_mask": np.zeros(3, bool)}}, "reset_mask selects no environment"),
        ({"options": {"reset_mask": [True, False, True]}}, r"bool array of shape \(3,\)"),
    ],
)
def test_reset__names_what_is_wrong(arguments, message):
    env = batch(TOWER, 3)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        env.reset(**arguments)


@pytest.mark.parametrize("mode", AutoresetMode)
def test_masked_reset__has_infos_of_the_reset_alone(mode):
    env = batch(TOWER, 2, mode)
    env.reset(seed=0)
    env.step(np.zeros(2, np.int64))
    _, infos = env.reset(options={"reset_mask": np.array([True, False])})
    assert infos.keys() == {"task", "_task"}
    assert infos["_task"].tolist() == [True, False]


@pytest.mark.long
def test_batched__does_not_leak_memory_over_a_long_run(own_corpus):
    env = batch(SCATTER, 8, copy=False, corpus=str(own_corpus))
    env.reset(seed=0)

    def play(steps):
        for _ in range(steps):
            env.step(env.action_space.sample(tuple(env.action_masks().astype(np.int8))))
        return tracemalloc.get_traced_memory()[0]

    play(30)
    tracemalloc.start()
    before = play(20)
    assert play(40) - before < 300_000
    tracemalloc.stop()


@pytest.mark.parametrize(("id", "count"), [(TOWER, 4), (TOWER, 9), (SCATTER, 9)])
def test_step__reads_no_enum_attributes_so_that_numpy_cannot_swallow_an_interrupt(id, count):
    env = batch(id, count)
    env.reset(seed=0)
    actions = np.random.default_rng(0).integers(13, size=(3, count))
    env.step(actions[0])  # programs are compiled now
    asked = []

    def note(frame, event, _):
        if event == "call" and frame.f_code.co_name == "__getattr__" and frame.f_code.co_filename.endswith("enum.py"):
            asked.append(str(frame.f_locals.get("name")))

    sys.setprofile(note)
    try:
        for chosen in actions:
            env.step(chosen)
    finally:
        sys.setprofile(None)
    assert not asked
