"""Scores replies exactly. No reply raises: what cannot be read scores like a failure, and says why."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from lilgym_mp.contrib.llm.summary import progression
from lilgym_mp.contrib.rlvr.answers import NotUnderstood, read_plan, read_program, read_scene, read_truth
from lilgym_mp.contrib.rlvr.checked_scenes import STEP_LIMIT, checked_truths
from lilgym_mp.contrib.rlvr.rows import Row, RowError, dynamics_of, solver_of
from lilgym_mp.envs.rules import Outcome, State
from lilgym_mp.programs import ProgramError, StepLimitError, bounded_truths
from lilgym_mp.scene.actions import describe
from lilgym_mp.scene.choices import choose
from lilgym_mp.wrappers.replies import THOUGHTS

SUCCESS, WRONG, NO_STOP, NOT_UNDERSTOOD = "success", "wrong", "no_stop", "not_understood"  # besides the rules' outcomes


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


def _check_scene(reply: object, row: Row, thoughts: Sequence[str]) -> tuple[bool, dict[str, Any]]:
    scene = read_scene(reply, dynamics_of(row.appearance).appearance, thoughts=thoughts)
    try:
        (value,) = bounded_truths(row.task.program, (scene,))
    except StepLimitError as error:
        raise NotUnderstood(str(error)) from None
    return value == row.task.target, {"scene": scene.to_json()}


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
    "scene": _check_scene,
    "program": _check_program,
}
