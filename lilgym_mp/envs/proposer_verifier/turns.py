"""The turn-by-turn (AEC) form."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, SupportsIndex

from gymnasium.error import ResetNeeded
from pettingzoo import AECEnv
from pettingzoo.utils.wrappers import OrderEnforcingWrapper

from lilgym_mp.envs.proposer_verifier.boxes import NESTED, shown_as
from lilgym_mp.envs.proposer_verifier.session import AgentObservation, Session
from lilgym_mp.envs.proposer_verifier.settings import Settings
from lilgym_mp.envs.proposer_verifier.shared import GameAccess, role_of
from lilgym_mp.envs.proposer_verifier.states import AGENTS, GameStep, Role


class ProposerVerifierTurns(GameAccess, AECEnv[str, AgentObservation, SupportsIndex | None]):
    """A proposer and a verifier act on one MDP, one after the other.

    Where they move at once ("joint"), the proposer's action waits, unseen, for the verifier's.
    """

    def __init__(self, settings: Settings, render_mode: str | None = None) -> None:
        GameAccess.__init__(self, Session(settings.setup(), render_mode))
        self.agents: list[str] = []
        self._pending: int | None = None  # the proposer's action while the verifier makes up its mind

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> None:
        """`options`: "task", an id of the split, and "intent", "helpful" or "sneaky"; others are ignored."""
        infos = self.session.reset(seed, options)
        self.agents = list(AGENTS)
        self.rewards = dict.fromkeys(AGENTS, 0.0)
        self._cumulative_rewards = dict.fromkeys(AGENTS, 0.0)
        self.terminations = dict.fromkeys(AGENTS, False)
        self.truncations = dict.fromkeys(AGENTS, False)
        self.infos = dict(zip(AGENTS, infos, strict=True))
        self.agent_selection = AGENTS[Role.PROPOSER]
        self._pending = None
        self._skip_agent_selection = None

    def observe(self, agent: str) -> AgentObservation:
        return self.session.observe(role_of(agent))

    def step(self, action: SupportsIndex | None) -> None:
        """Raises ActionError for a number out of range, ResetNeeded before reset and when no agent is left."""
        if not self.agents:
            raise ResetNeeded("no agent is in play; call reset before step")
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        self._cumulative_rewards[agent] = 0.0
        if agent == AGENTS[Role.VERIFIER]:
            self._publish(self.session.play(self._pending, action))
            self._pending = None
        elif action is not None and self.session.game.protocol.simultaneous:
            self._pending = self.session.game.checked(Role.PROPOSER, action)
            self._clear_rewards()
            self.agent_selection = AGENTS[Role.VERIFIER]
        else:
            self._publish(self.session.play(action, None))

    def _publish(self, step: GameStep) -> None:
        """Makes what a turn brought known to the agents."""
        proposer, verifier = AGENTS
        infos = self.session.infos(step)
        self.rewards = {proposer: step.rewards[0], verifier: step.rewards[1]}
        self._accumulate_rewards()
        self.terminations = dict.fromkeys(AGENTS, step.terminated)
        self.truncations = dict.fromkeys(AGENTS, step.truncated)
        self.infos = {proposer: infos[0], verifier: infos[1]}
        self.agent_selection = AGENTS[step.state.movers[0] if step.state.movers else Role.PROPOSER]


def raw_env(*, render_mode: str | None = None, **settings: Any) -> ProposerVerifierTurns:
    """The turn-by-turn form; keywords are the fields of Settings."""
    return ProposerVerifierTurns(Settings.of(**settings), render_mode)


class StrictOrder(OrderEnforcingWrapper[str, AgentObservation, SupportsIndex | None]):
    """PettingZoo's checks of the order of calls; a step after the end is an error here, not a line in a log."""

    adapters: ClassVar[Mapping[str, Any]] = {}  # it changes nothing that an agent sees or does

    def step(self, action: SupportsIndex | None) -> None:
        if self._has_reset and not self.agents:
            raise ResetNeeded("no agent is in play; call reset before step")
        super().step(action)


def env(*, render_mode: str | None = None, observations: str = NESTED, **settings: Any) -> StrictOrder:
    """`raw_env` behind checks of the order of calls. `observations`: as for `parallel_env`."""
    return StrictOrder(shown_as(raw_env(render_mode=render_mode, **settings), observations))
