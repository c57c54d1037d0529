"""What a policy is to an evaluation: a function. And the two that know nothing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from lilgym_mp.actions import STOP, Action, ActionType
from lilgym_mp.appearances import Appearance
from lilgym_mp.arrays import BoolArray, Int64Array, UInt8Array
from lilgym_mp.evaluation.decisions import PolicyOutput, certain
from lilgym_mp.rules import Dynamics, State
from lilgym_mp.solver import Solver

if TYPE_CHECKING:
    from lilgym_mp.evaluation.settings import Settings


class Observations(NamedTuple):
    """What B agents see, each in an episode of its own."""

    images: UInt8Array  # (B, 50, 190, 3)
    statements: tuple[str, ...]  # B
    targets: Int64Array  # (B,) 1: make the statement true, 0: make it false
    steps: Int64Array  # (B,) actions taken so far in the episode: 0 at its start
    episodes: Int64Array  # (B,) index of the episode within the evaluation, for policies that keep a plan


class Policy(Protocol):
    """Chooses an action for each of B agents. All chance comes from `rng`.

    A policy that never looks at the masks may have an attribute `needs_masks = False`: none are made for it then, and
    `legal` is an array of shape (B, 0). One with `needs_states = True`, which no learnt policy has, is called with a
    list of the MDPs' states as a fourth argument. One may have an attribute `stop_probabilities`: B numbers, 0 to 1,
    how probable STOP was to it in its latest call; they are kept with the episodes. One may have a method
    `output(legal, chosen)`, asked after a call where decisions are recorded: the `PolicyOutput` of that call, whose
    mask was `legal` and whose answer was `chosen`, or None.
    """

    def __call__(self, observations: Observations, legal: BoolArray, rng: np.random.Generator) -> Int64Array:
        """`legal`: (B, actions) the exact masks; a policy may ignore them. Gives (B,) action indices."""
        ...


@dataclass(frozen=True)
class RandomLegal:
    """Any legal action, all equally likely."""

    def __call__(self, observations: Observations, legal: BoolArray, rng: np.random.Generator) -> Int64Array:
        chosen = rng.integers(legal.sum(1))  # which of the legal actions, by row
        return (legal.cumsum(1) > chosen[:, None]).argmax(1)

    def output(self, legal: BoolArray, chosen: Int64Array) -> PolicyOutput:
        return PolicyOutput(legal / legal.sum(1, keepdims=True))


@dataclass(frozen=True)
class RandomUnmasked:
    """Any action, all equally likely."""

    def __call__(self, observations: Observations, legal: BoolArray, rng: np.random.Generator) -> Int64Array:
        return rng.integers(legal.shape[1], size=len(legal))

    def output(self, legal: BoolArray, chosen: Int64Array) -> PolicyOutput:
        return PolicyOutput(np.full(legal.shape, 1 / legal.shape[1]))


random_legal = RandomLegal()
random_unmasked = RandomUnmasked()


@dataclass(frozen=True)
class WithoutMask:
    """A policy that is told that every action is legal."""

    policy: Policy

    @property
    def stop_probabilities(self) -> Any:
        return getattr(self.policy, "stop_probabilities", None)

    def __call__(self, observations: Observations, legal: BoolArray, rng: np.random.Generator) -> Int64Array:
        return self.policy(observations, np.ones_like(legal), rng)

    def output(self, legal: BoolArray, chosen: Int64Array) -> PolicyOutput | None:
        return output_of(self.policy, np.ones_like(legal), chosen)


def output_of(policy: Policy, legal: BoolArray, chosen: Int64Array) -> PolicyOutput | None:
    """What the policy's latest call came to; None where it does not tell."""
    output: Callable[[BoolArray, Int64Array], PolicyOutput | None] | None = getattr(policy, "output", None)
    return None if output is None else output(legal, chosen)


@dataclass(frozen=True)
class RandomType:
    """STOP, ADD or REMOVE, equally likely, then any arguments, legal or not: random play of the released baselines."""

    appearance: Appearance
    needs_masks = False

    @classmethod
    def of(cls, settings: Settings) -> RandomType:
        return cls(settings.dynamics().appearance)

    def __call__(self, observations: Observations, legal: BoolArray, rng: np.random.Generator) -> Int64Array:
        types = rng.integers(len(ActionType), size=len(observations.statements))
        indices = self._by_type()
        return np.array([indices[kind][rng.integers(len(indices[kind]))] for kind in types.tolist()], np.int64)

    def output(self, legal: BoolArray, chosen: Int64Array) -> PolicyOutput:
        indices = self._by_type()
        probabilities = np.empty((len(chosen), self.appearance.action_count))
        for kind in indices:
            probabilities[:, kind] = 1 / (len(indices) * len(kind))
        return PolicyOutput(probabilities)

    def _by_type(self) -> list[list[int]]:
        return _action_types(self.appearance)


@cache
def _action_types(appearance: Appearance) -> list[list[int]]:
    """The action indices of each type."""
    types = [appearance.to_array(appearance.decode(index))[0] for index in range(appearance.action_count)]
    return [[index for index, found in enumerate(types) if found == kind] for kind in ActionType]


class ExpertPolicy:
    """Shortest solutions, over the rules and the programs; where it knows none it stops."""

    needs_masks = False
    needs_states = True

    def __init__(self, dynamics: Dynamics) -> None:
        self._dynamics = dynamics
        self._solver = Solver(dynamics)
        self._plans: dict[int, tuple[Action, ...]] = {}  # by episode

    @classmethod
    def of(cls, settings: Settings) -> ExpertPolicy:
        return cls(settings.dynamics())

    def __call__(
        self, observations: Observations, legal: BoolArray, rng: np.random.Generator, states: Sequence[State] = ()
    ) -> Int64Array:
        chosen: list[int] = []
        for episode, state in zip(observations.episodes.tolist(), states, strict=True):
            plan = self._plans.pop(episode, ()) if state.steps else ()
            action, *rest = plan or self._solver.solve_from(state).actions or (STOP,)
            self._plans[episode] = tuple(rest)
            chosen.append(self._dynamics.appearance.encode(action))
        return np.array(chosen, np.int64)

    def output(self, legal: BoolArray, chosen: Int64Array) -> PolicyOutput:
        return PolicyOutput(certain(chosen, self._dynamics.appearance.action_count))
