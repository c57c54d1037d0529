"""What one action does to one state, and what it is worth: the only home of both.

Source: SPEC sections 4, 5 and 7 (Wu et al. 2023, section 4, and release 0.0.1).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum, StrEnum
from typing import NamedTuple

from lilgym_mp.actions import Action, Stop
from lilgym_mp.appearances import Appearance, BoolArray, InvalidReason, PlacementRules
from lilgym_mp.choices import choose
from lilgym_mp.scene import Scene
from lilgym_mp.task import Task
from lilgym_mp.tuples import new_tuple

STEP_COST = 0.1


class Outcome(StrEnum):
    """What came of an action. All but CONTINUES end the episode."""

    CONTINUES = "continues"
    SUCCESS = "success"
    WRONG_STOP = "wrong_stop"
    INVALID_ACTION = "invalid_action"
    HORIZON = "horizon"


class Consequence(NamedTuple):
    """What an outcome is worth, and whether and how it ends the episode."""

    reward: float
    terminated: bool
    truncated: bool


@dataclass(frozen=True)
class RuleSet:
    """Everything in which one reading of the MDP differs from another."""

    name: str
    horizon: int
    placement: PlacementRules
    consequences: Mapping[Outcome, Consequence]
    applies_edit_at_horizon: bool
    truncates_last_stop: bool  # a STOP that is the last action allowed is flagged truncated as well


_PAPER = RuleSet(
    name="paper",
    horizon=12,
    placement=PlacementRules(searches_cell=True, keeps_unfit_snaps=False, rounds_in_image=False),
    consequences={
        Outcome.CONTINUES: Consequence(-STEP_COST, terminated=False, truncated=False),
        Outcome.SUCCESS: Consequence(1.0, terminated=True, truncated=False),
        Outcome.WRONG_STOP: Consequence(-1.0, terminated=True, truncated=False),
        Outcome.INVALID_ACTION: Consequence(-1.0, terminated=True, truncated=False),
        Outcome.HORIZON: Consequence(-1.0, terminated=True, truncated=False),
    },
    applies_edit_at_horizon=True,
    truncates_last_stop=False,
)

_RELEASE = RuleSet(
    name="release",
    horizon=11,
    placement=PlacementRules(searches_cell=False, keeps_unfit_snaps=True, rounds_in_image=True),
    consequences={
        Outcome.CONTINUES: Consequence(-STEP_COST, terminated=False, truncated=False),
        Outcome.SUCCESS: Consequence(1.0, terminated=True, truncated=False),
        Outcome.WRONG_STOP: Consequence(-1.0, terminated=True, truncated=False),
        Outcome.INVALID_ACTION: Consequence(-1.0, terminated=False, truncated=True),
        Outcome.HORIZON: Consequence(-STEP_COST, terminated=False, truncated=True),
    },
    applies_edit_at_horizon=False,
    truncates_last_stop=True,
)

RULE_SETS: Mapping[str, RuleSet] = {rules.name: rules for rules in (_PAPER, _RELEASE)}


class Situation(IntEnum):
    """What an action turned out to be, before the rule set judges it."""

    RIGHT_STOP = 0
    WRONG_STOP = 1
    INVALID_EDIT = 2
    VALID_EDIT = 3


class Verdict(NamedTuple):
    """What a rule set makes of a situation."""

    number: int  # 2 * situation, plus 1 when the action is the last one allowed
    outcome: Outcome
    reward: float
    terminated: bool
    truncated: bool
    applies: bool  # whether the edit's scene becomes the new one


_OUTCOMES = {
    Situation.RIGHT_STOP: Outcome.SUCCESS,
    Situation.WRONG_STOP: Outcome.WRONG_STOP,
    Situation.INVALID_EDIT: Outcome.INVALID_ACTION,
    Situation.VALID_EDIT: Outcome.CONTINUES,
}


def _verdict(rules: RuleSet, situation: Situation, *, last: bool) -> Verdict:
    outcome = _OUTCOMES[situation]
    if last and situation is Situation.VALID_EDIT:
        outcome = Outcome.HORIZON
    reward, terminated, truncated = rules.consequences[outcome]
    if last and situation in (Situation.RIGHT_STOP, Situation.WRONG_STOP):
        truncated = truncated or rules.truncates_last_stop
    applies = situation is Situation.VALID_EDIT and (rules.applies_edit_at_horizon or not last)
    return Verdict(2 * situation + last, outcome, reward, terminated, truncated, applies)


class State(NamedTuple):
    """A moment of an episode; `steps` actions have been taken."""

    task: Task
    scene: Scene
    steps: int


class Transition(NamedTuple):
    """What an action made of a state."""

    state: State
    verdict: Verdict
    invalid: InvalidReason | None  # why, when the outcome is INVALID_ACTION

    @property
    def outcome(self) -> Outcome:
        return self.verdict.outcome

    @property
    def reward(self) -> float:
        return self.verdict.reward

    @property
    def terminated(self) -> bool:
        return self.verdict.terminated

    @property
    def truncated(self) -> bool:
        return self.verdict.truncated


@dataclass(frozen=True, slots=True)
class Dynamics:
    """The MDP of one appearance under one rule set and horizon, as pure functions of states."""

    appearance: Appearance
    rules: RuleSet
    horizon: int
    verdicts: Sequence[Verdict] = field(init=False, repr=False, compare=False)  # by number
    _of_stop: Sequence[Sequence[Verdict]] = field(init=False, repr=False, compare=False)  # [right][last]
    _of_edit: Sequence[Sequence[Verdict]] = field(init=False, repr=False, compare=False)  # [valid][last]

    def __post_init__(self) -> None:
        pairs = ((situation, last) for situation in Situation for last in (False, True))
        table = tuple(_verdict(self.rules, situation, last=last) for situation, last in pairs)
        rows = {situation: table[2 * situation : 2 * situation + 2] for situation in Situation}
        object.__setattr__(self, "verdicts", table)
        # What `step` indexes by bools; numbering a situation by its enum takes three times as long.
        object.__setattr__(self, "_of_stop", (rows[Situation.WRONG_STOP], rows[Situation.RIGHT_STOP]))
        object.__setattr__(self, "_of_edit", (rows[Situation.INVALID_EDIT], rows[Situation.VALID_EDIT]))

    def start(self, task: Task) -> State:
        return new_tuple(State, (task, task.start, 0))

    def step(self, state: State, action: Action) -> Transition:
        """What `action` makes of `state`. An invalid action is an outcome, never an exception."""
        task, scene, steps = state
        steps += 1
        invalid = None
        if type(action) is Stop:
            after = scene
            verdict = self._of_stop[task.solved_by(scene)][steps >= self.horizon]
        else:
            after, invalid = self.appearance.apply(scene, action, self.rules.placement)
            verdict = self._of_edit[invalid is None][steps >= self.horizon]
        moved = new_tuple(State, (task, after if verdict.applies else scene, steps))
        return new_tuple(Transition, (moved, verdict, invalid))

    def wait(self, state: State) -> Transition:
        """What a step that leaves the scene makes of `state`: it counts as a valid edit does."""
        steps = state.steps + 1
        verdict = self._of_edit[True][steps >= self.horizon]
        return Transition(State(state.task, state.scene, steps), verdict, None)

    def legal_mask(self, state: State) -> BoolArray:
        """(action_count,) a new array: whether each action is valid in `state`."""
        return self.appearance.legal_mask(state.scene, self.rules.placement)

    def goal_reached(self, state: State) -> bool:
        """Whether STOP would be rewarded +1 in `state`."""
        return state.task.solved_by(state.scene)


def make_dynamics(appearance: Appearance, rules: str = "paper", horizon: int | None = None) -> Dynamics:
    """The MDP under the rule set called `rules`; `horizon` actions an episode (None: the rule set's).

    Raises ValueError for an unknown rule set or a horizon that is not a positive whole number.
    """
    rule_set = choose("rules", rules, RULE_SETS)
    if horizon is None:
        horizon = rule_set.horizon
    if isinstance(horizon, bool) or not isinstance(horizon, int) or horizon < 1:  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ValueError(f"horizon must be a positive whole number of actions or None, not {horizon!r}")
    return Dynamics(appearance, rule_set, horizon)
