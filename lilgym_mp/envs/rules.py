"""The MDP: transitions, rewards and ends of episodes. No other module defines these rules.

Source: docs/spec.md, "Rewards and the end of an episode", "Rule sets" (Wu et al. 2023, section 4, and release 0.0.1).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum, StrEnum
from itertools import chain
from typing import Any, NamedTuple

from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene, new_tuple
from lilgym_mp.scene.actions import Action, Stop
from lilgym_mp.scene.appearances import Appearance, InvalidReason, PlacementRules
from lilgym_mp.scene.arrays import BoolArray
from lilgym_mp.scene.choices import checked_count, choose

STEP_COST = 0.1


class Outcome(StrEnum):
    """The outcome of an action. All but CONTINUES end the episode."""

    CONTINUES = "continues"
    SUCCESS = "success"
    WRONG_STOP = "wrong_stop"
    INVALID_ACTION = "invalid_action"
    HORIZON = "horizon"


class OutcomeSignal(NamedTuple):
    """The reward and flags of an outcome."""

    reward: float
    terminated: bool
    truncated: bool


@dataclass(frozen=True)
class RuleSet:
    """The differences between the paper's MDP and the release's."""

    name: str
    horizon: int
    placement: PlacementRules
    signals: Mapping[Outcome, OutcomeSignal]
    applies_edit_at_horizon: bool
    truncates_last_stop: bool  # a STOP at the horizon is also flagged truncated


_PAPER = RuleSet(
    name="paper",
    horizon=12,
    placement=PlacementRules(searches_cell=True, keeps_unfit_snaps=False, rounds_in_image=False),
    signals={
        Outcome.CONTINUES: OutcomeSignal(-STEP_COST, terminated=False, truncated=False),
        Outcome.SUCCESS: OutcomeSignal(1.0, terminated=True, truncated=False),
        Outcome.WRONG_STOP: OutcomeSignal(-1.0, terminated=True, truncated=False),
        Outcome.INVALID_ACTION: OutcomeSignal(-1.0, terminated=True, truncated=False),
        Outcome.HORIZON: OutcomeSignal(-1.0, terminated=True, truncated=False),
    },
    applies_edit_at_horizon=True,
    truncates_last_stop=False,
)

_RELEASE = RuleSet(
    name="release",
    horizon=11,
    placement=PlacementRules(searches_cell=False, keeps_unfit_snaps=True, rounds_in_image=True),
    signals={
        **_PAPER.signals,
        Outcome.INVALID_ACTION: OutcomeSignal(-1.0, terminated=False, truncated=True),
        Outcome.HORIZON: OutcomeSignal(-STEP_COST, terminated=False, truncated=True),
    },
    applies_edit_at_horizon=False,
    truncates_last_stop=True,
)

RULE_SETS = {rules.name: rules for rules in (_PAPER, _RELEASE)}


class ActionStatus(IntEnum):
    """Classification of an action in its state, from which the rule set determines the result."""

    CORRECT_STOP = 0
    WRONG_STOP = 1
    INVALID_EDIT = 2
    VALID_EDIT = 3


class StepResult(NamedTuple):
    """The result of an action by its status and whether it was the last one allowed."""

    code: int  # index in `Dynamics.step_results`
    outcome: Outcome
    reward: float
    terminated: bool
    truncated: bool
    applies: bool  # whether the edit changes the scene

    @property
    def ends(self) -> bool:
        """Whether the episode is over."""
        return self.terminated or self.truncated


_OUTCOMES = {
    ActionStatus.CORRECT_STOP: Outcome.SUCCESS,
    ActionStatus.WRONG_STOP: Outcome.WRONG_STOP,
    ActionStatus.INVALID_EDIT: Outcome.INVALID_ACTION,
    ActionStatus.VALID_EDIT: Outcome.CONTINUES,
}


def result_index(status: Any, *, last: Any) -> Any:
    """Index in `Dynamics.step_results`, for ints or arrays; `last`: whether the action is the last one allowed."""
    return 2 * status + last


def _step_result(rules: RuleSet, status: ActionStatus, *, last: bool) -> StepResult:
    outcome = _OUTCOMES[status]
    if last and status is ActionStatus.VALID_EDIT:
        outcome = Outcome.HORIZON
    reward, terminated, truncated = rules.signals[outcome]
    if last and status in (ActionStatus.CORRECT_STOP, ActionStatus.WRONG_STOP):
        truncated = truncated or rules.truncates_last_stop
    applies = status is ActionStatus.VALID_EDIT and (rules.applies_edit_at_horizon or not last)
    return StepResult(result_index(int(status), last=last), outcome, reward, terminated, truncated, applies)


class State(NamedTuple):
    """A state of the MDP; `steps` actions have been taken in the episode."""

    task: Task
    scene: Scene
    steps: int


class Transition(NamedTuple):
    """The next state and the result of an action."""

    state: State
    result: StepResult
    invalid: InvalidReason | None  # the reason if the outcome is INVALID_ACTION

    @property
    def outcome(self) -> Outcome:
        """How the step ended or went on."""
        return self.result.outcome

    @property
    def reward(self) -> float:
        """Reward of the step."""
        return self.result.reward


@dataclass(frozen=True, slots=True)
class Dynamics:
    """The MDP of one appearance under one rule set and horizon, as pure functions of states.

    Args:
        appearance: The kind of scenes and their actions.
        rules: The rule set.
        horizon: Actions per episode.
    """

    appearance: Appearance
    rules: RuleSet
    horizon: int
    step_results: Sequence[StepResult] = field(init=False, repr=False, compare=False)  # by `result_index`
    _of_stop: Sequence[Sequence[StepResult]] = field(init=False, repr=False, compare=False)  # [correct][last]
    _of_edit: Sequence[Sequence[StepResult]] = field(init=False, repr=False, compare=False)  # [valid][last]

    def __post_init__(self) -> None:
        by_status = {
            status: tuple(_step_result(self.rules, status, last=last) for last in (False, True))
            for status in ActionStatus
        }
        object.__setattr__(self, "step_results", tuple(chain.from_iterable(by_status.values())))
        # Indexed by bools in `step`, which is three times as fast as computing `result_index` of an enum member.
        stops = by_status[ActionStatus.WRONG_STOP], by_status[ActionStatus.CORRECT_STOP]
        edits = by_status[ActionStatus.INVALID_EDIT], by_status[ActionStatus.VALID_EDIT]
        object.__setattr__(self, "_of_stop", stops)
        object.__setattr__(self, "_of_edit", edits)

    def start(self, task: Task) -> State:
        """The state in which the task's episode starts.

        Args:
            task: The task.
        """
        return new_tuple(State, (task, task.start, 0))

    def step(self, state: State, action: Action) -> Transition:
        """The transition that an action causes. An invalid action is an outcome, never an exception.

        Args:
            state: The state before it.
            action: The action.
        """
        task, scene, steps = state
        steps += 1
        invalid = None
        if type(action) is Stop:
            after = scene
            result = self._of_stop[task.solved_by(scene)][steps >= self.horizon]
        else:
            after, invalid = self.appearance.apply(scene, action, self.rules.placement)
            result = self._of_edit[invalid is None][steps >= self.horizon]
        moved = new_tuple(State, (task, after if result.applies else scene, steps))
        return new_tuple(Transition, (moved, result, invalid))

    def wait(self, state: State) -> Transition:
        """A step without an edit: rewarded and counted like a valid edit, so the horizon can end the episode.

        Args:
            state: The state before it.
        """
        steps = state.steps + 1
        result = self._of_edit[True][steps >= self.horizon]
        return Transition(State(state.task, state.scene, steps), result, None)

    def legal_mask(self, state: State) -> BoolArray:
        """bool (action_count,), a new array: whether each action is valid.

        Args:
            state: The state.
        """
        return self.appearance.legal_mask(state.scene, self.rules.placement)

    def goal_reached(self, state: State) -> bool:
        """Whether STOP would be rewarded +1.

        Args:
            state: The state.
        """
        return state.task.solved_by(state.scene)


def make_dynamics(appearance: Appearance, rules: str = "paper", horizon: int | None = None) -> Dynamics:
    """The MDP under a rule set.

    Args:
        appearance: The kind of scenes and their actions.
        rules: Name of the rule set, "paper" or "release".
        horizon: Actions per episode; None: the rule set's.

    Returns:
        The rules as pure functions.

    Raises:
        ValueError: For an unknown rule set or a horizon that is not a positive whole number.
    """
    rule_set = choose("rules", rules, RULE_SETS)
    if horizon is None:
        horizon = rule_set.horizon
    return Dynamics(appearance, rule_set, checked_count("horizon", horizon, of=" of actions or None"))
