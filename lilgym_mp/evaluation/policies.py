"""The interface of policies for evaluation, and the random baselines; these and the expert also by name."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.envs.registration import CONFIGURATIONS
from lilgym_mp.envs.rules import State
from lilgym_mp.scene.actions import STOP, Action, ActionType
from lilgym_mp.scene.appearances.base import action_arrays
from lilgym_mp.scene.arrays import AnyMapping, BoolArray, Int64Array, Rng, Strings, UInt8Array, one_hot
from lilgym_mp.scene.choices import choose

FloatArray = NDArray[np.floating[Any]]
GREEDY, SAMPLED, AS_TRAINED = ACTION_MODES = "greedy", "sampled", "as-trained"


class Observations(NamedTuple):
    """Observations of B environments.

    Attributes:
        images: uint8 (B, 50, 190, 3).
        statements: B statements.
        targets: int64 (B,), 1: make the statement true, 0: make it false.
        steps: int64 (B,), steps taken in the episode.
        episodes: int64 (B,), index of the episode within the evaluation, for policies that keep a plan.
        states: B states, for policies with `needs_states`; otherwise empty.
    """

    images: UInt8Array  # (B, 50, 190, 3)
    statements: Strings  # B
    targets: Int64Array  # (B,) 1: make the statement true, 0: make it false
    steps: Int64Array  # (B,) steps taken in the episode
    episodes: Int64Array  # (B,) index of the episode within the evaluation, for policies that keep a plan
    states: Sequence[State] = ()  # B, for policies with `needs_states`


class PolicyOutput(NamedTuple):
    """Outputs of a policy's latest call, for B states."""

    probabilities: FloatArray  # (B, actions) probability of each action; one-hot if the policy is deterministic
    values: FloatArray | None = None  # (B,) the critic's value estimates
    success_probabilities: Sequence[float] | None = None  # (B,) the planner's estimate for the current plan
    programs: Sequence[Mapping[str, float]] | None = None  # (B,) probabilities of the programs planned for
    notes: Sequence[Strings] | None = None  # (B,) lines about the statement, such as its unknown words


class Policy(ABC):
    """Chooses an action in each of B environments."""

    needs_masks: bool = True  # without, no masks are computed, and `legal` has shape (B, 0)
    needs_states: bool = False  # the policy reads `Observations.states`, which show the program (the expert)
    stop_probabilities: FloatArray | None = None  # (B,) of STOP in the latest call; stored with the episodes

    @abstractmethod
    def __call__(self, observations: Observations, legal: BoolArray, rng: Rng) -> Int64Array:
        """(B,) action indices. `legal`: (B, actions) exact masks; `rng` is the only source of randomness."""

    def output(self, legal: BoolArray, chosen: Int64Array) -> PolicyOutput | None:
        """The output of the latest call, for recordings; None if unknown.

        Args:
            legal: bool (B, actions), the masks of that call.
            chosen: int64 (B,), the actions chosen.
        """
        return None


Choose = Callable[[Observations, BoolArray, Rng], Int64Array]


@dataclass(frozen=True)
class FunctionPolicy(Policy):
    """A function as a policy."""

    function: Choose

    def __call__(self, observations: Observations, legal: BoolArray, rng: Rng) -> Int64Array:
        return self.function(observations, legal, rng)


def as_policy(policy: Policy | Choose) -> Policy:
    """The policy itself, or the function as a policy that needs masks."""
    return policy if isinstance(policy, Policy) else FunctionPolicy(policy)


@dataclass(frozen=True)
class RandomLegal(Policy):
    """Uniform over legal actions."""

    def __call__(self, observations: Observations, legal: BoolArray, rng: Rng) -> Int64Array:
        rank = rng.integers(legal.sum(1))  # rank of the action among the legal ones of its row
        return (legal.cumsum(1) > rank[:, None]).argmax(1)

    def output(self, legal: BoolArray, chosen: Int64Array) -> PolicyOutput:
        return PolicyOutput(legal / legal.sum(1, keepdims=True))


random_legal = RandomLegal()
# Uniform over all actions.
random_unmasked = FunctionPolicy(lambda observations, legal, rng: rng.integers(legal.shape[1], size=len(legal)))


class RandomType(Policy):
    """Uniform over STOP, ADD and REMOVE, then over arguments, legal or not: the released baselines' random policy."""

    needs_masks = False

    def __init__(self, settings: EnvConfig) -> None:
        types = action_arrays(settings.dynamics().appearance)[:, 0]
        self._indices = [np.flatnonzero(types == action_type) for action_type in ActionType]  # of the actions, by type

    def __call__(self, observations: Observations, legal: BoolArray, rng: Rng) -> Int64Array:
        types = rng.integers(len(ActionType), size=len(observations.statements))
        indices = [self._indices[action_type] for action_type in types.tolist()]
        return np.array([actions[rng.integers(len(actions))] for actions in indices], np.int64)


class ExpertPolicy(Policy):
    """Follows the solver's solutions; stops if it finds none."""

    needs_masks = False
    needs_states = True

    def __init__(self, settings: EnvConfig) -> None:
        from lilgym_mp.solver import Solver  # imported only for the expert: it is large

        self._dynamics = settings.dynamics()
        self._solver = Solver(self._dynamics)
        self._plans: dict[int, tuple[Action, ...]] = {}  # keyed by episode

    def __call__(self, observations: Observations, legal: BoolArray, rng: Rng) -> Int64Array:
        chosen: list[int] = []
        for episode, state in zip(observations.episodes.tolist(), observations.states, strict=True):
            plan = self._plans.pop(episode, ()) if state.steps else ()
            action, *rest = plan or self._solver.solve_from(state).actions or (STOP,)
            self._plans[episode] = tuple(rest)
            chosen.append(self._dynamics.appearance.encode(action))
        return np.array(chosen, np.int64)

    def output(self, legal: BoolArray, chosen: Int64Array) -> PolicyOutput:
        return PolicyOutput(one_hot(chosen, self._dynamics.appearance.action_count).astype(np.float64))


NO_SUPERVISION = "none"


@dataclass(frozen=True)
class NamedPolicy:
    """A policy for each configuration, with its name in tables and files."""

    name: str
    policy: Callable[[EnvConfig], Policy]
    supervision: str = NO_SUPERVISION  # training data, for result tables
    configurations: Strings = field(default_factory=lambda: tuple(CONFIGURATIONS))  # that it can play
    mask: bool | None = None  # whether illegal actions are masked; None: if the policy's `needs_masks` is true
    details: AnyMapping = field(default_factory=dict)  # further details needed to reproduce it


_SAMPLED = {"actions": "sampled"}

# By name on the command line.
BUILT_IN_POLICIES = {
    "expert": NamedPolicy("expert", ExpertPolicy, "knows the rules, the scene and the program"),
    "random-legal": NamedPolicy("random legal", lambda settings: random_legal, details=_SAMPLED),
    "random-unmasked": NamedPolicy("random unmasked", lambda settings: random_unmasked, mask=False, details=_SAMPLED),
    "random-type": NamedPolicy("random type", RandomType, details=_SAMPLED),
}
BASELINES = (BUILT_IN_POLICIES["random-legal"], BUILT_IN_POLICIES["random-unmasked"])


def built_in_policy(name: str) -> NamedPolicy:
    """Raises ValueError naming the choices."""
    return choose("policy", name, BUILT_IN_POLICIES)
