"""One environment through Gymnasium's interface: checkers, seeding, tasks, episodes, faults, pictures."""

import copy
import pickle
import sys

import gymnasium as gym
import numpy as np
import pytest

from lilgym_mp.corpus import TaskSet, load_tasks
from lilgym_mp.envs.single import LilGymEnv
from lilgym_mp.scene.actions import ActionError
from lilgym_mp.scene.render import draw
from lilgym_mp.scene.render.frames import FRAME_SHAPE, SCENE_SHAPE, scene_picture
from lilgym_mp.testing import assert_same
from lilgym_mp.wrappers import TokenizedStatement
from tests.scenes import B, K, scene, tower

CONFIGURATIONS = {
    "lilgym_mp/TowerScratch-v0": ("tower", "scratch", 13),
    "lilgym_mp/TowerFlipIt-v0": ("tower", "flipit", 13),
    "lilgym_mp/ScatterScratch-v0": ("scatter", "scratch", 2661),
    "lilgym_mp/ScatterFlipIt-v0": ("scatter", "flipit", 2661),
}
DUPLICATES = pytest.mark.parametrize(
    "duplicate", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))], ids=["deepcopy", "pickle"]
)
TOWER, TOWER_FLIPIT, SCATTER, SCATTER_FLIPIT = CONFIGURATIONS
TWO = pytest.mark.parametrize("name", [TOWER, SCATTER_FLIPIT])

STOP = 0


def make(name, **settings):
    return gym.make(name, **settings).unwrapped


# What it is


@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_make__spaces_are_the_documented_ones(name):
    env = make(name)
    assert env.action_space == gym.spaces.Discrete(CONFIGURATIONS[name][2])
    assert env.observation_space["image"] == gym.spaces.Box(0, 255, (50, 190, 3), np.uint8)
    assert isinstance(env.observation_space["statement"], gym.spaces.Text)
    assert env.observation_space["target"] == gym.spaces.Discrete(2)


@TWO
def test_sb3_check__passes_without_a_warning_on_tokenised_statements(name):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(TokenizedStatement(gym.make(name)))


# Settings


@pytest.mark.parametrize(("grid", "count"), [((38, 10), 10_641), ([19, 1], 533), ("native", 1_064_001)])
def test_settings__grid(grid, count):
    env = make(SCATTER, grid=grid)
    env.reset(seed=0)
    assert env.action_space == gym.spaces.Discrete(count)
    assert env.step(count - 1)[4]["invalid_reason"] == "nothing_to_remove"


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"appearance": "towers"}, "'towers'; choose from scatter, tower"),
        ({"start": "flip"}, "'flip'; choose from flipit, scratch"),
        ({"split": "valid"}, "'valid'; choose from dev, test, train"),
        ({"rules": "lilgym"}, "'lilgym'; choose from paper, release"),
        ({"corpus": "nlvr"}, '\'nlvr\': no such file or directory; choose from "builtin", "lilgym", or'),
        ({"image_size": "full"}, "'full'; choose from half, native"),
        ({"observation": "pictures"}, "'pictures'; choose from arrays, text"),
        ({"render_mode": "video"}, "'video'; choose from ansi, human, rgb_array"),
        ({"appearance": "scatter", "grid": 5}, "'native' or a pair .* not 5"),
        *(({"horizon": horizon}, f"actions or None, not {horizon!r}") for horizon in (0, -1, "12")),
    ],
    ids=str,
)
def test_settings__unknown_values_are_refused_with_the_choices(settings, message):
    with pytest.raises(ValueError, match=message):
        LilGymEnv(**{"appearance": "tower", "start": "scratch", **settings})


# Seeding and tasks


@TWO
def test_evaluation_tasks__are_every_entry_once_in_file_order(name):
    env = make(name, split="dev")
    appearance, start, _ = CONFIGURATIONS[name]
    tasks = load_tasks("builtin", appearance, start, "dev")
    assert env.evaluation_tasks() == tuple(task.id for task in tasks)
    assert len(set(env.evaluation_tasks())) == len(tasks)
    for task in tasks:
        observation, info = env.reset(options={"task": task.id})
        assert info == {"task": task.id}
        assert (env.task, env.scene) == (task, task.start)
        assert observation["statement"] == task.statement
        assert observation["target"] == int(task.target)
        assert np.array_equal(observation["image"], draw(task.start, "half"))


def test_reset__draws_equal_single_draws_of_the_generator_also_of_a_replaced_one():
    env = make(TOWER)
    ids = env.evaluation_tasks()
    drawn = [env.reset(seed=None if number else 3)[1]["task"] for number in range(40)]
    env.np_random = np.random.default_rng(4)
    drawn += [env.reset()[1]["task"] for _ in range(3)]
    generators = [gym.utils.seeding.np_random(3)[0]] * 40 + [np.random.default_rng(4)] * 3
    assert drawn == [ids[generator.integers(len(ids))] for generator in generators]


def test_change_tasks__draws_from_the_changed_tasks_at_once():
    env = make(TOWER)
    env.reset(seed=3)
    env.change_tasks(lambda tasks: TaskSet(tasks[:2], tasks.provenance))
    assert {env.reset()[1]["task"] for _ in range(20)} == set(env.evaluation_tasks())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"task": "mine"}, "'mine' in corpus 'builtin', tower scratch, split 'train'; existing ids include"),
        ({"task": []}, r"no task \[\] in corpus"),
        ({"task": np.array(["a", "b"])}, r"no task array\(\['a', 'b'\].*\) in corpus"),
        ([1], r"mapping such as {'task': id}, not \[1\]"),
        ({"tasks": "a", "seed": 1}, r"\['seed', 'tasks'\]; choose from task"),
    ],
)
def test_reset__unknown_tasks_and_options_are_refused_and_the_episode_goes_on(options, message):
    env = make(TOWER)
    env.reset(seed=0)
    env.step(1)
    before = env.state
    with pytest.raises(ValueError, match=message):
        env.reset(options=options)
    assert env.state == before
    assert env.step(1)[1] == -0.1


# Episodes


def test_episode__success(own_corpus):
    env = make(TOWER_FLIPIT, corpus=own_corpus)
    observation, info = env.reset(options={"task": "blue-yes"})
    assert (observation["statement"], observation["target"], info) == ("Blue is here.", 0, {"task": "blue-yes"})
    assert env.scene == scene(tower(K), tower(B))
    observation, *rest = env.step(env.encode_action([2, 1, -1]))
    assert rest == [-0.1, False, False, {}]
    assert env.scene == scene(tower(K))
    assert np.array_equal(observation["image"], draw(scene(tower(K)), "half"))
    assert env.goal_reached()
    _, *rest = env.step(STOP)
    assert rest == [1.0, True, False, {"outcome": "success", "is_success": True}]


@pytest.mark.parametrize(("rules", "flags"), [("paper", [True, False]), ("release", [False, True])])
def test_episode__an_invalid_action_is_an_outcome(own_corpus, rules, flags):
    env = make(SCATTER_FLIPIT, corpus=own_corpus, rules=rules)
    env.reset(options={"task": "round-no"})
    before = env.scene
    _, *rest = env.step(env.encode_action([1, 6, 0, 0, 0, 0]))
    info = {"outcome": "invalid_action", "is_success": False, "invalid_reason": "separator"}
    assert rest == [-1.0, *flags, info]
    assert env.scene is before


# What must not be done


@pytest.mark.parametrize(
    "action",
    [1.0, True, "1", None, -1, 13, 2**70, [1], np.bool_(True), np.array([1, 2])],
    ids=repr,
)
def test_step__an_invalid_action_index_is_refused_and_changes_nothing(action):
    env = make(TOWER)
    env.reset(seed=0)
    before = env.state
    out_of_range = action in (-1, 13, 2**70) if isinstance(action, int) else False
    message = "out of range; choose from" if out_of_range else "an action must be a whole number"
    with pytest.raises(ActionError, match=rf"{message} 0 \.\. 12"):
        env.step(action)
    assert env.state == before


@pytest.mark.parametrize("action", [np.int64(1), np.uint8(1), np.int32(1), np.array(1)], ids=repr)
def test_step__accepts_numpy_integers(action):
    env = make(TOWER)
    env.reset(seed=0)
    assert env.step(action)[1] == -0.1


# State


@TWO
@DUPLICATES
def test_copy__continues_an_episode_independently(name, duplicate):
    env = make(name)
    env.reset(seed=4)
    env.step(1)
    other = duplicate(env)
    first = [env.step(2), env.step(STOP), env.reset()]
    assert other.state.steps == 1
    assert_same(first, [other.step(2), other.step(STOP), other.reset()])
    assert env.state is not other.state


# Pictures


def test_render__text_shows_statement_target_and_last_outcome(own_corpus):
    env = make(TOWER, corpus=own_corpus, render_mode="ansi")
    env.reset(seed=0)
    assert env.render().splitlines()[-2:] == ["Blue is here.", "Make it true.  Action 0 of 12."]
    env.step(3)
    assert env.render().splitlines()[-2:] == [
        "Make it true.  Action 1 of 12.",
        "ADD(LEFT, BLUE): continues, reward -0.1",
    ]
    env.step(12)
    assert env.render().splitlines()[-1] == "REMOVE(RIGHT): invalid_action (empty_tower), reward -1.0"
    env.reset()
    assert env.render().splitlines()[-1] == "Make it true.  Action 0 of 12."


def test_render__picture_shows_scene_and_caption_and_cells_on_request(own_corpus):
    env = make(TOWER, corpus=own_corpus, render_mode="rgb_array")
    env.reset(seed=0)
    first = env.render()
    env.step(3)
    second = env.render()
    assert (second.shape, second.dtype) == (FRAME_SHAPE, np.uint8)
    below = SCENE_SHAPE[0]
    assert np.array_equal(second[:below], scene_picture(scene(tower(B))))
    assert not np.array_equal(first[below:], second[below:])
    with_cells = make(TOWER, corpus=own_corpus, render_mode="rgb_array", render_cells=True)
    with_cells.reset(seed=0)
    assert np.array_equal(with_cells.render()[:below], scene_picture(scene(), env.dynamics.appearance))
    with pytest.raises(ValueError, match="render_cells must be True or False, not 'yes'"):
        make(TOWER, corpus=own_corpus, render_cells="yes")


def test_render__a_window_without_pygame_names_the_package_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "pygame", None)
    env = make(TOWER, render_mode="human")
    with pytest.raises(gym.error.DependencyNotInstalled, match=r'pip install "pygame>=.*the extra human'):
        env.reset(seed=0)
