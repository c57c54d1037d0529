"""Replies of baselines: the expert's, random ones, and none."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping

import numpy as np

from lilgym_mp.actions import STOP, Action, describe
from lilgym_mp.corpus.scene_sampling import SAMPLERS
from lilgym_mp.generator import drafts
from lilgym_mp.rlvr.prompts import scene_answer
from lilgym_mp.rlvr.rows import Row, dynamics_of, solver_of


def expert_reply(row: Row) -> str:
    """A right reply; empty where the solver finds none."""
    if row.kind == "truth":
        return str(row.task.truth(row.task.start)).lower()
    if row.kind == "program":
        return row.task.program
    solution = solver_of(row.appearance).solve(row.task)
    if row.kind == "plan":
        return "\n".join(map(describe, solution.actions))
    dynamics = dynamics_of(row.appearance)
    state = dynamics.start(row.task)
    for action in solution.actions:
        state = dynamics.step(state, action).state
    return scene_answer(state.scene, dynamics.appearance)


def random_reply(row: Row, rng: random.Random) -> str:
    """A random plan of legal actions, truth value, scene, or program of a statement of the same level."""
    if row.kind == "truth":
        return rng.choice(("true", "false"))
    if row.kind == "program":
        return next(drafts(row.appearance, row.level or 1, rng)).program
    dynamics = dynamics_of(row.appearance)
    if row.kind == "scene":
        return scene_answer(SAMPLERS[row.appearance].scene(rng), dynamics.appearance)
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
