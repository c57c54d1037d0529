"""The expert as a policy."""

from __future__ import annotations

import numpy as np

from lilgym_mp.evaluation.decisions import PolicyOutput, one_hot
from lilgym_mp.evaluation.policies import Observations, Policy
from lilgym_mp.evaluation.settings import Settings
from lilgym_mp.scene.actions import STOP, Action
from lilgym_mp.scene.arrays import BoolArray, Int64Array
from lilgym_mp.solver import Solver


class ExpertPolicy(Policy):
    """Follows the solver's solutions; stops if it finds none."""

    needs_masks = False
    needs_states = True

    def __init__(self, settings: Settings) -> None:
        self._dynamics = settings.dynamics()
        self._solver = Solver(self._dynamics)
        self._plans: dict[int, tuple[Action, ...]] = {}  # keyed by episode

    def __call__(self, observations: Observations, legal: BoolArray, rng: np.random.Generator) -> Int64Array:
        chosen: list[int] = []
        for episode, state in zip(observations.episodes.tolist(), observations.states, strict=True):
            plan = self._plans.pop(episode, ()) if state.steps else ()
            action, *rest = plan or self._solver.solve_from(state).actions or (STOP,)
            self._plans[episode] = tuple(rest)
            chosen.append(self._dynamics.appearance.encode(action))
        return np.array(chosen, np.int64)

    def output(self, legal: BoolArray, chosen: Int64Array) -> PolicyOutput:
        return PolicyOutput(one_hot(chosen, self._dynamics.appearance.action_count))
