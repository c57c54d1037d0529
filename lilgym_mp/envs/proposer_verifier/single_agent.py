"""One side of the game as a Gymnasium environment, the other played by a partner."""

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
from lilgym_mp.envs.proposer_verifier.partners import (
    SCRIPTED,
    AgentAdapter,
    Partner,
    PartnerTurn,
    adapted_observation,
    ask,
    base_action,
)
from lilgym_mp.envs.proposer_verifier.session import RENDER_MODES, Session
from lilgym_mp.envs.proposer_verifier.shared import GameAccess, role_of
from lilgym_mp.envs.proposer_verifier.states import AGENTS, GameStep, Role
from lilgym_mp.envs.single import UNCHANGED_REWARD
from lilgym_mp.envs.window import RENDER_FPS

MOST_DRAWS = 1_000  # games in a row that may end before the agent has had a turn


def _adapters_of(env: Any, agent: str) -> tuple[AgentAdapter, ...]:
    """The adapters of the wrappers around the game, the innermost first. Raises TypeError for other wrappers."""
    found: list[AgentAdapter] = []
    while env is not env.unwrapped:
        adapters = inspect.getattr_static(env, "adapters", None)
        if adapters is None:
            raise TypeError(
                f"SingleAgentView would drop what {type(env).__name__} does; give it the game itself, or the game in"
                " wrappers of lilgym_mp.wrappers, and put others around the view"
            )
        found += [adapters[agent]] if adapters else []
        env = env.env
    return tuple(reversed(found))


class SingleAgentView(gym.Env[dict[str, Any], int]):
    """Plays `agent` against `partner`: for training one side with Stable-Baselines3.

    Observation: the parts that the agent sees, without the mask, which `action_masks` gives (MaskablePPO asks for it).
    Reward: everything the agent earned since its last action. Games that end before the agent has had a turn are
    drawn anew; info["skipped_games"] after reset counts them.
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": RENDER_FPS}

    def __init__(self, env: Any, agent: str, partner: Partner | str) -> None:
        """`env`: any form of the game (`env`, `raw_env`, `parallel_env`), also in wrappers of this package, through
        which both sides see and act; the view plays it, so let nobody else.
        `partner`: one of SCRIPTED by name, or any function of a PartnerTurn.

        Raises TypeError for another environment, one in others' wrappers, or a partner that cannot be called,
        ValueError for unknown names.
        """
        game_env = getattr(env, "unwrapped", env)
        if not isinstance(game_env, GameAccess):
            raise TypeError(f"SingleAgentView needs a proposer-verifier environment, not {env!r}")
        if isinstance(partner, str):
            partner = choose("partner", partner, SCRIPTED)
        if not callable(partner):
            raise TypeError(f"a partner must be a function of a PartnerTurn, not {partner!r}")
        self.session: Session = game_env.session
        self.partner = partner
        self.agent = agent
        self.render_mode = self.session.render_mode
        self._role = role_of(agent)
        self._adapters = tuple(_adapters_of(env, name) for name in AGENTS)
        own = self._adapters[self._role]
        self._reward_changes = [adapter.rewards for adapter in own if adapter.rewards is not None]
        seen = own[-1].observation_space["observation"] if own else None
        self.observation_space = seen or spaces.Dict(
            {key: part.space for key, part in self.session.parts[self._role].items()}
        )
        self.action_space = cast("spaces.Space[int]", game_env.action_space(agent))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """`options` as those of the game."""
        super().reset(seed=seed)
        for skipped in range(MOST_DRAWS):
            infos = self.session.reset(seed if skipped == 0 else None, options)
            for adapter in (*self._adapters[0], *self._adapters[1]):
                adapter.start()
            deque(self._partner_plays(), maxlen=0)
            if self.session.state.movers:
                for change in self._reward_changes:
                    change.start()
                return self._observation(), self._info(infos[self._role]) | {"skipped_games": skipped}
        raise RuntimeError(f"{self.agent} had no turn in {MOST_DRAWS} games with partner {self.partner!r}")

    def step(self, action: SupportsIndex) -> tuple[dict[str, Any], SupportsFloat, bool, bool, dict[str, Any]]:
        """Raises ActionError for a number out of range, PartnerError for an illegal action of the partner,
        ResetNeeded before reset and after the end."""
        session = self.session
        step = self._play(action)
        reward, unchanged = self._reward(step), step.rewards[self._role]
        info = session.infos(step)[self._role]
        for step in self._partner_plays():
            reward += self._reward(step)
            unchanged += step.rewards[self._role]
            info |= session.infos(step)[self._role]
        if self._reward_changes:
            info[UNCHANGED_REWARD] = unchanged
        return self._observation(), reward, step.terminated, step.truncated, self._info(info)

    def _reward(self, step: GameStep) -> float:
        """The agent's, of the turn that was just played, as the wrappers change it."""
        rewards: Sequence[float] = step.rewards
        for change in self._reward_changes:
            rewards = change.changed(rewards)
        return rewards[self._role]

    def _play(self, action: SupportsIndex) -> GameStep:
        """The agent's turn, and the partner's too where both move at once."""
        session, role = self.session, self._role
        if self._adapters[role]:
            session.game.checked(role, action)
            action = base_action(self._adapters[role], action)
        other = self._ask() if role.other in session.state.movers else None
        return session.play(action, other) if role is Role.PROPOSER else session.play(other, action)

    def _partner_plays(self) -> Iterator[GameStep]:
        """The partner's turns, each when it is asked for, until the agent moves or the game is over."""
        session, role = self.session, self._role
        while session.state.movers and role not in session.state.movers:
            action = self._ask()
            yield session.play(None, action) if role is Role.PROPOSER else session.play(action, None)

    def _ask(self) -> int:
        other = self._role.other
        return ask(self.partner, PartnerTurn(self.session, other, self.session.rng, self._adapters[other]))

    def _observation(self) -> Any:
        adapters = self._adapters[self._role]
        if not adapters:
            return self.session.see(self._role)
        return adapted_observation(adapters, self.session.observe(self._role))["observation"]

    def _info(self, info: dict[str, Any]) -> dict[str, Any]:
        adapters = self._adapters[self._role]
        for count, adapter in enumerate(adapters, 1):
            info = adapter.info(
                info, lambda upto=adapters[:count]: adapted_observation(upto, self.session.observe(self._role))
            )
        return info

    def action_masks(self) -> np.ndarray:
        """(actions,) bool, a new array: the legal actions of the agent."""
        session, role = self.session, self._role
        if self._adapters[role]:
            return adapted_observation(self._adapters[role], session.observe(role))["action_mask"].astype(bool)
        return session.game.legal_mask(session.state, role).astype(bool)

    def render(self) -> UInt8Array | str | None:
        return self.session.render()

    def close(self) -> None:
        self.session.close()
