"""Cores step batches exactly as the rules step single scenes, bit for bit."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from lilgym_mp.corpus import TaskSet
from lilgym_mp.envs import cores
from lilgym_mp.envs.buffers import INVALID_REASONS, NO_REASON, Buffers, buffer_specs
from lilgym_mp.envs.cores import FEWEST_COMPILED, Core, make_core
from lilgym_mp.envs.cores.scalar import ScalarCore
from lilgym_mp.envs.cores.scatter import ScatterCore
from lilgym_mp.envs.cores.tower import TowerCore
from lilgym_mp.envs.observation import item_capacity
from lilgym_mp.envs.rules import Dynamics, make_dynamics
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import BOX_SIDE, Box, Colour, Item, Scene, Shape, Size
from lilgym_mp.scene.actions import AddItem, RemoveItem
from lilgym_mp.scene.appearances import InvalidReason, Scatter, make_appearance
from lilgym_mp.scene.appearances.scatter.geometry import is_free
from lilgym_mp.scene.render import draw
from lilgym_mp.testing import check_vector_env
from tests.envs.alike import task_set
from tests.scenes import LARGE, SMALL, B, K, Y, circle, scene, square, tower

COUNT = 9
REMOVE_SHARE, STOP_SHARE, ANY_SHARE = 0.2, 0.05, 0.1
COPIED = ("image", "task", "steps", "result", "invalid")


def tasks_of(starts: list[Scene]) -> TaskSet:
    """A task with a start scene each, of a statement that is true of some."""
    program = "count(filter_color(all_items, Color.BLUE)) > 1"
    return task_set([Task(f"t{n}", "Blue is here.", program, n % 2 == 0, start) for n, start in enumerate(starts)])


def random_box(chance: np.random.Generator) -> Box:
    """Up to ten items that do not overlap."""
    items: list[Item] = []
    for _ in range(chance.integers(10)):
        size = Size(int(chance.integers(3)))
        x, y = chance.integers(0, BOX_SIDE - size.pixels, 2, endpoint=True).tolist()
        item = Item(x, y, Shape(int(chance.integers(3))), Colour(int(chance.integers(3))), size)
        if is_free(item.footprint, x, y, items):
            items.append(item)
    return Box(tuple(items))


def random_starts(appearance: str) -> list[Scene]:
    chance = np.random.default_rng(0)
    if appearance == "scatter":
        return [Scene.empty(), *(Scene((random_box(chance),) * 2 + (Box(),)) for _ in range(12))]
    colours = [[Colour(c) for c in chance.integers(3, size=chance.integers(5)).tolist()] for _ in range(36)]
    return [Scene.empty(), *(scene(*(tower(*box) for box in colours[n : n + 3])) for n in range(0, 36, 3))]


class CoreUnderTest:
    """One core with its buffers."""

    def __init__(self, core: Callable[..., Core], dynamics: Dynamics, tasks: TaskSet, image_size: str = "half") -> None:
        capacity = item_capacity(tasks, dynamics)
        actions = dynamics.appearance.action_count
        self.buffers = Buffers.new(buffer_specs(COUNT, image_size, actions, capacity, AutoresetMode.NEXT_STEP))
        self.core = core(dynamics, tasks, self.buffers, image_size)

    def write_all(self) -> None:
        self.core.write_masks()
        self.core.write_goals()
        self.core.write_items()


def assert_equal(one: CoreUnderTest, other: CoreUnderTest) -> None:
    for side in (one, other):
        side.write_all()
    for name in (*COPIED, "mask", "goal", "items"):
        assert np.array_equal(getattr(one.buffers, name), getattr(other.buffers, name)), name
    for number in range(COUNT):
        assert one.core.state(number) == other.core.state(number)


def an_action(dynamics: Dynamics, mask: np.ndarray, chance: np.random.Generator) -> int:
    """Mostly a legal one, often a REMOVE; sometimes any, or STOP."""
    kind = chance.random()
    if kind < STOP_SHARE:
        return 0
    if kind < STOP_SHARE + ANY_SHARE:
        return int(chance.integers(len(mask)))
    legal = np.flatnonzero(mask)
    if isinstance(dynamics.appearance, Scatter):
        removes = legal[legal > dynamics.appearance.action_count * 27 // 28]
        if len(removes) and chance.random() < REMOVE_SHARE:
            legal = removes
    return int(chance.choice(legal))


def play(one: CoreUnderTest, other: CoreUnderTest, dynamics: Dynamics, task_count: int, steps: int) -> Counter[int]:
    """Plays both alike, some environments or all, restarting those that end and some that do not.

    Gives how often each reason to be invalid was met.
    """
    chance = np.random.default_rng(1)
    every = np.arange(COUNT)
    ends = np.array([result.ends for result in dynamics.step_results])
    met: Counter[int] = Counter()
    beginning = every
    for _ in range(steps):
        tasks = chance.integers(task_count, size=len(beginning))
        which = None if chance.random() < 0.3 else np.flatnonzero(chance.random(COUNT) < 0.7)
        for side in (one, other):
            side.core.start(beginning, tasks)
        assert_equal(one, other)
        actions = [an_action(dynamics, mask, chance) for mask in one.buffers.mask]
        for side in (one, other):
            side.buffers.action[:] = actions
            side.core.step(which)
        played = every if which is None else which
        met.update(one.buffers.invalid[played].tolist())
        ended = played[ends[one.buffers.result[played]]]
        beginning = np.union1d(ended, np.flatnonzero(chance.random(COUNT) < 0.02))
    assert_equal(one, other)
    return met


@pytest.mark.parametrize("rules", ["paper", "release"])
def test_tower_core__equals_the_scalar_core_over_long_runs(rules: str) -> None:
    dynamics = make_dynamics(make_appearance("tower"), rules)
    tasks = tasks_of(random_starts("tower"))
    play(
        CoreUnderTest(ScalarCore, dynamics, tasks), CoreUnderTest(TowerCore, dynamics, tasks), dynamics, len(tasks), 150
    )


@pytest.mark.parametrize(
    ("grid", "image_size", "horizon", "rules", "steps"),
    [
        ((19, 5), "half", None, "paper", 150),
        ((19, 5), "half", None, "release", 150),
        ((19, 5), "native", None, "release", 40),
        ((19, 5), "half", 1, "paper", 20),
        ((38, 10), "half", None, "release", 40),
        ((19, 1), "half", None, "paper", 40),
        ((95, 4), "half", None, "release", 20),
        ((380, 100), "half", None, "paper", 3),
    ],
    ids=str,
)
def test_scatter_core__equals_the_scalar_core_over_long_runs(
    grid: tuple[int, int], image_size: str, horizon: int | None, rules: str, steps: int
) -> None:
    dynamics = make_dynamics(make_appearance("scatter", grid), rules, horizon)
    tasks = tasks_of(random_starts("scatter"))
    sides = (
        CoreUnderTest(ScalarCore, dynamics, tasks, image_size),
        CoreUnderTest(ScatterCore, dynamics, tasks, image_size),
    )
    met = play(*sides, dynamics, len(tasks), steps)
    if steps >= 150:
        expected = set(InvalidReason) - {InvalidReason.FULL_TOWER, InvalidReason.EMPTY_TOWER}
        assert {INVALID_REASONS[number] for number in met if number != NO_REASON} == expected


@pytest.mark.parametrize(
    ("there", "action"),
    [
        (square(66, 6, SMALL), AddItem(2, 0, Shape.TRIANGLE, B, LARGE)),
        (circle(3, 37), AddItem(0, 3, Shape.CIRCLE, K, LARGE)),
    ],
    ids=["above", "left"],
)
def test_scatter_core__falls_back_after_a_release_snap_out_of_the_box(there: Item, action: AddItem) -> None:
    dynamics = make_dynamics(make_appearance("scatter"), "release")
    start = scene([there])
    tasks = tasks_of([start])
    arrays, loop = CoreUnderTest(ScatterCore, dynamics, tasks), CoreUnderTest(ScalarCore, dynamics, tasks)
    item = dynamics.appearance.apply(start, action, dynamics.rules.placement).scene.boxes[0].items[-1]
    assert min(item.x, item.y) < 0
    for side in (arrays, loop):
        side.core.start(np.arange(COUNT), np.zeros(COUNT, np.int64))
        for each in (action, RemoveItem(3, 0), AddItem(9, 2, Shape.CIRCLE, Y, SMALL)):
            side.buffers.action[:] = dynamics.appearance.encode(each)
            side.core.step(None)
    assert_equal(arrays, loop)
    assert np.array_equal(arrays.buffers.image[0], draw(arrays.core.state(0).scene, "half"))


def test_scatter_core__falls_back_if_items_overlap() -> None:
    dynamics = make_dynamics(make_appearance("scatter"), "release")
    tasks = tasks_of([scene([square(30, 30, colour=K), circle(40, 40, LARGE, B)]), scene([], [square(-2, 5)])])
    play(
        CoreUnderTest(ScalarCore, dynamics, tasks),
        CoreUnderTest(ScatterCore, dynamics, tasks),
        dynamics,
        len(tasks),
        30,
    )


@pytest.fixture
def fresh_choice() -> Iterator[None]:
    """Clears the cached choice of cores before and after the test."""
    cores._compiled.cache_clear()
    yield
    cores._compiled.cache_clear()


def core_of(dynamics: Dynamics, count: int) -> type:
    tasks = tasks_of([Scene.empty()])
    buffers = Buffers.new(buffer_specs(count, "half", dynamics.appearance.action_count, 4, AutoresetMode.NEXT_STEP))
    return type(make_core(dynamics, tasks, buffers, "half"))


@pytest.mark.parametrize(("appearance", "compiled"), [("tower", TowerCore), ("scatter", ScatterCore)])
def test_make_core__is_compiled_from_eight_environments_on(appearance: str, compiled: type) -> None:
    dynamics = make_dynamics(make_appearance(appearance))
    few, many = FEWEST_COMPILED - 1, FEWEST_COMPILED
    assert [core_of(dynamics, few), core_of(dynamics, many)] == [ScalarCore, compiled]


@pytest.fixture
def without_numba(fresh_choice: None, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith("lilgym_mp.envs.cores.")]:
        if name.rpartition(".")[2] not in ("base", "scalar"):
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "numba", None)


@pytest.mark.usefixtures("without_numba")
def test_batch__without_numba_gives_the_same_results_and_warns_once() -> None:
    make = partial(gym.make_vec, "lilgym_mp/ScatterFlipIt-v0")
    with pytest.warns(RuntimeWarning, match="several times slower .* numba cannot be imported"):
        make(num_envs=FEWEST_COMPILED)  # a second warning would be an error
    single = lambda: gym.make("lilgym_mp/ScatterFlipIt-v0")  # noqa: E731
    check_vector_env(make, single, num_envs=FEWEST_COMPILED, modes=[AutoresetMode.NEXT_STEP], steps=14)


@pytest.mark.parametrize("core", [ScalarCore, TowerCore])
def test_wait__takes_a_step_without_changing_the_scene(core: Callable[..., Core]):
    dynamics = make_dynamics(make_appearance("tower"), horizon=2)
    tasks = tasks_of(random_starts("tower"))
    side = CoreUnderTest(core, dynamics, tasks)
    some, everyone = np.array([1, 4]), np.arange(COUNT)
    side.core.start(everyone, everyone)
    for env_ids in (some, everyone):
        before = [side.core.state(env_id) for env_id in env_ids.tolist()]
        side.core.wait(env_ids)
        for env_id, state in zip(env_ids.tolist(), before, strict=True):
            transition = dynamics.wait(state)
            assert side.core.state(env_id) == transition.state
            assert side.buffers.result[env_id] == transition.result.code
