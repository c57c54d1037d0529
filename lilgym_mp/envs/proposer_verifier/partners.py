"""Who can play the other side: scripted partners, frozen policies, and any callable.

A partner is a function of a `PartnerTurn`, which it may also read as its observation: turn["action_mask"].
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol, SupportsIndex

import numpy as np
from gymnasium import spaces

from lilgym_mp.actions import ActionError
from lilgym_mp.arrays import Int8Array
from lilgym_mp.envs.proposer_verifier.game import Game
from lilgym_mp.envs.proposer_verifier.protocols import REJECT
from lilgym_mp.envs.proposer_verifier.session import AgentObservation, Session
from lilgym_mp.envs.proposer_verifier.states import AGENTS, STOP_ACTION, GameState, Intent, Role


class RewardChange(Protocol):
    """How a wrapper changes both agents' rewards."""

    def start(self) -> None:
        """Called when an agent first has a turn."""
        ...

    def changed(self, rewards: Sequence[float]) -> Sequence[float]:
        """Both agents' rewards of the turn that was just played, after the change; called once a turn."""
        ...


class AgentAdapter(Protocol):
    """What a wrapper of the game changes for one agent."""

    @property
    def observation_space(self) -> spaces.Dict: ...

    @property
    def rewards(self) -> RewardChange | None:
        """None where rewards stay as they are."""
        ...

    def start(self) -> None:
        """Called after each reset."""
        ...

    def observation(self, observation: Mapping[str, Any]) -> dict[str, Any]:
        """{"observation", "action_mask"} after the change, from those before it."""
        ...

    def info(self, info: dict[str, Any], look: Callable[[], Any]) -> dict[str, Any]:
        """The info after the change; `look` gives the observation after it."""
        ...

    def action(self, action: Any) -> Any:
        """The action beneath the wrapper."""
        ...


class PartnerError(ValueError):
    """A partner returned an illegal action."""


@dataclass
class PartnerTurn:
    """What a partner is given in its turn. Observation and mask are made when first asked for."""

    session: Session
    role: Role
    rng: np.random.Generator
    adapters: tuple[AgentAdapter, ...] = ()  # of the wrappers that the agent acts through, the innermost first

    @property
    def game(self) -> Game:
        return self.session.game

    @property
    def state(self) -> GameState:
        """The whole state, truth included: for scripts, not for learned policies."""
        return self.session.state

    @cached_property
    def full_observation(self) -> AgentObservation:
        """{"observation": parts, "action_mask": int8 (actions,)}."""
        return adapted_observation(self.adapters, self.session.observe(self.role))

    @property
    def observation(self) -> dict[str, Any]:
        """The parts that the agent sees."""
        return self.full_observation["observation"]

    @cached_property
    def action_mask(self) -> Int8Array:
        if self.adapters:
            return self.full_observation["action_mask"]
        return self.game.legal_mask(self.state, self.role)

    def __getitem__(self, key: str) -> Any:
        return self.full_observation[key]

    def random_action(self, mask: Int8Array | None = None) -> int:
        """One of the legal actions, or of those of `mask`, all equally likely."""
        legal = np.flatnonzero(self.action_mask if mask is None else mask)
        return int(legal[self.rng.integers(len(legal))])


def adapted_observation(adapters: Iterable[AgentAdapter], observation: AgentObservation) -> AgentObservation:
    """The observation after the wrappers that the agent acts through, the innermost first."""
    for adapter in adapters:
        observation = adapter.observation(observation)
    return observation


def base_action(adapters: Sequence[AgentAdapter], action: Any) -> Any:
    """The game's action for an agent's action, through its wrappers, of which the innermost comes first."""
    for adapter in reversed(adapters):
        action = adapter.action(action)
    return action


Partner = Callable[[PartnerTurn], SupportsIndex]


def ask(partner: Partner, turn: PartnerTurn) -> int:
    """The partner's action, as the game takes it. Raises PartnerError naming the partner when it is not legal."""
    action = partner(turn)
    try:
        index = turn.game.checked(turn.role, action)
    except ActionError as fault:
        raise PartnerError(f"partner {partner!r}: {fault}") from None
    if not turn.action_mask[index]:
        name = turn.game.describe(turn.role, index)
        raise PartnerError(
            f"partner {partner!r} chose {index} ({name}), which is not legal for {AGENTS[turn.role]} now"
        )
    return base_action(turn.adapters, index)


@dataclass(frozen=True)
class RandomPartner:
    """Any legal action, all equally likely; for either side."""

    def __call__(self, turn: PartnerTurn) -> int:
        return turn.random_action()


@dataclass(frozen=True)
class OracleVerifier:
    """Knows the truth. Accepts a claim when it holds, and every other proposal.

    With `error_rate` it answers the opposite in that share of its judgements. In "audit" with bins it is sure.
    """

    error_rate: float = 0.0

    def __post_init__(self) -> None:
        if not 0 <= self.error_rate <= 1:
            raise ValueError(f"error_rate must be between 0 and 1, not {self.error_rate!r}")

    def __call__(self, turn: PartnerTurn) -> int:
        game, state = turn.game, turn.state
        if state.proposal not in (None, STOP_ACTION):
            return answer(game, accepts=True)
        holds = game.conditions.dynamics.goal_reached(state.mdp)
        errs = self.error_rate > 0 and turn.rng.random() < self.error_rate
        return answer(game, accepts=holds != errs)


@dataclass(frozen=True)
class ConstantVerifier:
    """Accepts everything, or rejects everything."""

    accepts: bool

    def __call__(self, turn: PartnerTurn) -> int:
        return answer(turn.game, accepts=self.accepts)


ALWAYS_ACCEPT = ConstantVerifier(accepts=True)
ALWAYS_REJECT = ConstantVerifier(accepts=False)


def answer(game: Game, *, accepts: bool) -> int:
    """The verifier's action that accepts or rejects outright, in silence."""
    surest = (game.conditions.verdict_bins or 2) - 1  # ACCEPT, where there are no bins
    return game.action(Role.VERIFIER, surest if accepts else REJECT)


@dataclass(frozen=True)
class ClaimingProposer:
    """Edits at random until a claim would be as true or false as it wants, and claims then.

    `intent` helpful claims what holds, sneaky what does not; None goes by the episode's own intent. At least
    `least_edits` and at most `most_edits` edits come first; after the most it claims whatever is the case.
    """

    intent: Intent | None = None
    least_edits: int = 1
    most_edits: int = 8

    def __call__(self, turn: PartnerTurn) -> int:
        state, game = turn.state, turn.game
        wants_truth = (state.intent if self.intent is None else self.intent) is Intent.HELPFUL
        edits = state.mdp.steps
        claim = game.action(Role.PROPOSER, STOP_ACTION)
        if turn.action_mask[claim] and edits >= self.least_edits:
            is_as_wanted = game.conditions.dynamics.goal_reached(state.mdp) == wants_truth
            if is_as_wanted or edits >= self.most_edits:
                return claim
        edit_mask = turn.action_mask.copy()
        edit_mask[: game.action(Role.PROPOSER, STOP_ACTION + 1)] = 0
        return turn.random_action(edit_mask)


HELPFUL_PROPOSER = ClaimingProposer(Intent.HELPFUL)
SNEAKY_PROPOSER = ClaimingProposer(Intent.SNEAKY)


@dataclass(frozen=True)
class FrozenPolicy:
    """A trained model as a partner: anything with Stable-Baselines3's `predict`.

    `masked` for models that take `action_masks` (MaskablePPO). An unmasked model's illegal choices are replaced by
    a random legal action, since a partner must act legally.
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
