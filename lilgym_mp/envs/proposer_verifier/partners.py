"""Partner policies: scripted ones, frozen models, and any callable.

A partner is a function of a `PartnerTurn`, which can be indexed like its observation: turn["action_mask"].
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol, SupportsIndex

import numpy as np
from gymnasium import spaces

from lilgym_mp.actions import ActionError
from lilgym_mp.arrays import Int8Array
from lilgym_mp.envs.proposer_verifier.engine import AgentObservation, GameEngine
from lilgym_mp.envs.proposer_verifier.game import Game, GameState
from lilgym_mp.envs.proposer_verifier.protocols import AGENTS, REJECT, STOP_ACTION, Role
from lilgym_mp.envs.proposer_verifier.rewards import Intent


class AgentAdapter(Protocol):
    """A game wrapper's effect on one agent."""

    @property
    def observation_space(self) -> spaces.Dict: ...

    @property
    def changes_rewards(self) -> bool: ...

    def reset(self) -> None:
        """Called after each reset, and again before the agent's first turn."""
        ...

    def rewards(self, rewards: Sequence[float]) -> Sequence[float]:
        """Both agents' rewards of the last turn, transformed; called once per turn."""
        ...

    def observation(self, observation: Mapping[str, Any]) -> dict[str, Any]:
        """The transformed {"observation", "action_mask"}."""
        ...

    def info(self, info: dict[str, Any], observe: Callable[[], Any]) -> dict[str, Any]:
        """The transformed info; `observe` returns the transformed observation."""
        ...

    def action(self, action: Any) -> Any:
        """The action for the wrapped environment."""
        ...


class PartnerError(ValueError):
    """A partner returned an illegal action."""


@dataclass
class PartnerTurn:
    """A partner's input: an agent's side of the game. Observation and mask are computed lazily."""

    engine: GameEngine
    role: Role
    rng: np.random.Generator
    adapters: tuple[AgentAdapter, ...] = ()  # of the game's wrappers, innermost first

    @property
    def game(self) -> Game:
        return self.engine.game

    @property
    def state(self) -> GameState:
        """The full state, including the truth: for scripted partners, not for learned policies."""
        return self.engine.state

    @cached_property
    def full_observation(self) -> AgentObservation:
        """{"observation": parts, "action_mask": int8 (actions,)}."""
        observation = self.engine.observe(self.role)
        for adapter in self.adapters:
            observation = adapter.observation(observation)
        return observation

    @cached_property
    def observation(self) -> dict[str, Any]:
        """The observation without the mask."""
        return self.full_observation["observation"] if self.adapters else self.engine.observe_parts(self.role)

    @cached_property
    def action_mask(self) -> Int8Array:
        if self.adapters:
            return self.full_observation["action_mask"]
        return self.game.legal_mask(self.state, self.role)

    def __getitem__(self, key: str) -> Any:
        return self.full_observation[key]

    def random_action(self, mask: Int8Array | None = None) -> int:
        """A uniformly random legal action, or action in `mask`."""
        legal = np.flatnonzero(self.action_mask if mask is None else mask)
        return int(legal[self.rng.integers(len(legal))])

    def game_action(self, action: Any) -> Any:
        """The game's action for an action of the agent above the adapters."""
        for adapter in reversed(self.adapters):
            action = adapter.action(action)
        return action


Partner = Callable[[PartnerTurn], SupportsIndex]


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
    return turn.game_action(index)


@dataclass(frozen=True)
class RandomPartner:
    """A uniformly random legal action, for either agent."""

    def __call__(self, turn: PartnerTurn) -> int:
        return turn.random_action()


@dataclass(frozen=True)
class OracleVerifier:
    """Accepts a claim if it holds, and every other proposal.

    `error_rate`: probability of the opposite judgement. With verdict bins it states the most extreme probability.
    """

    error_rate: float = 0.0

    def __post_init__(self) -> None:
        if not 0 <= self.error_rate <= 1:
            raise ValueError(f"error_rate must be between 0 and 1, not {self.error_rate!r}")

    def __call__(self, turn: PartnerTurn) -> int:
        game, state = turn.game, turn.state
        if state.proposal not in (None, STOP_ACTION):
            return encode_answer(game, accepts=True)
        holds = game.config.dynamics.goal_reached(state.mdp)
        errs = self.error_rate > 0 and turn.rng.random() < self.error_rate
        return encode_answer(game, accepts=holds != errs)


@dataclass(frozen=True)
class ConstantVerifier:
    """Accepts everything, or rejects everything."""

    accepts: bool

    def __call__(self, turn: PartnerTurn) -> int:
        return encode_answer(turn.game, accepts=self.accepts)


ALWAYS_ACCEPT = ConstantVerifier(accepts=True)
ALWAYS_REJECT = ConstantVerifier(accepts=False)


def encode_answer(game: Game, *, accepts: bool) -> int:
    """The verifier's action that accepts or rejects, with no message and the most extreme probability."""
    highest = (game.config.verdict_bins or 2) - 1  # ACCEPT, if there are no bins
    return game.encode_action(Role.VERIFIER, highest if accepts else REJECT)


@dataclass(frozen=True)
class ClaimingProposer:
    """Edits at random until a claim has the truth value that it seeks, then claims.

    `intent`: helpful seeks a true claim, sneaky a false one; None: the episode's intent. It makes at least `min_edits`
    edits, and after `max_edits` it claims in any case.
    """

    intent: Intent | None = None
    min_edits: int = 1
    max_edits: int = 8

    def __call__(self, turn: PartnerTurn) -> int:
        state, game = turn.state, turn.game
        seeks_truth = (state.intent if self.intent is None else self.intent) is Intent.HELPFUL
        edits = state.mdp.steps
        claim = game.encode_action(Role.PROPOSER, STOP_ACTION)
        if turn.action_mask[claim] and edits >= self.min_edits:
            fits_intent = game.config.dynamics.goal_reached(state.mdp) == seeks_truth
            if fits_intent or edits >= self.max_edits:
                return claim
        edit_mask = turn.action_mask.copy()
        edit_mask[: game.encode_action(Role.PROPOSER, STOP_ACTION + 1)] = 0
        return turn.random_action(edit_mask)


HELPFUL_PROPOSER = ClaimingProposer(Intent.HELPFUL)
SNEAKY_PROPOSER = ClaimingProposer(Intent.SNEAKY)


@dataclass(frozen=True)
class FrozenPolicy:
    """A trained model with Stable-Baselines3's `predict` as a partner.

    `masked`: for models that take `action_masks` (MaskablePPO). An illegal choice of an unmasked model is replaced by a
    random legal action.
    """

    model: Any
    masked: bool = True
    deterministic: bool = False

    def __call__(self, turn: PartnerTurn) -> int:
        masks = {"action_masks": turn.action_mask.astype(bool)} if self.masked else {}
        action, _ = self.model.predict(turn.observation, deterministic=self.deterministic, **masks)
        index = int(action)
        return index if turn.action_mask[index] else turn.random_action()


SCRIPTED: dict[str, Partner] = {
    "random": RandomPartner(),
    "oracle": OracleVerifier(),
    "always_accept": ALWAYS_ACCEPT,
    "always_reject": ALWAYS_REJECT,
    "helpful": HELPFUL_PROPOSER,
    "sneaky": SNEAKY_PROPOSER,
    "by_intent": ClaimingProposer(),
}
