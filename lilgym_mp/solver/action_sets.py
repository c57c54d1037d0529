"""States with every good action: what a learner of sets imitates, made by the expert and kept in one file.

States are starts, states along the expert's paths with some exploration, or any that are given, such as those that a
learner visited (DAgger, Ross et al. 2011). docs/solver.md lists the arrays of the file.
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
from lilgym_mp.solver.reports import in_processes
from lilgym_mp.solver.solution import ActionSet
from lilgym_mp.solver.solver import Solver
from lilgym_mp.task import Task

FORMAT = "lilgym_mp action sets"
VERSION = 1
CHUNK = 64  # tasks or states handed to a process at a time
FORMS: Mapping[str, tuple[str, int]] = {  # by array: its type and number of axes
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
    """A file that does not hold sets of actions, or not those that are wanted."""


class Origin(IntEnum):
    """Where a state comes from."""

    START = 0
    PATH = 1  # on the way of the expert, or where exploration led
    GIVEN = 2


class LabelledState(NamedTuple):
    """A state and the first actions of shortest solutions from it."""

    state: State
    found: ActionSet
    origin: Origin


def explored(
    tasks: Sequence[Task],
    dynamics: Dynamics,
    *,
    exploration: float = 0.25,
    repeats: int = 1,
    seed: int = 0,
    jobs: int = 1,
    budget: int | None = None,
) -> list[LabelledState]:
    """The start of each task, and the states of `repeats` episodes from it, in the tasks' order.

    In each state one of the good actions is taken, all equally likely; with probability `exploration` it is instead a
    random legal edit: ADD or REMOVE with equal chances where both are possible, then any of those. An episode ends
    where STOP is taken, no solution is known or no further edit may be made. A start is listed once. Equal arguments
    give equal states, whatever the number of `jobs` (processes).

    Raises ValueError for an exploration outside of 0 .. 1, fewer than one repeat or job, a negative seed.
    """
    if not 0 <= exploration <= 1:
        raise ValueError(f"exploration must be a probability from 0 to 1, not {exploration}")
    if repeats < 1:
        raise ValueError(f"repeats must be at least 1, not {repeats}")
    if seed < 0:
        raise ValueError(f"seed must be at least 0, not {seed}")
    order = sorted(range(len(tasks)), key=lambda index: tasks[index].program)  # one program's share what is found out
    numbered = [(index, tasks[index]) for index in order]
    explore = partial(_explored, dynamics, budget, exploration, repeats, seed)
    by_task: list[list[LabelledState]] = [[] for _ in tasks]
    for index, states in zip(order, in_processes(explore, numbered, jobs, CHUNK), strict=True):
        by_task[index] = states
    return [state for states in by_task for state in states]


def labelled(
    states: Sequence[State], dynamics: Dynamics, *, jobs: int = 1, budget: int | None = None
) -> list[LabelledState]:
    """The given states with their sets, in their order. Raises ValueError where a horizon is over or for no jobs."""
    order = sorted(range(len(states)), key=lambda index: states[index].task.program)
    found: list[ActionSet | None] = [None] * len(states)
    answers = in_processes(partial(_sets, dynamics, budget), [states[index] for index in order], jobs, CHUNK)
    for index, actions in zip(order, answers, strict=True):
        found[index] = actions
    pairs = zip(states, found, strict=True)
    return [LabelledState(state, actions, Origin.GIVEN) for state, actions in pairs if actions is not None]


def _sets(dynamics: Dynamics, budget: int | None, states: Sequence[State]) -> list[ActionSet]:
    return Solver(dynamics, budget).optimal_sets(states)


def _explored(
    dynamics: Dynamics,
    budget: int | None,
    exploration: float,
    repeats: int,
    seed: int,
    numbered: Sequence[tuple[int, Task]],
) -> list[list[LabelledState]]:
    solver = Solver(dynamics, budget)
    found: list[list[LabelledState]] = []
    for number, task in numbered:
        start = dynamics.start(task)
        states = [LabelledState(start, solver.optimal_actions(start), Origin.START)]
        for repeat in range(repeats):
            random = np.random.default_rng((seed, number, repeat))
            states.extend(_episode(solver, start, exploration, random))
        found.append(states)
    return found


def _episode(solver: Solver, state: State, exploration: float, random: np.random.Generator) -> Iterator[LabelledState]:
    """The states after the start."""
    dynamics = solver.dynamics
    found = solver.optimal_actions(state)
    while state.steps < dynamics.horizon - 1 and found.actions:
        explores = random.random() < exploration
        number = _random_edit(dynamics, state, random) if explores else int(random.choice(found.actions))
        if number == 0:
            return
        state = dynamics.step(state, dynamics.appearance.decode(number)).state
        found = solver.optimal_actions(state)
        yield LabelledState(state, found, Origin.PATH)


def _random_edit(dynamics: Dynamics, state: State, random: np.random.Generator) -> int:
    """A legal edit, of each type as often; STOP, which is 0, where there is none."""
    legal = dynamics.legal_mask(state)
    adds = _adds(dynamics.appearance)
    kinds = [kind for kind in ((legal & adds).nonzero()[0], (legal & ~adds).nonzero()[0][1:]) if len(kind)]
    return int(random.choice(kinds[int(random.integers(len(kinds)))])) if kinds else 0


@cache
def _adds(appearance: Appearance) -> BoolArray:
    """(action_count,) which actions add."""
    arrays = (appearance.to_array(appearance.decode(number)) for number in range(appearance.action_count))
    return np.array([array[0] == ActionType.ADD for array in arrays])


# The file


@dataclass(frozen=True, slots=True, eq=False)
class ActionSets:
    """N states of T tasks with A actions and I items together, as arrays."""

    about: Mapping[str, Any]  # format, version, appearance, grid, rules, horizon, and what else was given to `write`
    task: NDArray[np.str_]  # (T,) ids
    statement: NDArray[np.str_]  # (T,)
    program: NDArray[np.str_]  # (T,)
    target: BoolArray  # (T,)
    state_task: NDArray[np.int32]  # (N,) index of the state's task
    steps_taken: NDArray[np.int16]  # (N,) actions before
    origin: NDArray[np.uint8]  # (N,) `Origin`
    item: Int16Array  # (I, 5) x, y, shape, colour, size, state by state and box by box
    box_sizes: Int16Array  # (N, 3) items in each box
    action: NDArray[np.int32]  # (A,) ascending in each state, as the appearance numbers them
    action_starts: Int64Array  # (N + 1,) the actions of state i are at `action_starts[i]` to `[i + 1]`
    steps_to_go: Int16Array  # (N,) actions to success, STOP included; 0 where no solution is known
    complete: BoolArray  # (N,) whether every good action is there

    def __len__(self) -> int:
        return len(self.state_task)

    def actions_of(self, index: int) -> NDArray[np.int32]:
        return self.action[self.action_starts[index] : self.action_starts[index + 1]]

    def items(self, capacity: int | None = None) -> Int16Array:
        """(N, 3, capacity, 5) as `observation.item_array`; by default as large as the fullest box.

        Raises ValueError when a box holds more.
        """
        most = int(self.box_sizes.max(initial=0))
        capacity = most if capacity is None else capacity
        if most > capacity:
            raise ValueError(f"a box holds {most} items; a capacity of {capacity} is too small")
        sizes = self.box_sizes.ravel().astype(np.int64)
        boxes = np.repeat(np.arange(len(sizes)), sizes)
        places = np.arange(len(boxes)) - np.repeat(sizes.cumsum() - sizes, sizes)
        found = np.full((len(sizes), capacity, len(Item._fields)), EMPTY, np.int16)
        found[boxes, places] = self.item
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


def action_sets(states: Sequence[LabelledState], dynamics: Dynamics, about: Mapping[str, Any]) -> ActionSets:
    """The states as arrays; `about` is kept beside them, so put into it what they were made from.

    A checksum `corpus_sha256` in it is what `load_action_sets` checks. Raises ValueError for no states.
    """
    if not states:
        raise ValueError("there are no states to keep")
    tasks = list(dict.fromkeys(state.task for state, _, _ in states))
    numbers = {task: number for number, task in enumerate(tasks)}
    boxes = [[len(box.items) for box in state.scene.boxes] for state, _, _ in states]
    items = [item for state, _, _ in states for item in state.scene.items()]
    sizes = [len(found.actions) for _, found, _ in states]
    return ActionSets(
        about={**about, "format": FORMAT, "version": VERSION, **_settings(dynamics)},
        task=np.array([task.id for task in tasks]),
        statement=np.array([task.statement for task in tasks]),
        program=np.array([task.program for task in tasks]),
        target=np.array([task.target for task in tasks]),
        state_task=np.array([numbers[state.task] for state, _, _ in states], np.int32),
        steps_taken=np.array([state.steps for state, _, _ in states], np.int16),
        origin=np.array([origin for _, _, origin in states], np.uint8),
        item=np.array(items, np.int16).reshape(-1, len(Item._fields)),
        box_sizes=np.array(boxes, np.int16),
        action=np.array([number for _, found, _ in states for number in found.actions], np.int32),
        action_starts=np.cumsum([0, *sizes], dtype=np.int64),
        steps_to_go=np.array([found.steps for _, found, _ in states], np.int16),
        complete=np.array([found.complete for _, found, _ in states]),
    )


def _settings(dynamics: Dynamics) -> dict[str, Any]:
    grid = getattr(dynamics.appearance, "grid", None)
    return {
        "appearance": dynamics.appearance.name,
        "grid": None if grid is None else list(grid),
        "rules": dynamics.rules.name,
        "horizon": dynamics.horizon,
    }


def write_action_sets(path: Path, sets: ActionSets) -> None:
    """An npz file, compressed, with `about` as JSON; equal sets give equal bytes."""
    text = json.dumps(sets.about, ensure_ascii=False, sort_keys=True)
    with path.open("wb") as file:
        np.savez_compressed(file, about=np.array(text), **{name: getattr(sets, name) for name in FORMS})


def load_action_sets(path: Path | str, *, corpus_sha256: str | None = None) -> ActionSets:
    """The sets in a file that `write_action_sets` wrote.

    `corpus_sha256`: the checksum of the corpus that they must come from. Raises OSError where the file cannot be
    read, ActionSetFileError for a file of another form, version or corpus, or one that is cut off.
    """
    path = Path(path)
    with path.open("rb") as file:
        try:
            with np.load(file, allow_pickle=False) as arrays:
                found: dict[str, Any] = {name: arrays[name] for name in ("about", *FORMS)}
            about = cast("dict[str, Any]", json.loads(str(found.pop("about"))))
        except KeyError as fault:
            raise ActionSetFileError(f"{path} holds no sets of actions: {fault.args[0]}") from None
        except (ValueError, EOFError, OSError, AttributeError, TypeError, zipfile.BadZipFile, zlib.error) as fault:
            raise ActionSetFileError(f"{path} is no npz file, or it is cut off: {fault}") from None
    _check_about(path, about, corpus_sha256)
    _check_arrays(path, found)
    return ActionSets(about=about, **found)


def _check_about(path: Path, about: Mapping[str, Any], corpus_sha256: str | None) -> None:
    if about.get("format") != FORMAT:
        raise ActionSetFileError(f"{path} is of the format {about.get('format')!r}, not {FORMAT!r}")
    if about.get("version") != VERSION:
        raise ActionSetFileError(f"{path} is of version {about.get('version')!r}; this package reads {VERSION}")
    if corpus_sha256 is not None and about.get("corpus_sha256") != corpus_sha256:
        given = about.get("corpus_sha256")
        raise ActionSetFileError(f"{path} comes from the corpus with checksum {given}, not {corpus_sha256}")


def _check_arrays(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    for name, (kind, axes) in FORMS.items():
        array = arrays[name]
        fits = array.dtype.kind == "U" if kind == "U" else array.dtype == np.dtype(kind)
        if not fits or array.ndim != axes:
            raise ActionSetFileError(f"{path}: {name} must have {axes} axes of {kind}, not {array.dtype} {array.shape}")
    states = len(arrays["state_task"])
    starts, tasks = arrays["action_starts"], len(arrays["task"])
    agree = (
        all(len(arrays[name]) == states for name in ("steps_taken", "origin", "box_sizes", "steps_to_go", "complete"))
        and all(len(arrays[name]) == tasks for name in ("statement", "program", "target"))
        and arrays["box_sizes"].shape[1:] == (BOX_COUNT,)
        and arrays["item"].shape == (arrays["box_sizes"].sum(), len(Item._fields))
        and len(starts) == states + 1
        and (np.diff(starts) >= 0).all()
        and (starts[0], starts[-1]) == (0, len(arrays["action"]))
        and ((arrays["state_task"] >= 0) & (arrays["state_task"] < tasks)).all()
    )
    if not agree:
        raise ActionSetFileError(f"{path}: its arrays do not belong together")
