"""Plan rows over several turns: one action for each reply, and the next scene after it."""

from __future__ import annotations

from typing import NamedTuple

from lilgym_mp.actions import describe
from lilgym_mp.arrays import BoolArray
from lilgym_mp.choices import choose
from lilgym_mp.llm.player import NOT_UNDERSTOOD
from lilgym_mp.rlvr.rows import Row, RowError, dynamics_of
from lilgym_mp.rlvr.scoring import REWARDS, Played
from lilgym_mp.rules import Transition
from lilgym_mp.wrappers.replies import parse_reply
from lilgym_mp.wrappers.text import instructions, is_shown, text_of


class Turn(NamedTuple):
    """What follows a reply."""

    text: str  # for the model
    reward: float
    done: bool
    outcome: str
    action: str | None  # None if the reply was not understood and the model is asked again


class Conversation:
    """One episode of a plan row. As in `lilgym-mp llm`, after a reply without an action the model is asked again, and
    after the next one the action is STOP."""

    def __init__(self, row: Row, reward: str = "success", *, retries: int = 1) -> None:
        """`reward`: "success" or "progress", given at the end, or "return", the environment's reward in each turn.
        `retries`: in a row. Raises RowError for a row of another kind, ValueError for an unknown reward."""
        if row.kind != "plan":
            raise RowError(f"row {row.id!r:.80} is a {row.kind} row; only plans have several turns")
        choose("reward", reward, REWARDS)
        self.row = row
        self._reward = reward
        self._retries = retries
        self._dynamics = dynamics_of(row.appearance)
        self.state = self._dynamics.start(row.task)
        self.done = False
        self._failed = 0  # replies in a row that were not understood

    @property
    def prompt(self) -> str:
        """The first message: the rules and the start."""
        return f"{instructions(self._dynamics)}\n{self._text()}"

    def step(self, reply: object) -> Turn:
        """Raises ValueError after the end."""
        if self.done:
            raise ValueError("the episode is over")
        appearance = self._dynamics.appearance

        def legal() -> BoolArray:
            return self._dynamics.legal_mask(self.state)

        text = reply if isinstance(reply, str) else ""
        parsed = parse_reply(text, appearance, 0, lambda index: is_shown(index, legal, appearance))
        if not parsed.understood and self._failed < self._retries:
            self._failed += 1
            return Turn(NOT_UNDERSTOOD, 0.0, False, "not_understood", None)
        self._failed = 0
        action = appearance.decode(parsed.action)
        moved = self._dynamics.step(self.state, action)
        self.state, self.done = moved.state, moved.result.ends
        outcome = str(moved.outcome)
        text = f"The episode is over: {outcome}." if self.done else self._text()
        return Turn(text, self._rewarded(moved), self.done, outcome, describe(action))

    def _rewarded(self, moved: Transition) -> float:
        if self._reward == "return":
            return moved.reward
        return REWARDS[self._reward](Played(self.row, str(moved.outcome), moved.state, 0.0)) if self.done else 0.0

    def _text(self) -> str:
        return text_of(self._dynamics, self.state, legal=self._dynamics.legal_mask(self.state))
