"""A data set for imitation learning: states labelled with all their optimal actions, in one npz file.

States are starts, states of the expert's episodes with some exploration, or any given ones, such as those that a
learner visited (DAgger, Ross et al. 2011). docs/solver.md lists the arrays in the file.
"""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.actions import ActionType
from lilgym_mp.appearances import Appearance
from lilgym_mp.arrays import BoolArray, Int16Array, Int64Array
from lilgym_mp.observation import EMPTY
from lilgym_mp.rules import Dynamics, State
from lilgym_mp.scene import BOX_COUNT, Colour, Item, Scene, Shape, Size
from lilgym_mp.solver.demonstrations import write_npz
from lilgym_mp.solver.reports import map_chunks
from lilgym_mp.solver.solution import ActionSet
from lilgym_mp.solver.solver import Solver
from lilgym_mp.task import Task

FORMAT = "lilgym_mp action sets"
VERSION = 1
CHUNK_SIZE = 64  # tasks or states that a process gets at a time
ARRAY_TYPES: Mapping[str, tuple[str, int]] = {  # by array: dtype and number of axes
    "task": ("U", 1),
    "statement": ("U", 1),
    "program": ("U", 1),
    "target": ("?", 1),
    "state_task": ("i4", 1),
    "steps_taken": ("i2", 1),
    "origin": ("u1", 1),
    "item": ("i2", 2),
    "box_sizes": ("i2", 2),
    "action": ("i4", 1),
    "action_starts": ("i8", 1),
    "steps_to_go": ("i2", 1),
    "complete": ("?", 1),
}


class ActionSetFileError(ValueError):
    """A file that does not contain action sets, or contains unexpected ones."""


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
    order = sorted(range(len(tasks)), key=lambda index: tasks[index].program)  # tasks of one program share caches
    indexed = [(index, tasks[index]) for index in order]
    explore_chunk = partial(_explore_chunk, dynamics, budget, exploration, repeats, seed)
    by_task: list[list[LabelledState]] = [[] for _ in tasks]
    for index, states in zip(order, map_chunks(explore_chunk, indexed, jobs, CHUNK_SIZE), strict=True):
        by_task[index] = states
    return [state for states in by_task for state in states]


def label(
    states: Sequence[State], dynamics: Dynamics, *, jobs: int = 1, budget: int | None = None
) -> list[LabelledState]:
    """The given states with their optimal actions, in order.

    Raises ValueError if a state has no action left, or for fewer than one job.
    """
    order = sorted(range(len(states)), key=lambda index: states[index].task.program)
    found: list[ActionSet | None] = [None] * len(states)
    label_chunk = partial(_optimal_sets, dynamics, budget)
    answers = map_chunks(label_chunk, [states[index] for index in order], jobs, CHUNK_SIZE)
    for index, actions in zip(order, answers, strict=True):
        found[index] = actions
    pairs = zip(states, found, strict=True)
    return [LabelledState(state, actions, Origin.GIVEN) for state, actions in pairs if actions is not None]


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


@dataclass(frozen=True, slots=True, eq=False)
class ActionSets:
    """N states of T tasks as arrays; A and I are the total numbers of actions and items."""

    about: Mapping[str, Any]  # metadata: format, version, appearance, grid, rules, horizon, and what the caller added
    task: NDArray[np.str_]  # (T,) ids
    statement: NDArray[np.str_]  # (T,)
    program: NDArray[np.str_]  # (T,)
    target: BoolArray  # (T,)
    state_task: NDArray[np.int32]  # (N,) index of the state's task
    steps_taken: NDArray[np.int16]  # (N,) actions taken before the state
    origin: NDArray[np.uint8]  # (N,) `Origin`
    item: Int16Array  # (I, 5) x, y, shape, colour, size, state by state and box by box
    box_sizes: Int16Array  # (N, 3) number of items in each box
    action: NDArray[np.int32]  # (A,) action indices, ascending within each state
    action_starts: Int64Array  # (N + 1,) the actions of state i are at `action_starts[i]` to `[i + 1]`
    steps_to_go: Int16Array  # (N,) actions to success, STOP included; 0 where no solution is known
    complete: BoolArray  # (N,) whether every optimal action is included

    def __len__(self) -> int:
        return len(self.state_task)

    def items(self, capacity: int | None = None) -> Int16Array:
        """(N, 3, capacity, 5) items, padded as by `observation.item_array`; `capacity` defaults to the largest box.

        Raises ValueError if a box has more items.
        """
        largest = int(self.box_sizes.max(initial=0))
        capacity = largest if capacity is None else capacity
        if largest > capacity:
            raise ValueError(f"a box holds {largest} items; a capacity of {capacity} is too small")
        sizes = self.box_sizes.ravel().astype(np.int64)
        boxes = np.repeat(np.arange(len(sizes)), sizes)
        positions = np.arange(len(boxes)) - np.repeat(sizes.cumsum() - sizes, sizes)
        found = np.full((len(sizes), capacity, len(Item._fields)), EMPTY, np.int16)
        found[boxes, positions] = self.item
        return found.reshape(len(self), BOX_COUNT, capacity, len(Item._fields))

    def scenes(self) -> list[Scene]:
        """The scene of each state."""
        sizes = self.box_sizes.ravel().tolist()
        rows = iter(self.item.tolist())
        boxes = [[_item(next(rows)) for _ in range(size)] for size in sizes]
        return [Scene.of(*boxes[first : first + BOX_COUNT]) for first in range(0, len(boxes), BOX_COUNT)]


def _item(row: Sequence[int]) -> Item:
    x, y, shape, colour, size = row
    return Item(x, y, Shape(shape), Colour(colour), Size(size))


def pack_action_sets(states: Sequence[LabelledState], dynamics: Dynamics, about: Mapping[str, Any]) -> ActionSets:
    """The states as arrays, with `about` as additional metadata, e.g. on how they were made.

    `load_action_sets` checks the corpus by `about["corpus_sha256"]`. Raises ValueError for no states.
    """
    if not states:
        raise ValueError("there must be at least one state")
    tasks = list(dict.fromkeys(state.task for state, _, _ in states))
    indices = {task: index for index, task in enumerate(tasks)}
    boxes = [[len(box.items) for box in state.scene.boxes] for state, _, _ in states]
    items = [item for state, _, _ in states for item in state.scene.items()]
    sizes = [len(found.actions) for _, found, _ in states]
    return ActionSets(
        about={**about, "format": FORMAT, "version": VERSION, **_settings(dynamics)},
        task=np.array([task.id for task in tasks]),
        statement=np.array([task.statement for task in tasks]),
        program=np.array([task.program for task in tasks]),
        target=np.array([task.target for task in tasks]),
        state_task=np.array([indices[state.task] for state, _, _ in states], np.int32),
        steps_taken=np.array([state.steps for state, _, _ in states], np.int16),
        origin=np.array([origin for _, _, origin in states], np.uint8),
        item=np.array(items, np.int16).reshape(-1, len(Item._fields)),
        box_sizes=np.array(boxes, np.int16),
        action=np.array([action for _, found, _ in states for action in found.actions], np.int32),
        action_starts=np.cumsum([0, *sizes], dtype=np.int64),
        steps_to_go=np.array([found.steps for _, found, _ in states], np.int16),
        complete=np.array([found.complete for _, found, _ in states]),
    )


def _settings(dynamics: Dynamics) -> dict[str, Any]:
    grid = dynamics.appearance.grid
    return {
        "appearance": dynamics.appearance.name,
        "grid": None if grid is None else list(grid),
        "rules": dynamics.rules.name,
        "horizon": dynamics.horizon,
    }


def write_action_sets(path: Path, sets: ActionSets) -> None:
    """Writes a compressed npz file with `about` as JSON. Equal sets give equal bytes."""
    write_npz(path, {name: getattr(sets, name) for name in ARRAY_TYPES}, sets.about)


def load_action_sets(path: Path | str, *, corpus_sha256: str | None = None) -> ActionSets:
    """Reads a file written by `write_action_sets`.

    `corpus_sha256`: the checksum of the expected corpus, if it should be checked. Raises OSError if the file cannot be
    read, and ActionSetFileError if it is truncated or has another format, version or corpus.
    """
    path = Path(path)
    with path.open("rb") as file:
        try:
            with np.load(file, allow_pickle=False) as arrays:
                found: dict[str, Any] = {name: arrays[name] for name in ("about", *ARRAY_TYPES)}
            about = cast("dict[str, Any]", json.loads(str(found.pop("about"))))
        except KeyError as fault:
            raise ActionSetFileError(f"{path} does not contain action sets: {fault.args[0]}") from None
        except (ValueError, EOFError, OSError, AttributeError, TypeError, zipfile.BadZipFile, zlib.error) as fault:
            raise ActionSetFileError(f"{path} is not an npz file, or is truncated: {fault}") from None
    _check_about(path, about, corpus_sha256)
    _check_arrays(path, found)
    return ActionSets(about=about, **found)


def _check_about(path: Path, about: Mapping[str, Any], corpus_sha256: str | None) -> None:
    if about.get("format") != FORMAT:
        raise ActionSetFileError(f"{path} has format {about.get('format')!r}, not {FORMAT!r}")
    if about.get("version") != VERSION:
        raise ActionSetFileError(f"{path} has version {about.get('version')!r}; this package reads version {VERSION}")
    if corpus_sha256 is not None and about.get("corpus_sha256") != corpus_sha256:
        given = about.get("corpus_sha256")
        raise ActionSetFileError(f"{path} comes from the corpus with checksum {given}, not {corpus_sha256}")


def _check_arrays(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    for name, (dtype, axes) in ARRAY_TYPES.items():
        array = arrays[name]
        matches = array.dtype.kind == "U" if dtype == "U" else array.dtype == np.dtype(dtype)
        if not matches or array.ndim != axes:
            raise ActionSetFileError(
                f"{path}: {name} must have {axes} axes of {dtype}, not {array.dtype} of shape {array.shape}"
            )
    states = len(arrays["state_task"])
    starts, tasks = arrays["action_starts"], len(arrays["task"])
    consistent = (
        all(len(arrays[name]) == states for name in ("steps_taken", "origin", "box_sizes", "steps_to_go", "complete"))
        and all(len(arrays[name]) == tasks for name in ("statement", "program", "target"))
        and arrays["box_sizes"].shape[1:] == (BOX_COUNT,)
        and arrays["item"].shape == (arrays["box_sizes"].sum(), len(Item._fields))
        and len(starts) == states + 1
        and (np.diff(starts) >= 0).all()
        and (starts[0], starts[-1]) == (0, len(arrays["action"]))
        and ((arrays["state_task"] >= 0) & (arrays["state_task"] < tasks)).all()
    )
    if not consistent:
        raise ActionSetFileError(f"{path}: its arrays are inconsistent")
