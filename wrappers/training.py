"""Wrappers for training and ablations, which change the tasks or shape the rewards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any

import gymnasium as gym
import numpy as np

from lilgym_mp.corpus import TaskSet
from lilgym_mp.corpus.matching import matching_corpus, with_permuted_boxes
from lilgym_mp.envs.rules import State, make_dynamics
from lilgym_mp.programs.task import Task
from lilgym_mp.scene.appearances import Appearance
from lilgym_mp.scene.arrays import Float64Array
from lilgym_mp.solver import Solver
from lilgym_mp.solver.solution import value
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.transformation import EnvDescription, TaskChange, Transformation


class BoxPermutation(EnvWrapper[TaskChange]):
    """Starts each episode with the boxes in a random order, drawn from the environment's generator.

    Each task of the corpus becomes up to six: "7" unchanged, and "7@021" .. "7@210", whose digits are the original
    boxes, left to right. Orders that change the statement's truth value, because it names a box, are omitted. Scratch
    tasks start empty, so they stay the same. For training only: `evaluation_tasks()` includes the permuted tasks.

    Must be applied before all other wrappers but NLVRReward.
    """

    transformation_class = partial(TaskChange, change=with_permuted_boxes)


class NLVRReward(EnvWrapper[TaskChange]):
    """Counts STOP as a success only in a scene that the corpus pairs with the statement and labels with the target
    value: the same items at the same positions in the same boxes, in any order. No program is run.

    Reward, outcome, `goal_reached()` and stop forcing are all affected. For the Scratch configurations; the scenes are
    the start scenes of the FlipIt tasks of the same corpus and split. Raises CorpusError for FlipIt.

    Must be applied before all other wrappers but BoxPermutation. Source: docs/spec.md, "NLVR reward".
    """

    transformation_class = partial(TaskChange, change=matching_corpus)


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


def _near_success_change(description: EnvDescription, *, edits: int, budget: int | None) -> TaskChange:
    mdp = description.dynamics
    change = partial(tasks_near_success, mdp.appearance, mdp.rules.name, mdp.horizon, edits, budget)
    return TaskChange(description, change=change, adds_items=True)


class ReverseCurriculum(EnvWrapper[TaskChange]):
    """Starts each episode `edits` edits from success, on a shortest solution of the drawn task.

    Tasks that need fewer edits, or that the expert cannot solve, keep their start; with `edits` 0 only STOP remains to
    be learned. All tasks are solved when the first such wrapper is made, which takes seconds for the official corpus.
    `budget`: scenes the expert may examine per task, None for its default. For training only.

    Must be applied before all other wrappers but those that also change the tasks. Raises WrongEnvironment for vector
    environments of Scatter, whose buffers are too small for such starts, and ValueError for a negative number of edits
    or a budget below 1. Source: Florensa et al. 2017.
    """

    transformation_class = staticmethod(_near_success_change)

    def __init__(self, env: gym.Env[Any, Any], edits: int, budget: int | None = None) -> None:
        super().__init__(env, edits=edits, budget=budget)


class Shaping(Transformation):
    """The potential of a state is the return of the expert's solution from it."""

    changes_rewards = True

    def __init__(self, description: EnvDescription, *, discount: float, budget: int | None) -> None:
        super().__init__(description)
        if not 0 <= discount <= 1:
            raise ValueError(f"discount must be between 0 and 1, not {discount!r}")
        self._discount = discount
        self._solver = Solver(description.dynamics, budget)
        self._known: dict[State, float] = {}  # potentials of the latest states: those after a step, before the next one

    def potentials(self, states: Sequence[State]) -> Float64Array:
        known = self._known
        self._known = {state: known[state] if state in known else self._potential(state) for state in states}
        return np.array([self._known[state] for state in states], np.float64)

    def _potential(self, state: State) -> float:
        dynamics = self.env_description.dynamics
        if state.steps == dynamics.horizon:
            return 0.0
        return value(self._solver.solve_from(state), dynamics, self._discount)

    def rewards(self, rewards: Float64Array, before: Float64Array, after: Float64Array) -> Float64Array:
        return rewards + self._discount * after - before


class PotentialShaping(EnvWrapper[Shaping]):
    """Adds `discount` * potential(after) - potential(before) to each reward.

    The potential of a state is the return of the expert's solution from it, and 0 after the end of the episode. This
    preserves optimal policies. With discount 1 and shortest solutions by the expert, an optimal action gets reward 0,
    any other minus the return it loses. Each episode's return is reduced by the potential of its start. Infos keep the
    environment's reward as "unshaped_reward". Not for the proposer-verifier game.

    The expert solves every state visited: about 0.1 ms in Tower, 1 ms in Scatter, sometimes much more. `budget`: scenes
    it may examine per state, None for its default; a state that it cannot solve counts as lost.
    Raises ValueError for a discount outside 0 .. 1 or a budget below 1. Source: Ng, Harada, Russell 1999.
    """

    def __init__(self, env: gym.Env[Any, Any], discount: float = 1.0, budget: int | None = None) -> None:
        super().__init__(env, discount=discount, budget=budget)
