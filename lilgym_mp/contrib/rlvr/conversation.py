"""Plan rows over several turns: one action for each reply, and the next scene after it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

from PIL import Image

from lilgym_mp.contrib.rlvr.rows import Row, RowError, dynamics_of
from lilgym_mp.contrib.rlvr.scoring import NOT_UNDERSTOOD, REWARDS, Played
from lilgym_mp.envs.rules import Outcome
from lilgym_mp.scene.actions import describe
from lilgym_mp.scene.choices import choose
from lilgym_mp.wrappers.replies import ASK_AGAIN, THOUGHTS, parse_reply
from lilgym_mp.wrappers.text import SCENE_STYLES, instructions, is_shown, picture, reward_line, text_of

REWARD_LINES = {  # what the prompt says of each of REWARDS
    "success": "Reward: 1 if you STOP when the statement is as wanted, else 0. An illegal action ends the episode.",
    "progress": "Reward: 1 if you STOP when the statement is as wanted, else your progress towards it, from 0 to below"
    " 1. An illegal action ends the episode.",
}


class Turn(NamedTuple):
    """What follows a reply."""

    text: str  # for the model
    reward: float
    done: bool
    outcome: str
    action: str | None  # None if the reply was not understood


class Conversation:
    """One episode of a plan row. After a reply without an action the model is asked again; the next one in a row ends
    the episode as not understood, without success: only a STOP that was said counts."""

    def __init__(
        self,
        row: Row,
        reward: str = "success",
        *,
        retries: int = 1,
        scene: str = "list",
        thoughts: Sequence[str] = THOUGHTS,
    ) -> None:
        """`reward`: "success" or "progress", given at the end, or "return", the environment's reward in each turn.
        `retries`: in a row. `scene`: as for `TextObservation`; `images` has the pictures. `thoughts`: their tags.
        Raises RowError for a row of another kind, ValueError for an unknown reward or scene."""
        if row.kind != "plan":
            raise RowError(f"row {row.id!r:.80} is a {row.kind} row; only plans have several turns")
        choose("reward", reward, REWARDS)
        self._is_seen = choose("scene", scene, SCENE_STYLES)
        self.row = row
        self._reward = reward
        self._retries = retries
        self._scene = scene
        self._thoughts = thoughts
        self._dynamics = dynamics_of(row.appearance)
        self.state = self._dynamics.start(row.task)
        self.done = False
        self._failed = 0  # replies in a row that were not understood

    @property
    def prompt(self) -> str:
        """The first message: the rules and the start."""
        rewards = REWARD_LINES.get(self._reward) or reward_line(self._dynamics)
        return f"{instructions(self._dynamics, rewards)}\n{self._text()}"

    @property
    def images(self) -> list[Image.Image]:
        """The picture that belongs to the last text, if scenes are shown as pictures."""
        return [picture(self.state.scene)] if self._is_seen and not self.done else []

    def step(self, reply: object) -> Turn:
        """`reply`: a text, content parts or messages. Raises ValueError after the end."""
        if self.done:
            raise ValueError("the episode is over")
        appearance = self._dynamics.appearance
        shown = partial(is_shown, appearance, lambda: self._dynamics.legal_mask(self.state))
        parsed = parse_reply(reply, appearance, 0, shown, thoughts=self._thoughts)
        if parsed.understood:
            self._failed, action = 0, appearance.decode(parsed.action)
            moved = self._dynamics.step(self.state, action)
            self.state, self.done = moved.state, moved.result.ends
            name, outcome, reward = describe(action), str(moved.outcome), moved.reward
        else:
            self._failed += 1
            self.done = self._failed > self._retries
            if not self.done:
                return Turn(ASK_AGAIN, 0.0, False, NOT_UNDERSTOOD, None)
            name, outcome = None, NOT_UNDERSTOOD
            reward = self._dynamics.rules.signals[Outcome.WRONG_STOP].reward  # as for a plan that is not understood
        if self._reward != "return":
            played = Played(self.row, outcome, self.state, 0.0)
            reward = REWARDS[self._reward](played) if self.done else 0.0
        text = f"The episode is over: {outcome}." if self.done else self._text()
        return Turn(text, reward, self.done, outcome, name)

    def _text(self) -> str:
        legal = self._dynamics.legal_mask(self.state)
        return text_of(self._dynamics, self.state, legal=legal, scene=self._scene, rules=False)
