"""The game as a PettingZoo AEC environment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, SupportsIndex

from gymnasium.error import ResetNeeded
from pettingzoo import AECEnv
from pettingzoo.utils.wrappers import OrderEnforcingWrapper

from lilgym_mp.envs.proposer_verifier.array_observations import NESTED, convert_observations
from lilgym_mp.envs.proposer_verifier.base import BaseGameEnv, role_of
from lilgym_mp.envs.proposer_verifier.engine import AgentObservation, GameEngine
from lilgym_mp.envs.proposer_verifier.settings import Settings
from lilgym_mp.envs.proposer_verifier.types import AGENTS, GameStep, Role


class ProposerVerifierAEC(BaseGameEnv, AECEnv[str, AgentObservation, SupportsIndex | None]):
    """A proposer and a verifier act on one MDP, one after the other.

    In the simultaneous protocol ("joint") the proposer's action is held back, unseen, until the verifier has acted.
    """

    def __init__(self, settings: Settings, render_mode: str | None = None) -> None:
        BaseGameEnv.__init__(self, GameEngine(settings.setup(), render_mode))
        self.agents: list[str] = []
        self._pending: int | None = None  # simultaneous protocol: the proposer's action, until the verifier acts

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> None:
        """`options`: "task", an id of the split; "intent", "helpful" or "sneaky". Others are ignored."""
        infos = self.engine.reset(seed, options)
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
        return self.engine.observe(role_of(agent))

    def step(self, action: SupportsIndex | None) -> None:
        """Raises ActionError for an action outside the action space, ResetNeeded before reset and after the end."""
        if not self.agents:
            raise ResetNeeded("no agent is active; call reset before step")
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        self._cumulative_rewards[agent] = 0.0
        if agent == AGENTS[Role.VERIFIER]:
            self._update(self.engine.step(self._pending, action))
            self._pending = None
        elif action is not None and not self.engine.game.turn_based:
            self._pending = self.engine.game.checked_action(Role.PROPOSER, action)
            self._clear_rewards()
            self.agent_selection = AGENTS[Role.VERIFIER]
        else:
            self._update(self.engine.step(action, None))

    def _update(self, step: GameStep) -> None:
        """Sets rewards, flags, infos and the next agent after a turn."""
        proposer, verifier = AGENTS
        infos = self.engine.infos(step)
        self.rewards = {proposer: step.rewards[0], verifier: step.rewards[1]}
        self._accumulate_rewards()
        self.terminations = dict.fromkeys(AGENTS, step.terminated)
        self.truncations = dict.fromkeys(AGENTS, step.truncated)
        self.infos = {proposer: infos[0], verifier: infos[1]}
        self.agent_selection = AGENTS[step.state.movers[0] if step.state.movers else Role.PROPOSER]


def raw_env(*, render_mode: str | None = None, **settings: Any) -> ProposerVerifierAEC:
    """The game as a PettingZoo AEC environment; keywords are the fields of Settings."""
    return ProposerVerifierAEC(Settings.of(**settings), render_mode)


class StrictOrderEnforcing(OrderEnforcingWrapper[str, AgentObservation, SupportsIndex | None]):
    """PettingZoo's checks of the order of calls, but a step after the end raises instead of logging a warning."""

    adapters: ClassVar[Mapping[str, Any]] = {}  # for SingleAgentView: observations and actions stay unchanged

    def step(self, action: SupportsIndex | None) -> None:
        if self._has_reset and not self.agents:
            raise ResetNeeded("no agent is active; call reset before step")
        super().step(action)


def env(*, render_mode: str | None = None, observations: str = NESTED, **settings: Any) -> StrictOrderEnforcing:
    """`raw_env` with checks of the order of calls. `observations`: as for `parallel_env`."""
    return StrictOrderEnforcing(convert_observations(raw_env(render_mode=render_mode, **settings), observations))
