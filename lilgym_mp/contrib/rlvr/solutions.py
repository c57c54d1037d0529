"""Replies of baselines: the expert's, random ones, and none."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping
from functools import cache

import numpy as np

from lilgym_mp.contrib.rlvr.rows import Row, dynamics_of, scene_answer, solver_of
from lilgym_mp.corpus.generator import statements
from lilgym_mp.corpus.scene_sampling import SAMPLERS
from lilgym_mp.envs.rules import State
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import STOP, Action, describe

DRAWN, RANDOM, CROWDED = 1024, 48, 15  # scenes: drawn, and of these chosen evenly by size, and the largest


@cache
def constant_answers(appearance: str) -> tuple[Scene, ...]:
    """Scenes that could answer any scene row: the empty one, random and crowded ones, small ones first."""
    rng = random.Random(f"answers {appearance}")
    drawn = sorted((SAMPLERS[appearance].scene(rng) for _ in range(DRAWN)), key=_size)
    return (Scene.empty(), *drawn[:: DRAWN // RANDOM], *drawn[-CROWDED:])


def _size(scene: Scene) -> int:
    return sum(1 for _ in scene.items())


def expert_reply(row: Row) -> str:
    """A right reply; empty where none is found."""
    if row.kind == "truth":
        return str(row.task.truth(row.task.start)).lower()
    if row.kind == "program":
        return row.task.program
    if row.kind == "plan":
        solver, state = solver_of(row.appearance), State(row.task, row.task.start, 0)
        solution = solver.solve(row.task)
        if not solution.solved:  # the generator searches so, and finds more
            solution = solver.solve_distant(state, 1)
        return "\n".join(map(describe, solution.actions))
    scene = next(filter(row.task.solved_by, constant_answers(row.appearance)), None) or _solved_scene(row)
    return "" if scene is None else scene_answer(scene, dynamics_of(row.appearance).appearance)


def _solved_scene(row: Row) -> Scene | None:
    """The scene at the end of the solver's plan."""
    dynamics = dynamics_of(row.appearance)
    state = dynamics.start(row.task)
    for action in solver_of(row.appearance).solve(row.task).actions:
        state = dynamics.step(state, action).state
    return state.scene if row.task.solved_by(state.scene) else None


def random_reply(row: Row, rng: random.Random) -> str:
    """A random plan of legal actions, truth value, scene, or program of a statement of the same level."""
    if row.kind == "truth":
        return rng.choice(("true", "false"))
    if row.kind == "program":
        return next(statements(row.appearance, row.level or 1, rng)).program
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
