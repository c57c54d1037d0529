"""An adapter to the environment interface of BALROG, a benchmark of language models."""

from __future__ import annotations

from typing import Any

import gymnasium as gym

from lilgym_mp.contrib.llm import progression
from lilgym_mp.envs.rules import State
from lilgym_mp.scene.actions import describe
from lilgym_mp.solver import Solver
from lilgym_mp.wrappers import TextObservation
from lilgym_mp.wrappers.text import picture


class BalrogEnv(TextObservation):
    """Actions are text; observations are {"text": {"long_term_context", "short_term_context"}, "image"}."""

    default_action = "STOP"

    def __init__(self, env: gym.Env[Any, Any], **settings: Any) -> None:
        """`env`: from `gymnasium.make`; `settings`: of TextObservation."""
        super().__init__(env, **settings)
        self._dynamics = self.transformation.env_description.dynamics
        self._solver = Solver(self._dynamics)
        self.max_steps = self._dynamics.horizon

    @property
    def language_action_space(self) -> list[str]:
        """The names of the legal actions."""
        return [*map(self._name, self.action_masks().nonzero()[0].tolist())]

    def get_instruction_prompt(self, instruction: str | None = None) -> str:
        """The rules, then the task's statement and target, or `instruction` instead of these."""
        task = self._current().task
        own = f'Make this statement {str(task.target).lower()}, then STOP: "{task.statement}"'
        return f"{self.instructions()}\n{instruction or own}"

    def reset(self, **arguments: Any) -> Any:
        """As Gymnasium's, with BALROG's observation."""
        text, info = super().reset(**arguments)
        self._start = self._current()
        self._success = False
        self.failed_candidates: list[str] = []
        return self._observation(text), info

    def check_action_validity(self, candidate_action: str) -> str:
        """The name of the action parsed from the text; the default action if none is."""
        reply = self.parse_action(candidate_action)
        if not reply.understood:
            self.failed_candidates.append(candidate_action)
        return self._name(reply.action)

    def step(self, action: str) -> Any:
        """As Gymnasium's, with an action in words and BALROG's observation."""
        text, *signals, info = super().step(self.parse_action(action).action)
        self._success = bool(info.get("is_success"))
        return self._observation(text), *signals, info

    def get_stats(self) -> dict[str, Any]:
        """{"progression": 0 to 1, "success"} of the current episode."""
        progress = progression(self._solver, self._start, self._current(), success=self._success)
        return {"progression": progress, "success": self._success}

    def _current(self) -> State:
        return self.get_wrapper_attr("state")

    def _name(self, index: int) -> str:
        return describe(self._dynamics.appearance.decode(index))

    def _observation(self, text: str) -> dict[str, Any]:
        return {"text": {"long_term_context": text, "short_term_context": ""}, "image": picture(self._current().scene)}
