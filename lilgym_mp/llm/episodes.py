"""Episodes of text agents."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from lilgym_mp.llm.agents import Message


@dataclass(frozen=True)
class Turn:
    """One answer of the agent."""

    answer: str
    understood: bool
    action: str | None  # the action taken; None if the agent was asked again
    seconds: float
    prompt_tokens: int | None
    completion_tokens: int | None
    reasoning: str | None = None  # what the server sent apart from the answer
    retries: int = 0  # failed calls before the answer


@dataclass(frozen=True)
class Episode:
    """An episode with its complete conversation."""

    task: str
    statement: str
    target: bool
    outcome: str
    reward: float  # sum over the episode
    progression: float
    actions: list[str]
    turns: list[Turn]
    messages: list[Message]

    @property
    def is_success(self) -> bool:
        return self.outcome == "success"

    def to_json(self) -> dict[str, Any]:
        return asdict(self)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Episode:
        """Inverse of `to_json`. Raises KeyError or TypeError for other data."""
        return cls(**{**data, "turns": [Turn(**turn) for turn in data["turns"]]})


@dataclass(frozen=True)
class Failure:
    """An episode that ended because the agent failed."""

    task: str
    error: str
    messages: list[Message]

    def to_json(self) -> dict[str, Any]:
        return asdict(self)
