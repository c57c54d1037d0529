"""Partner policies: scripted ones, and any callable.

A partner is a function of a `PartnerTurn`, which can be indexed like its observation: turn["action_mask"]. It may also
have a method `batch(turn: BatchTurn)` that returns actions (k,), to act in many games at once; `BatchPartner` needs
nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.corpus import TaskSet
from lilgym_mp.envs.proposer_verifier.game import Game
from lilgym_mp.envs.proposer_verifier.game_arrays import GameState
from lilgym_mp.envs.proposer_verifier.observations import MASK, PARTS, AgentObservation, ObservedGames
from lilgym_mp.envs.proposer_verifier.protocols import ACCEPT, AGENTS, REJECT, STOP_ACTION, Role
from lilgym_mp.envs.proposer_verifier.rewards import Intent
from lilgym_mp.scene.actions import ActionError
from lilgym_mp.scene.arrays import AnyDict, BoolArray, Float64Array, Int8Array, Int64Array, Rng
from lilgym_mp.scene.choices import choose


class PartnerError(ValueError):
    """A partner returned an illegal action."""


@dataclass
class PartnerTurn:
    """A partner's input: an agent's side of one game. The observation is computed lazily."""

    games: ObservedGames
    role: Role
    rng: Rng
    index: int = 0  # of the game
    observe: Callable[[Role], AgentObservation] | None = None  # the observation as wrappers change it

    @property
    def game(self) -> Game:
        """The rules of the game being played."""
        return self.games.game

    @property
    def state(self) -> GameState:
        """The full state, including the truth: for scripted partners, not for learned policies."""
        return self.games.state(self.index)

    @cached_property
    def full_observation(self) -> AgentObservation:
        """{"observation": parts, "action_mask": int8 (actions,)}."""
        return self.games.observe(self.role, self.index) if self.observe is None else self.observe(self.role)

    @property
    def observation(self) -> AnyDict:
        """The observation without the mask."""
        return self.full_observation[PARTS]

    @property
    def action_mask(self) -> Int8Array:
        """(actions,) legal actions as 1, others as 0."""
        return self.full_observation[MASK]

    def __getitem__(self, key: str) -> Any:
        return self.full_observation[key]

    def random_action(self, mask: Int8Array | None = None) -> int:
        """A uniformly random legal action, or action in `mask`."""
        legal = np.flatnonzero(self.action_mask if mask is None else mask)
        return int(legal[self.rng.integers(len(legal))])

    def random_edit(self) -> int:
        """A uniformly random legal edit of the proposer, or any legal action if no edit is."""
        edits = self.action_mask.copy()
        edits[: self.game.encode_action(Role.PROPOSER, STOP_ACTION + 1)] = 0
        return self.random_action(edits if edits.any() else None)


@dataclass
class BatchTurn:
    """The turns of one agent in k games. Observations and masks are computed lazily."""

    games: ObservedGames
    role: Role
    indices: Int64Array  # (k,) of the games in the batch
    episodes: Int64Array  # (k,) a number for each game, never used again: for partners that keep a plan
    rngs: Sequence[Rng]  # (k,) each game's own
    endings: dict[int, str] = field(default_factory=dict[int, str])  # outcomes, by index, of games that a partner ends

    @classmethod
    def of(cls, turn: PartnerTurn) -> BatchTurn:
        """A turn in one game, with its mask."""
        batch = cls(turn.games, turn.role, np.array([turn.index]), np.zeros(1, np.int64), [turn.rng])
        batch.action_mask = turn.action_mask[None]
        return batch

    @property
    def tasks(self) -> TaskSet:
        """The tasks that the games are drawn from."""
        return self.games.game.tasks

    @property
    def game(self) -> Game:
        """The rules of the games being played."""
        return self.games.game

    @cached_property
    def observation(self) -> dict[str, NDArray[Any]]:
        """The parts of the agent's observations, arrays (k, ...)."""
        return {key: part.encode(self.indices) for key, part in self.games.parts[self.role].items()}

    @cached_property
    def action_mask(self) -> Int8Array:
        """(k, actions)"""
        return self.games.masks(self.role, self.indices)

    def are_legal(self, actions: Int64Array) -> BoolArray:
        """(k,) whether each of the actions (k,) is legal."""
        return self.action_mask[np.arange(len(actions)), actions] > 0

    @property
    def task_indices(self) -> Int64Array:
        """(k,) indices in `tasks`."""
        return self.games.tasks[self.indices]

    @property
    def is_edit(self) -> BoolArray:
        """(k,) whether an edit awaits the verifier's answer, rather than a claim or nothing."""
        return self.games.proposals[self.indices] > STOP_ACTION

    def goals_reached(self) -> BoolArray:
        """(k,) whether the statement has the target value: for scripted partners, not for learned policies."""
        return self.games.goals_reached()[self.indices]

    def answers(self, accepts: BoolArray) -> Int64Array:
        """(k,) the verifier's actions that accept or reject, without a message."""
        return self.game.encode_action(Role.VERIFIER, 1) * np.where(accepts, ACCEPT, REJECT)

    def uniform(self) -> Float64Array:
        """(k,) numbers from 0 to 1, each from its game's generator."""
        return np.array([rng.random() for rng in self.rngs])

    def random_actions(self) -> Int64Array:
        """(k,) uniformly random legal actions."""
        legal = self.action_mask
        ranks = (self.uniform() * legal.sum(1)).astype(np.int64)  # rank of the action among the legal ones of its row
        return (legal.cumsum(1, dtype=np.int64) > ranks[:, None]).argmax(1)


Partner = Callable[[PartnerTurn], SupportsIndex]


def checked_partner(partner: Any) -> Partner:
    """A partner itself, or that of a name in SCRIPTED.

    Raises ValueError naming the choices, TypeError unless it is callable.
    """
    if isinstance(partner, str):
        return choose("partner", partner, SCRIPTED)
    if callable(partner):
        return partner  # pyright: ignore[reportReturnType]
    raise TypeError(f"a partner must be callable with a PartnerTurn, not {partner!r}")


def partner_action(partner: Partner, turn: PartnerTurn) -> int:
    """The game's action for the partner's choice. Raises PartnerError naming the partner if it is illegal."""
    action = partner(turn)
    try:
        index = turn.game.checked_action(turn.role, action)
    except ActionError as error:
        raise PartnerError(f"partner {partner!r}: {error}") from None
    if not turn.action_mask[index]:
        name = turn.game.describe(turn.role, index)
        raise PartnerError(
            f"partner {partner!r} chose {index} ({name}), which is not legal for {AGENTS[turn.role]} now"
        )
    return index


def batch_actions(partner: Partner, turn: BatchTurn) -> Int64Array:
    """(k,) the partner's actions. Raises PartnerError naming the partner and its first illegal action."""
    batch: Callable[[BatchTurn], Any] | None = getattr(partner, "batch", None)
    if batch is None:
        singles = zip(turn.indices.tolist(), turn.rngs, strict=True)
        turns = [PartnerTurn(turn.games, turn.role, rng, index) for index, rng in singles]
        return np.array([partner_action(partner, single) for single in turns], np.int64)
    actions = np.asarray(batch(turn))
    if actions.shape != turn.indices.shape or actions.dtype.kind not in "iu":
        raise PartnerError(f"partner {partner!r} must return {len(turn.indices)} whole numbers, not {actions!r}")
    for action, mask in zip(actions.tolist(), turn.action_mask, strict=True):
        if not (0 <= action < len(mask) and mask[action]):
            raise PartnerError(f"partner {partner!r} chose {action}, which is not legal for {AGENTS[turn.role]} now")
    return actions.astype(np.int64, copy=False)


class BatchPartner:
    """A partner whose `batch` also plays single games."""

    def batch(self, turn: BatchTurn) -> Int64Array:
        """(k,) actions."""
        raise NotImplementedError

    def __call__(self, turn: PartnerTurn) -> int:
        return int(self.batch(BatchTurn.of(turn))[0])


@dataclass(frozen=True)
class RandomPartner:
    """A uniformly random legal action, for either agent."""

    def __call__(self, turn: PartnerTurn) -> int:
        return turn.random_action()

    def batch(self, turn: BatchTurn) -> Int64Array:
        """Legal actions drawn uniformly, one for each game of the turn."""
        return turn.random_actions()


@dataclass(frozen=True)
class OracleVerifier(BatchPartner):
    """Accepts a claim if it holds, and every other proposal.

    Args:
        error_rate: Probability of the opposite judgement.

    Raises:
        ValueError: For an `error_rate` outside 0 .. 1.
    """

    error_rate: float = 0.0

    def __post_init__(self) -> None:
        if not 0 <= self.error_rate <= 1:
            raise ValueError(f"error_rate must be between 0 and 1, not {self.error_rate!r}")

    def batch(self, turn: BatchTurn) -> Int64Array:
        errs = turn.uniform() < self.error_rate if self.error_rate else np.zeros(len(turn.indices), bool)
        return turn.answers(turn.is_edit | (turn.goals_reached() != errs))


@dataclass(frozen=True)
class ConstantVerifier(BatchPartner):
    """Accepts everything, or rejects everything."""

    accepts: bool

    def batch(self, turn: BatchTurn) -> Int64Array:
        return turn.answers(np.full(len(turn.indices), self.accepts))


@dataclass(frozen=True)
class TargetOnlyVerifier(BatchPartner):
    """Accepts a claim if the target value is False, and every edit: the baseline of verifiers that have learned only
    how often claims hold for each target value."""

    def batch(self, turn: BatchTurn) -> Int64Array:
        targets = np.array([turn.tasks[index].target for index in turn.task_indices.tolist()])
        return turn.answers(turn.is_edit | ~targets)


ALWAYS_ACCEPT = ConstantVerifier(accepts=True)


@dataclass(frozen=True)
class ClaimingProposer:
    """Edits at random until a claim has the truth value that it seeks, then claims.

    `intent`: helpful seeks a true claim, deceptive a false one; None: the episode's intent. It makes at
    least one edit, and after eight it claims in any case.
    """

    intent: Intent | None = None

    def __call__(self, turn: PartnerTurn) -> int:
        state = turn.state
        game = turn.game
        seeks_truth = (state.intent if self.intent is None else self.intent) is Intent.HELPFUL
        edits = state.mdp.steps
        claim = game.encode_action(Role.PROPOSER, STOP_ACTION)
        if turn.action_mask[claim] and edits >= 1:
            fits_intent = game.dynamics.goal_reached(state.mdp) == seeks_truth
            if fits_intent or edits >= 8:
                return claim
        return turn.random_edit()


SCRIPTED: dict[str, Partner] = {
    "random": RandomPartner(),
    "oracle": OracleVerifier(),
    "always_accept": ALWAYS_ACCEPT,
    "always_reject": ConstantVerifier(accepts=False),
    "target_only": TargetOnlyVerifier(),
    "helpful": ClaimingProposer(Intent.HELPFUL),
    "deceptive": ClaimingProposer(Intent.DECEPTIVE),
    "by_intent": ClaimingProposer(),
}
