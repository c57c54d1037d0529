"""The game as PettingZoo environments, with nested observations, or vectors for SuperSuit and Stable-Baselines3."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, SupportsIndex

from gymnasium.error import ResetNeeded
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils.wrappers import OrderEnforcingWrapper

from lilgym_mp.envs.proposer_verifier.engine import BaseGameEnv, TurnResult, role_of
from lilgym_mp.envs.proposer_verifier.game import TurnError
from lilgym_mp.envs.proposer_verifier.game_arrays import Info
from lilgym_mp.envs.proposer_verifier.protocols import AGENTS, Role
from lilgym_mp.scene.arrays import AnyDict

PROPOSER_NAME, VERIFIER_NAME = AGENTS

ParallelStep = tuple[AnyDict, dict[str, float], dict[str, bool], dict[str, bool], dict[str, Info]]


class ProposerVerifierAEC(BaseGameEnv, AECEnv[str, Any, SupportsIndex | None]):
    """A proposer and a verifier act on one MDP, one after the other.

    In the simultaneous protocol ("joint") the proposer's action is held back, unseen, until the verifier has acted.

    Args:
        configuration: As for `env`.
        render_mode: As for a single environment.
        observations: "nested" or "vector", as for `env`.
        settings: The fields of GameSettings.
    """

    _pending: int | None = None  # simultaneous protocol: the proposer's action, until the verifier acts

    def reset(self, seed: int | None = None, options: AnyDict | None = None) -> None:
        """Starts a game.

        Args:
            seed: Seed of the game's generator; None keeps it.
            options: "task", an id of the split or a `Task`; "intent", "helpful" or "deceptive".

        Raises:
            ValueError: For an invalid option or seed.
        """
        infos = self.engine.reset(seed, options)
        self.agents = list(AGENTS)
        self.rewards = dict.fromkeys(AGENTS, 0.0)
        self._cumulative_rewards = dict.fromkeys(AGENTS, 0.0)
        self.terminations = dict.fromkeys(AGENTS, False)
        self.truncations = dict.fromkeys(AGENTS, False)
        self.infos = self._with_masks(infos)
        self.agent_selection = AGENTS[Role.PROPOSER]
        self._pending = None
        self._skip_agent_selection = None

    def observe(self, agent: str) -> Any:
        return self._shown(agent, self.engine.observe(role_of(agent)))

    def step(self, action: SupportsIndex | None) -> None:
        """Takes one action of the agent in `agent_selection`.

        Args:
            action: Its index; None for an agent whose game has ended.

        Raises:
            ActionError: For an action outside the action space.
            ResetNeeded: Before reset and after the end.
            ClosedEnvironmentError: After `close`.
        """
        self.engine.check_open()
        if not self.agents:
            raise ResetNeeded("no agent is active; call reset before step")
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        turn: TurnResult | None = None
        if agent == AGENTS[Role.VERIFIER]:
            turn = self.engine.step(self._pending, action)
            self._pending = None
        elif action is not None and not self.engine.game.turn_based:
            self._pending = self.engine.game.checked_action(Role.PROPOSER, action)
        else:
            turn = self.engine.step(action, None)
        self._cumulative_rewards[agent] = 0.0
        self.infos[agent] = {}
        if turn is None:
            self._clear_rewards()
            self.agent_selection = AGENTS[Role.VERIFIER]
        else:
            self._update(turn)

    def _update(self, turn: TurnResult) -> None:
        """Sets rewards, flags, infos and the next agent after a turn. Infos accumulate until an agent acts."""
        rewards, terminated, truncated, infos = turn
        self.rewards = dict(zip(AGENTS, rewards, strict=True))
        self._accumulate_rewards()
        self.terminations = dict.fromkeys(AGENTS, terminated)
        self.truncations = dict.fromkeys(AGENTS, truncated)
        self.infos = {agent: self.infos[agent] | new for agent, new in self._with_masks(infos).items()}
        movers = self.engine.movers
        self.agent_selection = AGENTS[movers[0] if movers else Role.PROPOSER]


class StrictOrderEnforcing(OrderEnforcingWrapper[str, Any, SupportsIndex | None]):
    """PettingZoo's checks of the order of calls, but a step after the end raises instead of logging a warning."""

    def step(self, action: SupportsIndex | None) -> None:
        self.unwrapped.engine.check_open()  # pyright: ignore[reportAttributeAccessIssue]
        if self._has_reset and not self.agents:
            raise ResetNeeded("no agent is active; call reset before step")
        super().step(action)


class ProposerVerifierParallel(BaseGameEnv, ParallelEnv[str, Any, SupportsIndex]):
    """A proposer and a verifier act on one MDP; each step takes an action from both.

    In turn-based protocols a step is one turn: the agent out of turn has one legal action, "wait", and any other is
    ignored. Both agents' observations share the arrays of parts that both see.

    Args:
        configuration: As for `env`.
        render_mode: As for a single environment.
        observations: "nested" or "vector", as for `env`.
        settings: The fields of GameSettings.
    """

    def reset(self, seed: int | None = None, options: AnyDict | None = None) -> tuple[AnyDict, dict[str, Info]]:
        """Starts a game.

        Args:
            seed: Seed of the game's generator; None keeps it.
            options: "task", an id of the split or a `Task`; "intent", "helpful" or "deceptive".

        Returns:
            Observations and infos by agent.

        Raises:
            ValueError: For an invalid option or seed.
        """
        infos = self.engine.reset(seed, options)
        self.agents = list(AGENTS)
        return self._observations(), self._with_masks(infos)

    def step(self, actions: Mapping[str, SupportsIndex]) -> ParallelStep:
        """Takes one action of each agent.

        Args:
            actions: Indices by agent.

        Returns:
            Observations, rewards, terminated, truncated and infos, each by agent.

        Raises:
            ActionError: For an action outside the action space.
            TurnError: Unless exactly both agents act.
            ResetNeeded: Before reset and after the end.
            ClosedEnvironmentError: After `close`.
        """
        if len(actions) != len(AGENTS) or PROPOSER_NAME not in actions or VERIFIER_NAME not in actions:
            raise TurnError(f"actions must be for {' and '.join(AGENTS)}, not for {', '.join(actions) or 'no agent'}")
        rewards, terminated, truncated, infos = self.engine.step(actions[PROPOSER_NAME], actions[VERIFIER_NAME])
        if terminated or truncated:
            self.agents = []
        return (
            self._observations(),
            {PROPOSER_NAME: rewards[0], VERIFIER_NAME: rewards[1]},
            {PROPOSER_NAME: terminated, VERIFIER_NAME: terminated},
            {PROPOSER_NAME: truncated, VERIFIER_NAME: truncated},
            self._with_masks(infos),
        )

    def _observations(self) -> AnyDict:
        nested = self.engine.observe_both()
        return {agent: self._shown(agent, nested[agent]) for agent in AGENTS} if self._is_vector else nested


parallel_env = ProposerVerifierParallel
raw_env = ProposerVerifierAEC


def env(configuration: str | None = None, **settings: Any) -> StrictOrderEnforcing:
    """The game as a PettingZoo AEC environment, with checks of the order of calls, which `raw_env` omits.

    Args:
        configuration: A name such as "TowerFlipIt", or a Gymnasium id (default: TowerScratch).
        settings: The fields of GameSettings, `render_mode`, and `observations`: "nested", {"observation": parts,
            "action_mask"}; or, for SuperSuit and Stable-Baselines3, "vector", all parts flattened to float32 (N,), with
            masks in infos.

    Returns:
        The environment.

    Raises:
        ValueError: For invalid settings; the message names the value and the choices.
    """
    return StrictOrderEnforcing(raw_env(configuration, **settings))
