"""Replies of baselines: the expert's, random ones, and none."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping

import numpy as np

from lilgym_mp.contrib.rlvr.rows import Row, dynamics_of, solver_of
from lilgym_mp.corpus.generator import statements
from lilgym_mp.envs.rules import State
from lilgym_mp.scene.actions import STOP, Action, describe


def expert_reply(row: Row) -> str:
    """A right reply; empty where none is found."""
    if row.kind == "truth":
        return str(row.task.truth(row.task.start)).lower()
    if row.kind == "program":
        return row.task.program
    solver = solver_of(row.appearance)
    solution = solver.solve(row.task)
    if not solution.solved:  # the generator searches so, and finds more
        solution = solver.solve_distant(State(row.task, row.task.start, 0), 1)
    return "\n".join(map(describe, solution.actions))


def random_reply(row: Row, rng: random.Random) -> str:
    """A random plan of legal actions, truth value, or program of a statement of the same level."""
    if row.kind == "truth":
        return rng.choice(("true", "false"))
    if row.kind == "program":
        return next(statements(row.appearance, row.level or 1, rng)).program
    dynamics = dynamics_of(row.appearance)
    state, plan = dynamics.start(row.task), list[Action]()
    while len(plan) < dynamics.horizon and STOP not in plan:
        legal = np.flatnonzero(dynamics.legal_mask(state)).tolist()
        plan.append(dynamics.appearance.decode(rng.choice(legal)))
        state = dynamics.step(state, plan[-1]).state
    return "\n".join(map(describe, plan))


BASELINES: Mapping[str, Callable[[Row, random.Random], str]] = {
    "expert": lambda row, rng: expert_reply(row),
    "random": random_reply,
    "nothing": lambda row, rng: "",
}
