"""A data set for imitation learning: states labelled with all their optimal actions, in one npz file.

States are starts, states of the expert's episodes with some exploration, or any given ones, such as those that a
learner visited (DAgger, Ross et al. 2011). docs/solver.md lists the arrays in the file.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from enum import IntEnum
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.envs.rules import Dynamics, State
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Item
from lilgym_mp.scene.actions import ActionType
from lilgym_mp.scene.appearances import Appearance
from lilgym_mp.scene.arrays import BoolArray
from lilgym_mp.solver.demonstrations import write_npz
from lilgym_mp.solver.reports import Input, Output, map_chunks
from lilgym_mp.solver.solution import ActionSet
from lilgym_mp.solver.solver import Solver

FORMAT = "lilgym_mp action sets"
VERSION = 1
CHUNK_SIZE = 64  # tasks or states that a process gets at a time


class Origin(IntEnum):
    """Where a state comes from."""

    START = 0
    PATH = 1  # a later state of an exploring episode
    GIVEN = 2


class LabelledState(NamedTuple):
    """A state with the first actions of shortest solutions from it."""

    state: State
    found: ActionSet
    origin: Origin


def explore(
    tasks: Sequence[Task],
    dynamics: Dynamics,
    *,
    exploration: float = 0.25,
    repeats: int = 1,
    seed: int = 0,
    jobs: int = 1,
    budget: int | None = None,
) -> list[LabelledState]:
    """The start of each task, followed by the states of `repeats` episodes from it, in the order of the tasks.

    In each state one of the optimal actions is drawn uniformly or, with probability `exploration`, a random legal edit:
    its type first, ADD or REMOVE with equal probability if both are legal, then one edit of that type. An episode ends
    with STOP, where no solution is known, or before the last step of the horizon. Equal arguments give equal states,
    whatever the number of processes, `jobs`.

    Raises ValueError for an exploration outside 0 to 1, fewer than one repeat or job, or a negative seed.
    """
    if not 0 <= exploration <= 1:
        raise ValueError(f"exploration must be a probability from 0 to 1, not {exploration}")
    if repeats < 1:
        raise ValueError(f"repeats must be at least 1, not {repeats}")
    if seed < 0:
        raise ValueError(f"seed must be at least 0, not {seed}")
    explore_chunk = partial(_explore_chunk, dynamics, budget, exploration, repeats, seed)
    programs = [task.program for task in tasks]
    by_task = _by_program(explore_chunk, list(enumerate(tasks)), programs, jobs)
    return [state for states in by_task for state in states]


def label(
    states: Sequence[State], dynamics: Dynamics, *, jobs: int = 1, budget: int | None = None
) -> list[LabelledState]:
    """The given states with their optimal actions, in order.

    Raises ValueError if a state has no action left, or for fewer than one job.
    """
    found = _by_program(
        partial(_optimal_sets, dynamics, budget), states, [state.task.program for state in states], jobs
    )
    return [LabelledState(state, actions, Origin.GIVEN) for state, actions in zip(states, found, strict=True)]


def _by_program(
    function: Callable[[Sequence[Input]], Sequence[Output]], inputs: Sequence[Input], programs: Sequence[str], jobs: int
) -> list[Output]:
    """`reports.map_chunks`, program by program, as tasks of one program share caches; the outputs are in order."""
    order = sorted(range(len(inputs)), key=programs.__getitem__)
    outputs = map_chunks(function, [inputs[index] for index in order], jobs, CHUNK_SIZE)
    found = dict(zip(order, outputs, strict=True))
    return [found[index] for index in range(len(inputs))]


def _optimal_sets(dynamics: Dynamics, budget: int | None, states: Sequence[State]) -> list[ActionSet]:
    return Solver(dynamics, budget).optimal_sets(states)


def _explore_chunk(
    dynamics: Dynamics,
    budget: int | None,
    exploration: float,
    repeats: int,
    seed: int,
    indexed: Sequence[tuple[int, Task]],
) -> list[list[LabelledState]]:
    solver = Solver(dynamics, budget)
    found: list[list[LabelledState]] = []
    for index, task in indexed:
        start = dynamics.start(task)
        states = [LabelledState(start, solver.optimal_actions(start), Origin.START)]
        for repeat in range(repeats):
            rng = np.random.default_rng((seed, index, repeat))
            states.extend(_episode(solver, start, exploration, rng))
        found.append(states)
    return found


def _episode(solver: Solver, state: State, exploration: float, rng: np.random.Generator) -> Iterator[LabelledState]:
    """The states of an episode after its start."""
    dynamics = solver.dynamics
    found = solver.optimal_actions(state)
    while state.steps < dynamics.horizon - 1 and found.actions:
        explores = rng.random() < exploration
        action = _random_edit(dynamics, state, rng) if explores else int(rng.choice(found.actions))
        if action == 0:
            return
        state = dynamics.step(state, dynamics.appearance.decode(action)).state
        found = solver.optimal_actions(state)
        yield LabelledState(state, found, Origin.PATH)


def _random_edit(dynamics: Dynamics, state: State, rng: np.random.Generator) -> int:
    """A legal ADD or REMOVE with equal probability; 0, i.e. STOP, if there is none."""
    legal = dynamics.legal_mask(state)
    adds = _adds(dynamics.appearance)
    by_type = [actions for actions in ((legal & adds).nonzero()[0], (legal & ~adds).nonzero()[0][1:]) if len(actions)]
    return int(rng.choice(by_type[int(rng.integers(len(by_type)))])) if by_type else 0


@cache
def _adds(appearance: Appearance) -> BoolArray:
    """(action_count,) whether each action is an ADD."""
    arrays = (appearance.to_array(appearance.decode(action)) for action in range(appearance.action_count))
    return np.array([array[0] == ActionType.ADD for array in arrays])


# The file


def write_action_sets(
    path: Path, states: Sequence[LabelledState], dynamics: Dynamics, about: Mapping[str, Any]
) -> None:
    """Writes a compressed npz file; `about` is added to its metadata. Equal states give equal bytes."""
    write_npz(path, action_set_arrays(states), {**about, "format": FORMAT, "version": VERSION, **_settings(dynamics)})


def action_set_arrays(states: Sequence[LabelledState]) -> dict[str, NDArray[Any]]:
    """The arrays of the file. Raises ValueError for no states."""
    if not states:
        raise ValueError("there must be at least one state")
    tasks = list(dict.fromkeys(state.task for state, _, _ in states))
    indices = {task: index for index, task in enumerate(tasks)}
    boxes = [[len(box.items) for box in state.scene.boxes] for state, _, _ in states]
    items = [item for state, _, _ in states for item in state.scene.items()]
    sizes = [len(found.actions) for _, found, _ in states]
    return {
        "task": np.array([task.id for task in tasks]),
        "statement": np.array([task.statement for task in tasks]),
        "program": np.array([task.program for task in tasks]),
        "target": np.array([task.target for task in tasks]),
        "state_task": np.array([indices[state.task] for state, _, _ in states], np.int32),
        "steps_taken": np.array([state.steps for state, _, _ in states], np.int16),
        "origin": np.array([origin for _, _, origin in states], np.uint8),
        "item": np.array(items, np.int16).reshape(-1, len(Item._fields)),
        "box_sizes": np.array(boxes, np.int16),
        "action": np.array([action for _, found, _ in states for action in found.actions], np.int32),
        "action_starts": np.cumsum([0, *sizes], dtype=np.int64),
        "steps_to_go": np.array([found.steps for _, found, _ in states], np.int16),
        "complete": np.array([found.complete for _, found, _ in states]),
    }


def _settings(dynamics: Dynamics) -> dict[str, Any]:
    grid = dynamics.appearance.grid
    return {
        "appearance": dynamics.appearance.name,
        "grid": None if grid is None else list(grid),
        "rules": dynamics.rules.name,
        "horizon": dynamics.horizon,
    }
