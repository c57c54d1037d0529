"""Scores replies exactly, whole answers or one action at a time: the reward is 1 for success, else 0.

No reply raises: what cannot be read scores like a failure, and says why.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from functools import partial
from typing import NamedTuple

from PIL import Image

from lilgym_mp.contrib.rlvr.answers import NotUnderstood, read_plan, read_program, read_truth
from lilgym_mp.contrib.rlvr.checked_scenes import STEP_LIMIT, checked_truths
from lilgym_mp.contrib.rlvr.regrets import credit
from lilgym_mp.contrib.rlvr.rows import Row, RowError, dynamics_of, right_answer
from lilgym_mp.envs.rules import State
from lilgym_mp.programs import ProgramError, StepLimitError
from lilgym_mp.programs.bounded import bounded_truths
from lilgym_mp.scene.actions import describe
from lilgym_mp.scene.arrays import AnyDict, AnyMapping
from lilgym_mp.scene.choices import choose
from lilgym_mp.wrappers.replies import ASK_AGAIN, NOT_UNDERSTOOD, THOUGHTS, parse_reply, unusual_end
from lilgym_mp.wrappers.text import SCENE_STYLES, instructions, is_shown, picture, text_of

# Besides the rules' outcomes and those of replies
SUCCESS = "success"
WRONG = "wrong"
NO_STOP = "no_stop"
Checked = tuple[str, AnyDict]  # the outcome and details of a reply
REWARD_LINE = "Reward: 1 if you STOP when the statement is as wanted, else 0. An illegal action ends the episode."


class Score(NamedTuple):
    """The score of a reply."""

    reward: float
    outcome: str
    details: AnyMapping


def score(reply: object, row: Row, *, thoughts: Sequence[str] = THOUGHTS, finish_reason: str | None = None) -> Score:
    """The score of a model's reply, a text, content parts or messages; anything else is not understood.

    `finish_reason`: the server's, if known; a reply that was cut or filtered is not read, and that is its outcome.
    `thoughts`: tags of thoughts, which are not read (`wrappers.replies.THOUGHTS`). Raises RowError for a program row
    whose own program `checked_truths` refuses.
    """
    if (problem := unusual_end(finish_reason)) is not None:
        return Score(0.0, problem, {"reason": f"the reply ended with finish_reason {finish_reason!r:.80}"})
    try:
        outcome, details = _CHECKS[row.kind](reply, row, thoughts)
    except NotUnderstood as error:
        outcome = NOT_UNDERSTOOD
        details = {"reason": str(error)}
    return Score(float(outcome == SUCCESS), outcome, details)


def _check_plan(reply: object, row: Row, thoughts: Sequence[str]) -> Checked:
    """Carries the plan out; "regrets" has the return that each action loses, None if unknown (`regrets.Credit`)."""
    dynamics = dynamics_of(row.appearance)
    state = dynamics.start(row.task)
    names: list[str] = []
    regrets: list[float | None] = []
    for index in read_plan(reply, dynamics.appearance, thoughts=thoughts):
        action = dynamics.appearance.decode(index)
        names.append(describe(action))
        before = state
        state, result, _ = dynamics.step(state, action)
        regrets.append(credit(row.appearance, before, state, str(result.outcome)).regret)
        if result.ends:
            return str(result.outcome), {"actions": names, "regrets": regrets}
    return NO_STOP, {"actions": names, "regrets": regrets}


def _check_answer(reply: object, row: Row, thoughts: Sequence[str]) -> Checked:
    answer = read_truth(reply, thoughts=thoughts)
    return SUCCESS if answer == right_answer(row) else WRONG, {"answer": answer}


def _check_program(reply: object, row: Row, thoughts: Sequence[str]) -> Checked:
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


_CHECKS: Mapping[str, Callable[[object, Row, Sequence[str]], Checked]] = {
    "plan": _check_plan,
    "truth": _check_answer,
    "verify": _check_answer,
    "program": _check_program,
}


class Turn(NamedTuple):
    """The answer to a reply."""

    text: str  # for the model
    reward: float
    done: bool
    outcome: str
    action: str | None  # None if the reply was not understood
    regret: float | None = None  # return of the paper's rules that the turn lost against the expert; None if unknown
    distance_before: int | None = None  # actions of a shortest solution with STOP; None: unknown or none
    distance_after: int | None = None  # the same; 0 after success


@dataclass
class Conversation:
    """One episode of a plan row, one action for each reply; the reward is given at the end.

    After a reply without an action the model is asked again; the next one in a row ends the episode as not understood,
    without success: only a STOP that was said counts. Each turn has its regret, for trainers that reward turns: 0 for
    an action of a shortest solution (`regrets.Credit`). `retries`: in a row. `scene`: as for `TextObservation`;
    `images` has the pictures. `thoughts`: their tags. Raises RowError for a row of another kind, ValueError for an
    unknown scene.
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

    def step(self, reply: object, finish_reason: str | None = None) -> Turn:
        """`reply`: a text, content parts or messages. `finish_reason`: as for `score`.

        Raises ValueError after the end.
        """
        if self.done:
            raise ValueError("the episode is over")
        appearance = self._dynamics.appearance
        shown = partial(is_shown, appearance, lambda: self._dynamics.legal_mask(self.state))
        parsed = parse_reply(reply, appearance, 0, shown, thoughts=self.thoughts)
        before = self.state
        problem = unusual_end(finish_reason) or (None if parsed.understood else NOT_UNDERSTOOD)
        if problem is None:
            self._failed = 0
            action = appearance.decode(parsed.action)
            moved = self._dynamics.step(self.state, action)
            self.state = moved.state
            self.done = moved.result.ends
            name = describe(action)
            outcome = str(moved.outcome)
        else:
            self._failed += 1
            self.done = self._failed > self.retries
            name = None
            outcome = problem
        again = name is None and not self.done
        judged = credit(self.row.appearance, before, self.state, outcome, asked_again=again)
        if self.done:
            return Turn(f"The episode is over: {outcome}.", float(outcome == SUCCESS), True, outcome, name, *judged)
        return Turn(ASK_AGAIN if name is None else self._text(), 0.0, False, outcome, name, *judged)

    def _text(self) -> str:
        legal = self._dynamics.legal_mask(self.state)
        return text_of(self._dynamics, self.state, legal=legal, scene=self.scene, rules=False)
