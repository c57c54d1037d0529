"""One side of the game as a Gymnasium environment, the other played by a partner."""

from __future__ import annotations

from typing import Any, SupportsFloat, SupportsIndex, cast

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from lilgym_mp.arrays import UInt8Array
from lilgym_mp.choices import choose
from lilgym_mp.envs.proposer_verifier.partners import SCRIPTED, Partner, Seat, ask
from lilgym_mp.envs.proposer_verifier.session import RENDER_FPS, RENDER_MODES, Session
from lilgym_mp.envs.proposer_verifier.shared import GameAccess, role_of
from lilgym_mp.envs.proposer_verifier.states import GameStep, Role

MOST_DRAWS = 1_000  # games in a row that may end before the agent has had a turn


class SingleAgentView(gym.Env[dict[str, Any], int]):
    """Plays `agent` against `partner`: for training one side with Stable-Baselines3.

    Observation: the parts that the agent sees, without the mask, which `action_masks` gives (MaskablePPO asks for it).
    Reward: everything the agent earned since its last action. Games that end before the agent has had a turn are
    drawn anew; info["skipped_games"] after reset counts them.
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": RENDER_FPS}

    def __init__(self, env: Any, agent: str, partner: Partner | str) -> None:
        """`env`: any form of the game (`env`, `raw_env`, `parallel_env`); the view plays it, so let nobody else.
        `partner`: one of SCRIPTED by name, or any function of a Seat.

        Raises TypeError for another environment or a partner that cannot be called, ValueError for unknown names.
        """
        game_env = getattr(env, "unwrapped", env)
        if not isinstance(game_env, GameAccess):
            raise TypeError(f"SingleAgentView needs a proposer-verifier environment, not {env!r}")
        if isinstance(partner, str):
            partner = choose("partner", partner, SCRIPTED)
        if not callable(partner):
            raise TypeError(f"a partner must be a function of its seat, not {partner!r}")
        self.session: Session = game_env.session
        self.partner = partner
        self.agent = agent
        self.render_mode = self.session.render_mode
        self._role = role_of(agent)
        self.observation_space = spaces.Dict({key: part.space for key, part in self.session.parts[self._role].items()})
        self.action_space = cast("spaces.Space[int]", game_env.action_space(agent))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """`options` as those of the game."""
        super().reset(seed=seed)
        for skipped in range(MOST_DRAWS):
            infos = self.session.reset(seed if skipped == 0 else None, options)
            self._partner_plays()
            if self.session.state.movers:
                return self._observation(), infos[self._role] | {"skipped_games": skipped}
        raise RuntimeError(f"{self.agent} had no turn in {MOST_DRAWS} games with partner {self.partner!r}")

    def step(self, action: SupportsIndex) -> tuple[dict[str, Any], SupportsFloat, bool, bool, dict[str, Any]]:
        """Raises ActionError for a number out of range, PartnerError for an illegal action of the partner,
        ResetNeeded before reset and after the end."""
        session = self.session
        step = self._play(action)
        reward = step.rewards[self._role]
        info = session.infos(step)[self._role]
        for step in self._partner_plays():
            reward += step.rewards[self._role]
            info |= session.infos(step)[self._role]
        return self._observation(), reward, step.terminated, step.truncated, info

    def _play(self, action: SupportsIndex) -> GameStep:
        """The agent's turn, and the partner's too where both move at once."""
        session, role = self.session, self._role
        other = self._ask() if role.other in session.state.movers else None
        return session.play(action, other) if role is Role.PROPOSER else session.play(other, action)

    def _partner_plays(self) -> list[GameStep]:
        """The partner's turns until the agent moves or the game is over."""
        session, role = self.session, self._role
        steps: list[GameStep] = []
        while session.state.movers and role not in session.state.movers:
            action = self._ask()
            steps.append(session.play(None, action) if role is Role.PROPOSER else session.play(action, None))
        return steps

    def _ask(self) -> int:
        return ask(self.partner, Seat(self.session, self._role.other, self.session.rng))

    def _observation(self) -> dict[str, Any]:
        return self.session.see(self._role)

    def action_masks(self) -> np.ndarray:
        """(actions,) bool, a new array: the legal actions of the agent."""
        return self.session.game.legal_mask(self.session.state, self._role).astype(bool)

    def render(self) -> UInt8Array | str | None:
        return self.session.render()

    def close(self) -> None:
        self.session.close()
