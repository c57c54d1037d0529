"""Scores replies exactly, whole answers or one action at a time.

No reply raises: what cannot be read scores like a failure, and says why.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from functools import partial
from typing import Any, NamedTuple

from PIL import Image

from lilgym_mp.contrib.llm.summary import progression
from lilgym_mp.contrib.rlvr.answers import NotUnderstood, read_plan, read_program, read_truth
from lilgym_mp.contrib.rlvr.checked_scenes import STEP_LIMIT, checked_truths
from lilgym_mp.contrib.rlvr.rows import Row, RowError, dynamics_of, solver_of
from lilgym_mp.envs.rules import Outcome, State
from lilgym_mp.programs import ProgramError, StepLimitError, bounded_truths
from lilgym_mp.scene.actions import describe
from lilgym_mp.scene.choices import choose
from lilgym_mp.wrappers.replies import ASK_AGAIN, THOUGHTS, parse_reply
from lilgym_mp.wrappers.text import SCENE_STYLES, instructions, is_shown, picture, reward_line, text_of

SUCCESS, WRONG, NO_STOP, NOT_UNDERSTOOD = "success", "wrong", "no_stop", "not_understood"  # besides the rules' outcomes
REWARD_LINES = {  # what the prompt of a conversation says of each of REWARDS
    "success": "Reward: 1 if you STOP when the statement is as wanted, else 0. An illegal action ends the episode.",
    "progress": "Reward: 1 if you STOP when the statement is as wanted, else your progress towards it, from 0 to below"
    " 1. An illegal action ends the episode.",
}


class Score(NamedTuple):
    """The score of a reply."""

    reward: float
    outcome: str
    details: Mapping[str, Any]

    @property
    def success(self) -> bool:
        return self.outcome == SUCCESS


class Played(NamedTuple):
    """A plan carried out."""

    row: Row
    outcome: str
    last: State
    total: float  # the environment's return; a plan without STOP is rewarded as if a wrong STOP followed


def _progress(played: Played) -> float:
    solver, start = solver_of(played.row.appearance), played.last._replace(scene=played.row.task.start)
    return progression(solver, start, played.last, success=played.outcome == SUCCESS)


REWARDS: Mapping[str, Callable[[Played], float]] = {
    "success": lambda played: float(played.outcome == SUCCESS),
    "progress": _progress,
    "return": lambda played: played.total,
}


def score(reply: object, row: Row, reward: str = "success", *, thoughts: Sequence[str] = THOUGHTS) -> Score:
    """The score of a model's reply, a text, content parts or messages; anything else is not understood.

    `reward`: "success", 1 or 0; for plans also "progress" towards the goal from 0 to 1, or the environment's "return".
    `thoughts`: tags of thoughts, which are not read (`wrappers.replies.THOUGHTS`). Raises ValueError for another
    reward, RowError for a program row whose own program `checked_truths` refuses.
    """
    rewarded = choose("reward", reward, REWARDS)
    if row.kind == "plan":
        played, details = _play(reply, row, thoughts)
        return Score(rewarded(played), played.outcome, details)
    if reward != SUCCESS:
        raise ValueError(f"the reward {reward!r} is for plans; a {row.kind} is rewarded by success")
    try:
        is_right, details = _CHECKS[row.kind](reply, row, thoughts)
    except NotUnderstood as error:
        return Score(0.0, NOT_UNDERSTOOD, {"reason": str(error)})
    return Score(float(is_right), SUCCESS if is_right else WRONG, details)


def _play(reply: object, row: Row, thoughts: Sequence[str]) -> tuple[Played, dict[str, Any]]:
    """The plan in a reply carried out, and its actions or why it is not understood."""
    dynamics = dynamics_of(row.appearance)
    state, total, outcome = dynamics.start(row.task), 0.0, NO_STOP
    names: list[str] = []
    try:
        plan = read_plan(reply, dynamics.appearance, thoughts=thoughts)
    except NotUnderstood as error:
        wrong_stop = dynamics.rules.signals[Outcome.WRONG_STOP].reward
        return Played(row, NOT_UNDERSTOOD, state, wrong_stop), {"reason": str(error)}
    for index in plan:
        action = dynamics.appearance.decode(index)
        names.append(describe(action))
        state, result, _ = dynamics.step(state, action)
        total += result.reward
        if result.ends:
            outcome = str(result.outcome)
            break
    else:
        total += dynamics.rules.signals[Outcome.WRONG_STOP].reward
    return Played(row, outcome, state, round(total, 6)), {"actions": names}


def _check_truth(reply: object, row: Row, thoughts: Sequence[str]) -> tuple[bool, dict[str, Any]]:
    answer = read_truth(reply, thoughts=thoughts)
    return answer == row.task.truth(row.task.start), {"answer": answer}


def _check_program(reply: object, row: Row, thoughts: Sequence[str]) -> tuple[bool, dict[str, Any]]:
    program = read_program(reply, thoughts=thoughts)
    expected = checked_truths(row.task.program, row.appearance)
    if expected is None:
        raise RowError(f"row {row.id!r:.80}: its program is too slow, or too rarely true or false, to check others")
    try:
        truths = bounded_truths(program, tuple(expected), step_limit=STEP_LIMIT)
    except (ProgramError, StepLimitError) as error:
        raise NotUnderstood(str(error)) from None
    agreeing = sum(map(bool.__eq__, map(bool, truths), expected.values()))
    return agreeing == len(expected), {"program": program, "agreement": agreeing / len(expected)}


_CHECKS: Mapping[str, Callable[[object, Row, Sequence[str]], tuple[bool, dict[str, Any]]]] = {
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
    """One episode of a plan row, one action for each reply.

    After a reply without an action the model is asked again; the next one in a row ends the episode as not understood,
    without success: only a STOP that was said counts. `reward`: "success" or "progress", given at the end, or
    "return", the environment's reward in each turn. `retries`: in a row. `scene`: as for `TextObservation`; `images`
    has the pictures. `thoughts`: their tags. Raises RowError for a row of another kind, ValueError for an unknown
    reward or scene.
    """

    row: Row
    reward: str = "success"
    _: KW_ONLY
    retries: int = 1
    scene: str = "list"
    thoughts: Sequence[str] = THOUGHTS
    state: State = field(init=False)
    done: bool = field(init=False, default=False)

    def __post_init__(self) -> None:
        if self.row.kind != "plan":
            raise RowError(f"row {self.row.id!r:.80} is a {self.row.kind} row; only plans have several turns")
        choose("reward", self.reward, REWARDS)
        self._is_seen = choose("scene", self.scene, SCENE_STYLES)
        self._dynamics = dynamics_of(self.row.appearance)
        self.state = self._dynamics.start(self.row.task)
        self._failed = 0  # replies in a row that were not understood

    @property
    def prompt(self) -> str:
        """The first message: the rules and the start."""
        rewards = REWARD_LINES.get(self.reward) or reward_line(self._dynamics)
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
        parsed = parse_reply(reply, appearance, 0, shown, thoughts=self.thoughts)
        if parsed.understood:
            self._failed, action = 0, appearance.decode(parsed.action)
            moved = self._dynamics.step(self.state, action)
            self.state, self.done = moved.state, moved.result.ends
            name, outcome, reward = describe(action), str(moved.outcome), moved.reward
        else:
            self._failed += 1
            self.done = self._failed > self.retries
            if not self.done:
                return Turn(ASK_AGAIN, 0.0, False, NOT_UNDERSTOOD, None)
            name, outcome = None, NOT_UNDERSTOOD
            reward = self._dynamics.rules.signals[Outcome.WRONG_STOP].reward  # as for a plan that is not understood
        if self.reward != "return":
            reward = REWARDS[self.reward](Played(self.row, outcome, self.state, 0.0)) if self.done else 0.0
        text = f"The episode is over: {outcome}." if self.done else self._text()
        return Turn(text, reward, self.done, outcome, name)

    def _text(self) -> str:
        legal = self._dynamics.legal_mask(self.state)
        return text_of(self._dynamics, self.state, legal=legal, scene=self.scene, rules=False)
