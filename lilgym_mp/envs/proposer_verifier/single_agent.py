"""One agent's side of the game as a Gymnasium environment; a partner policy plays the other."""

from __future__ import annotations

import inspect
from collections import deque
from collections.abc import Iterator, Sequence
from typing import Any, SupportsFloat, SupportsIndex, cast

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from lilgym_mp.arrays import UInt8Array
from lilgym_mp.choices import choose
from lilgym_mp.envs.proposer_verifier.engine import RENDER_MODES, BaseGameEnv, GameEngine, role_of
from lilgym_mp.envs.proposer_verifier.game import GameStep
from lilgym_mp.envs.proposer_verifier.partners import (
    SCRIPTED,
    AgentAdapter,
    Partner,
    PartnerTurn,
    partner_action,
)
from lilgym_mp.envs.proposer_verifier.protocols import AGENTS, Role
from lilgym_mp.envs.single import UNCHANGED_REWARD
from lilgym_mp.envs.window import RENDER_FPS

MAX_RESETS = 1_000  # consecutive games that may end before the agent has had a turn


class SingleAgentView(gym.Env[dict[str, Any], int]):
    """Plays `agent` against `partner`, for training one side with Stable-Baselines3.

    Observation: what the agent sees, without the mask; `action_masks()` returns that, as MaskablePPO expects.
    Reward: the sum since the agent's last action. Games that end before the agent has had a turn are skipped;
    info["skipped_games"] after reset counts them.
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": RENDER_FPS}

    def __init__(self, env: Any, agent: str, partner: Partner | str) -> None:
        """`env`: the game (`env`, `raw_env` or `parallel_env`), optionally in wrappers of this package, which then
        apply to both agents. The view takes it over: do not step it elsewhere.
        `partner`: a name in SCRIPTED, or a function of a PartnerTurn.

        Raises TypeError for another environment, another library's wrapper or a partner that is not callable,
        ValueError for unknown names.
        """
        game_env = getattr(env, "unwrapped", env)
        if not isinstance(game_env, BaseGameEnv):
            raise TypeError(f"SingleAgentView needs a proposer-verifier environment, not {env!r}")
        if isinstance(partner, str):
            partner = choose("partner", partner, SCRIPTED)
        if not callable(partner):
            raise TypeError(f"a partner must be callable with a PartnerTurn, not {partner!r}")
        self.engine: GameEngine = game_env.engine
        self.partner = partner
        self.agent = agent
        self.render_mode = self.engine.render_mode
        self._role = role_of(agent)
        self._adapters = tuple(_adapters_of(env, name) for name in AGENTS)
        own = self._adapters[self._role]
        self._reward_adapters = [adapter for adapter in own if adapter.changes_rewards]
        adapted_space = own[-1].observation_space["observation"] if own else None
        self.observation_space = adapted_space or spaces.Dict(
            {key: part.space for key, part in self.engine.parts[self._role].items()}
        )
        self.action_space = cast("spaces.Space[int]", game_env.action_space(agent))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """`options` as for the game."""
        super().reset(seed=seed)
        for skipped in range(MAX_RESETS):
            infos = self.engine.reset(seed if skipped == 0 else None, options)
            for adapter in (*self._adapters[0], *self._adapters[1]):
                adapter.reset()
            deque(self._partner_turns(), maxlen=0)
            if self.engine.state.movers:
                for adapter in self._reward_adapters:
                    adapter.reset()
                info = {"task": self.engine.state.mdp.task.id, **infos[self._role]}
                return self._observation(), self._info(info) | {"skipped_games": skipped}
        raise RuntimeError(f"{self.agent} had no turn in {MAX_RESETS} games with partner {self.partner!r}")

    def step(self, action: SupportsIndex) -> tuple[dict[str, Any], SupportsFloat, bool, bool, dict[str, Any]]:
        """Raises ActionError for an action outside the action space, PartnerError for an illegal action of the partner,
        ResetNeeded before reset and after the end."""
        engine = self.engine
        step = self._play_turn(action)
        reward, unwrapped_reward = self._reward(step), step.rewards[self._role]
        info = engine.infos(step)[self._role]
        for step in self._partner_turns():
            reward += self._reward(step)
            unwrapped_reward += step.rewards[self._role]
            info |= engine.infos(step)[self._role]
        if self._reward_adapters:
            info[UNCHANGED_REWARD] = unwrapped_reward
        return self._observation(), reward, step.terminated, step.truncated, self._info(info)

    def _reward(self, step: GameStep) -> float:
        """The agent's reward of the last turn, after the wrappers."""
        rewards: Sequence[float] = step.rewards
        for adapter in self._reward_adapters:
            rewards = adapter.rewards(rewards)
        return rewards[self._role]

    def _play_turn(self, action: SupportsIndex) -> GameStep:
        """Plays the agent's turn, with the partner's action if the protocol is simultaneous."""
        engine, role = self.engine, self._role
        if self._adapters[role]:
            engine.game.checked_action(role, action)
            action = self._turn(role).game_action(action)
        other = self._partner_action() if role.other in engine.state.movers else None
        return engine.step(action, other) if role is Role.PROPOSER else engine.step(other, action)

    def _partner_turns(self) -> Iterator[GameStep]:
        """Plays the partner's turns, lazily, until it is the agent's turn or the game is over."""
        engine, role = self.engine, self._role
        while engine.state.movers and role not in engine.state.movers:
            action = self._partner_action()
            yield engine.step(None, action) if role is Role.PROPOSER else engine.step(action, None)

    def _partner_action(self) -> int:
        return partner_action(self.partner, self._turn(self._role.other))

    def _turn(self, role: Role, adapters: int | None = None) -> PartnerTurn:
        """The side of `role`, with its innermost `adapters` (None: all)."""
        return PartnerTurn(self.engine, role, self.engine.rng, self._adapters[role][:adapters])

    def _observation(self) -> Any:
        role = self._role
        return self._turn(role).observation if self._adapters[role] else self.engine.observe_parts(role)

    def _info(self, info: dict[str, Any]) -> dict[str, Any]:
        for count, adapter in enumerate(self._adapters[self._role], 1):
            info = adapter.info(info, lambda count=count: self._turn(self._role, count).full_observation)
        return info

    def action_masks(self) -> np.ndarray:
        """(actions,) bool, a new array: the agent's legal actions."""
        engine, role = self.engine, self._role
        mask = self._turn(role).action_mask if self._adapters[role] else engine.game.legal_mask(engine.state, role)
        return mask.astype(bool)

    def render(self) -> UInt8Array | str | None:
        return self.engine.render()

    def close(self) -> None:
        self.engine.close()


def _adapters_of(env: Any, agent: str) -> tuple[AgentAdapter, ...]:
    """The agent's adapters of the wrappers around the game, innermost first. Raises TypeError for unknown wrappers."""
    found: list[AgentAdapter] = []
    while env is not env.unwrapped:
        adapters = inspect.getattr_static(env, "adapters", None)
        if adapters is None:
            raise TypeError(
                f"SingleAgentView would bypass {type(env).__name__}; give it the bare game, or the game in wrappers of"
                " lilgym_mp.wrappers, and apply other wrappers to the view"
            )
        found += [adapters[agent]] if adapters else []
        env = env.env
    return tuple(reversed(found))
