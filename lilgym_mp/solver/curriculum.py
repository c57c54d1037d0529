"""Tasks that start near their goal, for a reverse curriculum. Source: Florensa et al. 2017."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

from lilgym_mp.appearances import Appearance
from lilgym_mp.corpus import TaskSet
from lilgym_mp.rules import make_dynamics
from lilgym_mp.solver.solver import Solver
from lilgym_mp.task import Task

CACHE_SIZE = 8  # task sets


@lru_cache(maxsize=CACHE_SIZE, typed=True)  # typed: True must be refused even after a call with 1
def tasks_near_success(
    appearance: Appearance, rules: str, horizon: int, edits: int, budget: int | None, tasks: TaskSet
) -> TaskSet:
    """The tasks with their starts moved along a shortest solution, to where `edits` edits are left.

    A task that needs fewer edits, or has no known solution, keeps its start. Ids do not change.
    Raises ValueError for a negative number of edits or a budget below 1.
    """
    if isinstance(edits, bool) or not isinstance(edits, int) or edits < 0:  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ValueError(f"edits must be a whole number of at least 0, not {edits!r}")
    solver = Solver(make_dynamics(appearance, rules, horizon), budget)
    return TaskSet((_near_success(task, edits, solver) for task in tasks), tasks.provenance)


def _near_success(task: Task, edits: int, solver: Solver) -> Task:
    actions = solver.solve(task).actions
    state = solver.dynamics.start(task)
    for action in actions[: max(0, len(actions) - 1 - edits)]:
        state = solver.dynamics.step(state, action).state
    return replace(task, start=state.scene)
