"""Tasks that callers choose: `Task`s given to `reset`, and samplers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces

from lilgym_mp.envs.observation import item_capacity
from lilgym_mp.envs.rules import Dynamics
from lilgym_mp.programs import compile_program
from lilgym_mp.programs.task import Task

if TYPE_CHECKING:
    from lilgym_mp.corpus.statement_arrays import StatementArrays

DRAWS = 16  # tasks drawn per call of the generator: the same numbers as drawn singly, in a quarter of the time
# Called at the start of every episode whose task the caller of `reset` did not choose, automatic resets included, with
# the environment's random generator and its index in the batch (0 for a single environment). Returns a `Task` or the id
# of one of the environment's, or None for a uniformly drawn one. Workers have copies, so there it must be picklable.
# A sampler may have `tasks`, a TaskSet that the environment plays instead of its corpus's.
Sampler = Callable[[np.random.Generator, int], "Task | str | None"]


def checked_task(task: Task, dynamics: Dynamics, capacity: int | None = None) -> Task:
    """`task`, if it can be played. `capacity`: items that fit a box's arrays.

    Raises ValueError for an unsuitable start or program, or too many items.
    """
    with naming(task):
        dynamics.appearance.check_scene(task.start)
        compile_program(task.program)
        if capacity is not None and (needed := item_capacity((task,), dynamics)) > capacity:
            raise ValueError(
                f"a box can come to have {needed} items, but this batch has room for {capacity}; use a single"
                " environment, a shorter horizon, or a configuration whose starts have as many"
            )
    return task


def check_statement(task: Task, space: spaces.Space[Any], arrays: StatementArrays | None) -> None:
    """Raises ValueError unless observations of `space` can show the task's statement."""
    with naming(task):
        if arrays is not None:
            arrays.row(task.statement)
        elif not space["statement"].contains(task.statement):  # pyright: ignore[reportIndexIssue]
            raise ValueError(f"its statement is not in {space['statement']}")  # pyright: ignore[reportIndexIssue]


@contextmanager
def naming(task: Task) -> Iterator[None]:
    """Names the task in a ValueError."""
    try:
        yield
    except ValueError as fault:
        raise ValueError(f"task {task.id!r} cannot be played here: {fault}") from None


def next_draws(generator: np.random.Generator, task_count: int) -> list[int]:
    """Indices of an environment's next tasks, uniformly drawn, in reverse: `pop` returns them in order."""
    return generator.integers(task_count, size=DRAWS)[::-1].tolist()
