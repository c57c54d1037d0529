"""An environment in the form in which BALROG plays language models."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
from PIL import Image

from lilgym_mp.actions import describe
from lilgym_mp.llm.summary import progression
from lilgym_mp.render import draw
from lilgym_mp.rules import State
from lilgym_mp.solver import Solver
from lilgym_mp.wrappers import TextObservation

LISTED = 64  # up to this many actions are named in `language_action_space`


class BalrogEnv(gym.Wrapper[Any, Any, Any, Any]):
    """Takes actions as text, shows {"text": {"long_term_context", "short_term_context"}, "image"}, and tells
    instructions, action names and progression as BALROG's environments do."""

    def __init__(self, env: gym.Env[Any, Any], *, scene: str = "list", legal_actions: bool = True) -> None:
        """`env`: as `gymnasium.make` gives it; `scene`, `legal_actions` as for TextObservation."""
        self._told = TextObservation(env, scene=scene, legal_actions=legal_actions)
        super().__init__(self._told)
        self._dynamics = self._told.get_wrapper_attr("dynamics")
        self._solver = Solver(self._dynamics)
        self.failed_candidates: list[str] = []
        self._start: State | None = None
        self._success = False

    @property
    def max_steps(self) -> int:
        return self._dynamics.horizon

    @property
    def default_action(self) -> str:
        return "STOP"

    @property
    def language_action_space(self) -> list[str]:
        """The names of all actions; in Scatter, of hundreds, those of the actions that are legal now."""
        appearance = self._dynamics.appearance
        if appearance.action_count <= LISTED:
            return [describe(appearance.decode(number)) for number in range(appearance.action_count)]
        return [describe(appearance.decode(number)) for number in self._told.action_masks().nonzero()[0].tolist()]

    def get_instruction_prompt(self, instruction: str | None = None) -> str:
        """The rules, and the task's statement and target, or `instruction` in their place."""
        if instruction is None:
            task = self._state().task
            instruction = f'Make this statement {str(task.target).lower()}, then STOP: "{task.statement}"'
        return f"{self._told.instructions()}\n{instruction}"

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        text, info = self._told.reset(seed=seed, options=options)
        self._start, self._success = self._state(), False
        self.failed_candidates = []
        return self._shown(text), info

    def check_action_validity(self, candidate_action: str) -> str:
        """The name of the action that the text decides for; the default action where it decides for none."""
        reply = self._told.parse_action(candidate_action)
        if not reply.understood:
            self.failed_candidates.append(candidate_action)
            return self.default_action
        return describe(self._dynamics.appearance.decode(reply.action))

    def step(self, action: str) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        text, reward, terminated, truncated, info = self._told.step(self._told.parse_action(action).action)
        self._success = bool(info.get("is_success", False))
        return self._shown(text), float(reward), terminated, truncated, info

    def get_stats(self) -> dict[str, Any]:
        """{"progression": 0 to 1, "success"}, of the episode so far."""
        assert self._start is not None, "reset comes first"
        way = progression(self._solver, self._start, self._state(), success=self._success)
        return {"progression": way, "success": self._success}

    def _state(self) -> State:
        return self._told.get_wrapper_attr("state")

    def _shown(self, text: str) -> dict[str, Any]:
        picture = Image.fromarray(draw(self._state().scene))
        return {"text": {"long_term_context": text, "short_term_context": ""}, "image": picture}
