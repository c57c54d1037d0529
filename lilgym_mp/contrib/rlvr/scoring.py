"""Scores replies exactly, whole answers or one action at a time: the reward is 1 for success, else 0.

No reply raises: what cannot be read scores like a failure, and says why.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from functools import partial
from typing import Any, NamedTuple

from PIL import Image

from lilgym_mp.contrib.rlvr.answers import NotUnderstood, read_plan, read_program, read_truth
from lilgym_mp.contrib.rlvr.checked_scenes import STEP_LIMIT, checked_truths
from lilgym_mp.contrib.rlvr.rows import Row, RowError, dynamics_of
from lilgym_mp.envs.rules import State
from lilgym_mp.programs import ProgramError, StepLimitError, bounded_truths
from lilgym_mp.scene.actions import describe
from lilgym_mp.scene.choices import choose
from lilgym_mp.wrappers.replies import ASK_AGAIN, THOUGHTS, parse_reply
from lilgym_mp.wrappers.text import SCENE_STYLES, instructions, is_shown, picture, text_of

SUCCESS, WRONG, NO_STOP, NOT_UNDERSTOOD = "success", "wrong", "no_stop", "not_understood"  # besides the rules' outcomes
REWARD_LINE = "Reward: 1 if you STOP when the statement is as wanted, else 0. An illegal action ends the episode."


class Score(NamedTuple):
    """The score of a reply."""

    reward: float
    outcome: str
    details: Mapping[str, Any]


def score(reply: object, row: Row, *, thoughts: Sequence[str] = THOUGHTS) -> Score:
    """The score of a model's reply, a text, content parts or messages; anything else is not understood.

    `thoughts`: tags of thoughts, which are not read (`wrappers.replies.THOUGHTS`). Raises RowError for a program row
    whose own program `checked_truths` refuses.
    """
    try:
        outcome, details = _CHECKS[row.kind](reply, row, thoughts)
    except NotUnderstood as error:
        outcome = NOT_UNDERSTOOD
        details = {"reason": str(error)}
    return Score(float(outcome == SUCCESS), outcome, details)


def _check_plan(reply: object, row: Row, thoughts: Sequence[str]) -> tuple[str, dict[str, Any]]:
    """Carries the plan out."""
    dynamics = dynamics_of(row.appearance)
    state = dynamics.start(row.task)
    names: list[str] = []
    for index in read_plan(reply, dynamics.appearance, thoughts=thoughts):
        action = dynamics.appearance.decode(index)
        names.append(describe(action))
        state, result, _ = dynamics.step(state, action)
        if result.ends:
            return str(result.outcome), {"actions": names}
    return NO_STOP, {"actions": names}


def _check_truth(reply: object, row: Row, thoughts: Sequence[str]) -> tuple[str, dict[str, Any]]:
    answer = read_truth(reply, thoughts=thoughts)
    return SUCCESS if answer == row.task.truth(row.task.start) else WRONG, {"answer": answer}


def _check_program(reply: object, row: Row, thoughts: Sequence[str]) -> tuple[str, dict[str, Any]]:
    program = read_program(reply, thoughts=thoughts)
    expected = checked_truths(row.task.program, row.appearance)
    if expected is None:
        raise RowError(f"row {row.id!r:.80}: its program is too slow, or too rarely true or false, to check others")
    try:
        truths = bounded_truths(program, tuple(expected), step_limit=STEP_LIMIT)
    except (ProgramError, StepLimitError) as error:
        raise NotUnderstood(str(error)) from None
    agreeing = sum(map(bool.__eq__, map(bool, truths), expected.values()))
    details = {"program": program, "agreement": agreeing / len(expected)}
    return SUCCESS if agreeing == len(expected) else WRONG, details


_CHECKS: Mapping[str, Callable[[object, Row, Sequence[str]], tuple[str, dict[str, Any]]]] = {
    "plan": _check_plan,
    "truth": _check_truth,
    "program": _check_program,
}


class Turn(NamedTuple):
    """The answer to a reply."""

    text: str  # for the model
    reward: float
    done: bool
    outcome: str
    action: str | None  # None if the reply was not understood


@dataclass
class Conversation:
    """One episode of a plan row, one action for each reply; the reward is given at the end.

    After a reply without an action the model is asked again; the next one in a row ends the episode as not understood,
    without success: only a STOP that was said counts. `retries`: in a row. `scene`: as for `TextObservation`; `images`
    has the pictures. `thoughts`: their tags. Raises RowError for a row of another kind, ValueError for an unknown
    scene.
    """

    row: Row
    _: KW_ONLY
    retries: int = 1
    scene: str = "list"
    thoughts: Sequence[str] = THOUGHTS
    state: State = field(init=False)
    done: bool = field(init=False, default=False)

    def __post_init__(self) -> None:
        if self.row.kind != "plan":
            raise RowError(f"row {self.row.id!r:.80} is a {self.row.kind} row; only plans have several turns")
        self._is_seen = choose("scene", self.scene, SCENE_STYLES)
        self._dynamics = dynamics_of(self.row.appearance)
        self.state = self._dynamics.start(self.row.task)
        self._failed = 0  # replies in a row that were not understood

    @property
    def prompt(self) -> str:
        """The first message: the rules and the start."""
        return f"{instructions(self._dynamics, REWARD_LINE)}\n{self._text()}"

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
        parsed = parse_reply(reply, appearance, 0, shown, thoughts=self.thoughts)
        if parsed.understood:
            action = appearance.decode(parsed.action)
            self._failed = 0
            moved = self._dynamics.step(self.state, action)
            self.state = moved.state
            self.done = moved.result.ends
            name = describe(action)
            outcome = str(moved.outcome)
        else:
            self._failed += 1
            self.done = self._failed > self.retries
            name = None
            outcome = NOT_UNDERSTOOD
        if self.done:
            return Turn(f"The episode is over: {outcome}.", float(outcome == SUCCESS), True, outcome, name)
        return Turn(ASK_AGAIN if name is None else self._text(), 0.0, False, outcome, name)

    def _text(self) -> str:
        legal = self._dynamics.legal_mask(self.state)
        return text_of(self._dynamics, self.state, legal=legal, scene=self.scene, rules=False)
