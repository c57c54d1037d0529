"""An adapter to the environment interface of BALROG, a benchmark of language models."""

from __future__ import annotations

from typing import Any, SupportsFloat

import gymnasium as gym
from PIL import Image

from lilgym_mp.contrib.llm.summary import progression
from lilgym_mp.envs.rules import State
from lilgym_mp.scene.actions import describe
from lilgym_mp.scene.render import draw
from lilgym_mp.solver import Solver
from lilgym_mp.wrappers import TextObservation

MAX_LISTED_ACTIONS = 64  # above it, `language_action_space` lists the legal actions only


class BalrogEnv(TextObservation):
    """Actions are text; observations are {"text": {"long_term_context", "short_term_context"}, "image"}.

    Instructions, action names and progression follow BALROG's environments.
    """

    default_action = "STOP"

    def __init__(self, env: gym.Env[Any, Any], *, scene: str = "list", legal_actions: bool = True) -> None:
        """`env`: from `gymnasium.make`; `scene`, `legal_actions`: see TextObservation."""
        super().__init__(env, scene=scene, legal_actions=legal_actions)
        self._dynamics = self.transformation.env_description.dynamics
        self._solver = Solver(self._dynamics)
        self.max_steps = self._dynamics.horizon
        self.failed_candidates: list[str] = []
        self._start: State | None = None
        self._success = False

    @property
    def language_action_space(self) -> list[str]:
        """The names of all actions; in Scatter, which has thousands, only of the currently legal ones."""
        appearance = self._dynamics.appearance
        if appearance.action_count <= MAX_LISTED_ACTIONS:
            return [describe(appearance.decode(index)) for index in range(appearance.action_count)]
        return [describe(appearance.decode(index)) for index in self.action_masks().nonzero()[0].tolist()]

    def get_instruction_prompt(self, instruction: str | None = None) -> str:
        """The rules, then the task's statement and target, or `instruction` instead of these."""
        if instruction is None:
            task = self._current().task
            instruction = f'Make this statement {str(task.target).lower()}, then STOP: "{task.statement}"'
        return f"{self.instructions()}\n{instruction}"

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        text, info = super().reset(seed=seed, options=options)
        self._start, self._success = self._current(), False
        self.failed_candidates = []
        return self._observation(text), info

    def check_action_validity(self, candidate_action: str) -> str:
        """The name of the action parsed from the text; the default action if none is."""
        reply = self.parse_action(candidate_action)
        if not reply.understood:
            self.failed_candidates.append(candidate_action)
            return self.default_action
        return describe(self._dynamics.appearance.decode(reply.action))

    def step(self, action: str) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        text, reward, terminated, truncated, info = super().step(self.parse_action(action).action)
        self._success = bool(info.get("is_success", False))
        return self._observation(text), reward, terminated, truncated, info

    def get_stats(self) -> dict[str, Any]:
        """{"progression": 0 to 1, "success"} of the current episode."""
        assert self._start is not None, "call reset first"
        progress = progression(self._solver, self._start, self._current(), success=self._success)
        return {"progression": progress, "success": self._success}

    def _current(self) -> State:
        return self.get_wrapper_attr("state")

    def _observation(self, text: str) -> dict[str, Any]:
        image = Image.fromarray(draw(self._current().scene))
        return {"text": {"long_term_context": text, "short_term_context": ""}, "image": image}
