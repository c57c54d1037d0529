"""Compiled cores step batches exactly as the rules step single scenes, bit for bit; which core a batch has."""

import random
import sys
from functools import cache, partial

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from lilgym_mp.corpus.scene_walks import ScenePool
from lilgym_mp.envs import cores
from lilgym_mp.envs.cores import FEWEST_COMPILED
from lilgym_mp.envs.cores.scalar import ScalarCore
from lilgym_mp.envs.cores.scatter import ScatterCore
from lilgym_mp.envs.cores.tower import TowerCore
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Shape
from lilgym_mp.scene.actions import AddItem, RemoveItem
from lilgym_mp.testing import assert_same, check_vector_env
from tests.scenes import LARGE, SMALL, B, K, Y, circle, scene, square

TOWER, SCATTER = "lilgym_mp/TowerScratch-v0", "lilgym_mp/ScatterFlipIt-v0"


def sampler_of(starts):
    """Draws tasks with these start scenes, of a statement that is true of some."""
    program = "count(filter_color(all_items, Color.BLUE)) > 1"
    tasks = [Task(f"t{index}", "Blue is here.", program, index % 2 == 0, start) for index, start in enumerate(starts)]
    return lambda generator, env_id: tasks[generator.integers(len(tasks))]


@cache
def crowded_starts(appearance):
    """Some scenes of random play, and those with most items among those that batches have room for."""
    scenes = ScenePool.sample(appearance, random.Random(3), 24).scenes
    fitting = [scene for scene in scenes if max(len(box.items) for box in scene.boxes) < 10]
    return [*fitting[::40], *sorted(fitting, key=lambda scene: len(list(scene.items())))[-8:]]


@pytest.mark.parametrize(
    ("id", "settings", "steps"),
    [
        (TOWER, {}, 15),
        (TOWER, {"rules": "release"}, 15),
        (SCATTER, {}, 12),
        (SCATTER, {"rules": "release"}, 12),
        (SCATTER, {"rules": "release", "image_size": "native", "horizon": 1}, 5),
        (SCATTER, {"rules": "release", "grid": (38, 10)}, 8),
        (SCATTER, {"grid": (19, 1)}, 8),
        (SCATTER, {"rules": "release", "grid": (95, 4)}, 5),
    ],
    ids=str,
)
def test_compiled_core__plays_crowded_scenes_as_single_environments_do(id, settings, steps):
    appearance = "tower" if id == TOWER else "scatter"
    settings = {"sampler": sampler_of(crowded_starts(appearance)), **settings}
    make, single = partial(gym.make_vec, id, **settings), lambda: gym.make(id, **settings)
    check_vector_env(make, single, modes=[AutoresetMode.NEXT_STEP], steps=steps)


@pytest.mark.parametrize(
    ("there", "action"),
    [
        (square(66, 6, SMALL), AddItem(2, 0, Shape.TRIANGLE, B, LARGE)),
        (circle(3, 37), AddItem(0, 3, Shape.CIRCLE, K, LARGE)),
        (circle(40, 25), AddItem(3, 1, Shape.SQUARE, B, SMALL)),
    ],
    ids=["out above", "out to the left", "into another"],
)
def test_scatter_core__falls_back_after_a_release_snap(there, action):
    settings = {"rules": "release", "sampler": sampler_of([scene([there])])}
    envs, single = gym.make_vec(SCATTER, num_envs=9, **settings), gym.make(SCATTER, **settings)
    envs.reset(seed=0)
    single.reset(seed=0)
    for each in (action, AddItem(9, 2, Shape.CIRCLE, Y, SMALL), RemoveItem(9, 2)):
        index = single.unwrapped.dynamics.appearance.encode(each)
        image, images = single.step(index)[0]["image"], envs.step(np.full(9, index))[0]["image"]
        assert_same(images, np.stack([image] * 9))
        assert envs.states() == [single.unwrapped.state] * 9
        assert_same(envs.action_masks()[8], single.unwrapped.action_masks())


@pytest.mark.parametrize(("id", "compiled"), [(TOWER, TowerCore), (SCATTER, ScatterCore)])
def test_make_core__is_compiled_from_eight_environments_on(id, compiled):
    few, many = (gym.make_vec(id, num_envs=count) for count in (FEWEST_COMPILED - 1, FEWEST_COMPILED))
    assert [type(envs._engine.core) for envs in (few, many)] == [ScalarCore, compiled]


@pytest.fixture
def without_numba(monkeypatch):
    """Numba cannot be imported; the choice of cores is made afresh before and after the test."""
    for name in [name for name in sys.modules if name.startswith("lilgym_mp.envs.cores.")]:
        if name.rpartition(".")[2] not in ("base", "scalar"):
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "numba", None)
    cores._compiled.cache_clear()
    yield
    cores._compiled.cache_clear()


@pytest.mark.usefixtures("without_numba")
def test_batch__without_numba_gives_the_same_results_and_warns_once():
    make = partial(gym.make_vec, SCATTER)
    with pytest.warns(RuntimeWarning, match="several times slower .* numba cannot be imported"):
        make(num_envs=FEWEST_COMPILED)  # a second warning would be an error
    single = lambda: gym.make(SCATTER)  # noqa: E731
    check_vector_env(make, single, num_envs=FEWEST_COMPILED, modes=[AutoresetMode.NEXT_STEP], steps=5)
