"""Many episodes of one MDP at once: `rules.Dynamics` over the arrays of a `Block`.

`EpisodeLoop` steps one state after another and serves every appearance; `tower_arrays.TowerArrays` and, for many
environments, `scatter_arrays.ScatterArrays` do the same with array operations, or compiled where numba is installed.
"""

from __future__ import annotations

import os
import warnings
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import Protocol

from lilgym_mp.appearances import Scatter, Tower
from lilgym_mp.corpus import TaskSet
from lilgym_mp.envs.block import NO_REASON, REASON_NUMBERS, VALID_EDIT, Block, Int64Array
from lilgym_mp.envs.scatter_arrays import Makers, ScatterArrays
from lilgym_mp.envs.tower_arrays import TowerArrays
from lilgym_mp.observation import item_array
from lilgym_mp.render import Canvas
from lilgym_mp.rules import Dynamics, State

FEWEST_SCATTER_ARRAYS = 24  # environments: fewer are faster one after another, if masks are not asked for
FEWEST_COMPILED = 8  # likewise, with numba
NUMBA_SWITCH = "LILGYM_NUMBA"  # environment variable: 0 leaves numba unused where it is installed


class Core(Protocol):
    """N episodes, whose results go to the block: all but what `engine.Engine` tells of ends and starts.

    How many actions have been taken stands in the block alone (`wait` writes it).
    """

    def start(self, which: Int64Array, tasks: Int64Array) -> None:
        """Begins the tasks with those numbers in the environments `which`."""
        ...

    def step(self, which: Int64Array | None) -> None:
        """Takes `block.action` in the environments `which`, ascending, or in all."""
        ...

    def write_masks(self) -> None:
        """`block.mask` of all environments."""
        ...

    def write_goals(self) -> None:
        """`block.goal` of all environments."""
        ...

    def write_items(self) -> None:
        """`block.items` of all environments."""
        ...

    def state(self, number: int) -> State: ...


def make_core(dynamics: Dynamics, tasks: TaskSet, block: Block, image_size: str) -> Core:
    """The fastest core for the appearance and number of environments."""
    if isinstance(dynamics.appearance, Tower):
        return TowerArrays(dynamics, tasks, block, image_size)
    if isinstance(dynamics.appearance, Scatter) and len(block.action) >= FEWEST_COMPILED:
        makers = compiled_makers()
        if makers is not None or len(block.action) >= FEWEST_SCATTER_ARRAYS:
            return ScatterArrays(dynamics, tasks, block, image_size, makers)
    return EpisodeLoop(dynamics, tasks, block, image_size)


def wait(dynamics: Dynamics, block: Block, which: Int64Array) -> None:
    """`Dynamics.wait` in the environments `which`, whatever their core: the scene stays."""
    steps = block.steps[which] + 1
    block.steps[which] = steps
    block.verdict[which] = 2 * VALID_EDIT + (steps >= dynamics.horizon)
    block.invalid[which] = NO_REASON


def compiled_makers() -> Makers | None:
    """Of what numba compiles; None where it is not installed or switched off."""
    return None if os.environ.get(NUMBA_SWITCH) == "0" else installed_makers()


@cache
def installed_makers() -> Makers | None:
    """`compiled_makers`, switched off or not. Warns where numba is installed and cannot be used."""
    if find_spec("numba") is None:
        return None
    try:
        compiled = import_module("lilgym_mp.envs.scatter_compiled")
        return Makers(compiled.CompiledEdits, compiled.CompiledMasks)
    except (ImportError, RuntimeError) as fault:  # another NumPy than it knows; nowhere to keep what it compiles
        warnings.warn(f"going on without numba, {NUMBA_SWITCH}=0 silences this: {fault}", RuntimeWarning, stacklevel=2)
        return None


class EpisodeLoop:
    """A core of any appearance: one scene and one canvas an environment."""

    def __init__(self, dynamics: Dynamics, tasks: TaskSet, block: Block, image_size: str) -> None:
        self._dynamics = dynamics
        self._tasks = tasks
        self._block = block
        self._scenes = [tasks[0].start] * len(block.action)
        self._canvases = [Canvas(image_size, image) for image in block.image]

    def start(self, which: Int64Array, tasks: Int64Array) -> None:
        self._block.task[which] = tasks
        self._block.steps[which] = 0
        for number, task in zip(which.tolist(), tasks.tolist(), strict=True):
            scene = self._scenes[number] = self._tasks[task].start
            self._canvases[number].show(scene)

    def step(self, which: Int64Array | None) -> None:
        block, canvases = self._block, self._canvases
        step, decode = self._dynamics.step, self._dynamics.appearance.decode
        chosen = slice(None) if which is None else which
        numbers = range(len(canvases)) if which is None else which.tolist()
        columns = (array[chosen].tolist() for array in (block.action, block.task, block.steps))
        verdicts: list[int] = []
        reasons: list[int] = []
        for number, action, task, steps in zip(numbers, *columns, strict=True):
            state, verdict, invalid = step(State(self._tasks[task], self._scenes[number], steps), decode(action))
            if verdict.applies:
                self._scenes[number] = state.scene
                canvases[number].show(state.scene)
            verdicts.append(verdict.number)
            reasons.append(NO_REASON if invalid is None else REASON_NUMBERS[invalid])
        block.steps[chosen] += 1
        block.verdict[chosen] = verdicts
        block.invalid[chosen] = reasons

    def write_masks(self) -> None:
        for number, mask in enumerate(self._block.mask):
            mask[:] = self._dynamics.legal_mask(self.state(number))

    def write_goals(self) -> None:
        self._block.goal[:] = [self._dynamics.goal_reached(self.state(n)) for n in range(len(self._scenes))]

    def write_items(self) -> None:
        items = self._block.items
        for number, scene in enumerate(self._scenes):
            items[number] = item_array(scene, items.shape[2])

    def state(self, number: int) -> State:
        block = self._block
        return State(self._tasks[block.task[number]], self._scenes[number], int(block.steps[number]))
