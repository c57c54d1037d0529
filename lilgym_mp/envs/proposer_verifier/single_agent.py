"""One agent's side of the game as a Gymnasium environment; a partner policy plays the other."""

from __future__ import annotations

from typing import Any, SupportsFloat, SupportsIndex, cast

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from lilgym_mp.envs.checks import checked_seed
from lilgym_mp.envs.interface import RENDER_FPS, RENDER_MODES, UNCHANGED_REWARD
from lilgym_mp.envs.proposer_verifier.engine import BaseGameEnv, role_of
from lilgym_mp.envs.proposer_verifier.observations import MASK, PARTS, AgentObservation
from lilgym_mp.envs.proposer_verifier.partners import Partner, PartnerTurn, checked_partner, partner_action
from lilgym_mp.envs.proposer_verifier.protocols import Role
from lilgym_mp.scene.arrays import AnyDict, UInt8Array

MAX_RESETS = 1_000  # consecutive games that may end before the agent has had a turn


class SingleAgentView(gym.Env[AnyDict, int]):
    """Plays `agent` against `partner`, for training one side with Stable-Baselines3.

    Observation: what the agent sees, without the mask; `action_masks()` returns that, as MaskablePPO expects.
    Reward: the sum since the agent's last action. Games that end before the agent has had a turn are skipped;
    info["skipped_games"] after reset counts them.
    """

    metadata: AnyDict = {"render_modes": list(RENDER_MODES), "render_fps": RENDER_FPS}

    def __init__(self, env: Any, agent: str, partner: Partner | str) -> None:
        """Takes the game over: do not step it elsewhere.

        Args:
            env: The game (`env`, `raw_env` or `parallel_env`), also in wrappers of this package, which apply to both
                agents.
            agent: The agent to play, such as "proposer_0".
            partner: A name in SCRIPTED, or a function of a PartnerTurn.

        Raises:
            TypeError: For another environment, for array observations and a partner that is not callable.
            ValueError: For unknown names.
        """
        game_env = getattr(env, "unwrapped", env)
        if not isinstance(game_env, BaseGameEnv):
            raise TypeError(f"SingleAgentView needs a proposer-verifier environment, not {env!r}")
        self._role = role_of(agent)
        nested = game_env.observation_space(agent)
        if env.observation_space(agent) != nested:
            raise TypeError(f"SingleAgentView takes wrappers of this package alone, not {env}")
        if not isinstance(nested, spaces.Dict) or MASK not in nested.spaces:
            raise TypeError(f'SingleAgentView needs the game with observations="nested", not {nested}')
        self.engine = game_env.engine
        self.partner = checked_partner(partner)
        self.agent = agent
        self.render_mode = self.engine.render_mode
        self.observation_space = cast("spaces.Space[Any]", nested[PARTS])
        self.action_space = cast("spaces.Space[int]", game_env.action_space(agent))
        self._observations: dict[Role, AgentObservation] = {}  # of this turn, as far as known
        self._reward = 0.0  # since the agent's last action, like the info
        self._info: AnyDict = {}

    def reset(self, *, seed: int | None = None, options: AnyDict | None = None) -> tuple[AnyDict, AnyDict]:
        """Starts a game in which the agent has a turn.

        Args:
            seed: As for the game.
            options: As for the game.

        Returns:
            The agent's observation, and infos.
        """
        super().reset(seed=checked_seed(seed))
        for skipped in range(MAX_RESETS):
            infos = self.engine.reset(seed if skipped == 0 else None, options)
            self._observations = {}
            self._info = {"task": self.engine.state.mdp.task.id, **infos[self._role]}
            self._play_partner()
            if self.engine.movers:
                return self.observe(self._role)[PARTS], self._info | {"skipped_games": skipped}
        raise RuntimeError(f"{self.agent} had no turn in {MAX_RESETS} games with partner {self.partner!r}")

    def step(self, action: SupportsIndex) -> tuple[AnyDict, SupportsFloat, bool, bool, AnyDict]:
        """Takes the agent's action, and the partner's until it is the agent's turn again.

        Args:
            action: Its index.

        Returns:
            Observation, reward, terminated, truncated and infos.

        Raises:
            ActionError: For an action outside the action space.
            PartnerError: For an illegal action of the partner.
            ResetNeeded: Before reset and after the end.
        """
        engine = self.engine
        role = self._role
        actions = {role: engine.game.checked_action(role, action)}
        if role.other in engine.movers:
            actions[role.other] = self._partner_action()
        self._reward = 0.0
        self._info = {}
        self._play(actions)
        self._play_partner()
        terminated = bool(engine.games.terminated[0])
        truncated = bool(engine.games.truncated[0])
        return self.observe(role)[PARTS], self._reward, terminated, truncated, self._info

    def _play(self, actions: dict[Role, int]) -> None:
        """Plays one turn with the actions of the agents to move, and adds up the agent's reward and info."""
        turn = self.engine.step(actions.get(Role.PROPOSER), actions.get(Role.VERIFIER))
        self._observations = {}
        self._reward += turn.rewards[self._role]
        unchanged = self._info.get(UNCHANGED_REWARD, 0.0)
        self._info |= turn.infos[self._role]
        if UNCHANGED_REWARD in self._info:
            self._info[UNCHANGED_REWARD] += unchanged

    def _play_partner(self) -> None:
        """Plays the partner's turns until it is the agent's turn or the game is over."""
        while (movers := self.engine.movers) and self._role not in movers:
            self._play({self._role.other: self._partner_action()})

    def _partner_action(self) -> int:
        turn = PartnerTurn(self.engine.games, self._role.other, self.engine.rng, observe=self.observe)
        return partner_action(self.partner, turn)

    def observe(self, role: Role) -> AgentObservation:
        """One agent's observation, after wrappers.

        Args:
            role: The agent.
        """
        self.engine.check_open()
        if role not in self._observations:
            self._observations[role] = self.engine.observe(role)
        return self._observations[role]

    def action_masks(self) -> np.ndarray:
        """(actions,) bool, a new array: the agent's legal actions."""
        return self.observe(self._role)[MASK].astype(bool)

    def render(self) -> UInt8Array | str | None:
        return self.engine.render()

    def close(self) -> None:
        self.engine.close()
