"""Wrappers for training and ablations, which change the tasks or shape the rewards."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from lilgym_mp.corpus.matching import matching_corpus, with_permuted_boxes
from lilgym_mp.envs.rules import State
from lilgym_mp.scene.arrays import Float64Array
from lilgym_mp.solver import Solver
from lilgym_mp.solver.solution import value
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.transformation import EnvDescription, GymEnv, TaskChange, Transformation


class BoxPermutation(EnvWrapper[TaskChange]):
    """Starts each episode with the boxes in a random order, drawn from the environment's generator.

    Each task of the corpus becomes up to six: "7" unchanged, and "7@021" .. "7@210", whose digits are the original
    boxes, left to right. Orders that change the statement's truth value, because it names a box, are omitted. Scratch
    tasks start empty, so they stay the same. For training only: `evaluation_tasks()` includes the permuted tasks.

    Must be applied before all other wrappers but NLVRReward.

    Args:
        env: The environment to wrap.
    """

    transformation_class = partial(TaskChange, change=with_permuted_boxes)


class NLVRReward(EnvWrapper[TaskChange]):
    """Counts STOP as a success only in a scene that the corpus pairs with the statement and labels with the target
    value: the same items at the same positions in the same boxes, in any order. No program is run.

    Reward, outcome, `goal_reached()` and stop forcing are all affected. For the Scratch configurations; the scenes are
    the start scenes of the FlipIt tasks of the same corpus and split.

    Must be applied before all other wrappers but BoxPermutation. Source: docs/spec.md, "NLVR reward".

    Args:
        env: The environment to wrap.

    Raises:
        CorpusError: For FlipIt.
    """

    transformation_class = partial(TaskChange, change=matching_corpus)


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

    The expert solves every state visited: about 0.1 ms in Tower, 1 ms in Scatter, sometimes much more.
    Source: Ng, Harada, Russell 1999.

    Args:
        env: The environment to wrap.
        discount: The learner's discount, 0 .. 1.
        budget: Scenes that the expert may examine per state, None for its default; a state that it cannot solve counts
            as lost.

    Raises:
        ValueError: For a discount outside 0 .. 1 or a budget below 1.
    """

    transformation_class = Shaping

    def __init__(self, env: GymEnv, discount: float = 1.0, budget: int | None = None) -> None:
        super().__init__(env, discount=discount, budget=budget)
