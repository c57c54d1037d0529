"""Episodes of policies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

from lilgym_mp.envs.rules import Dynamics, Outcome
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import Action, Stop, describe
from lilgym_mp.scene.arrays import AnyDict

if TYPE_CHECKING:
    from lilgym_mp.evaluation.decisions import Decision

FINAL_OUTCOMES = tuple(str(outcome) for outcome in Outcome if outcome is not Outcome.CONTINUES)


@dataclass(frozen=True, kw_only=True)
class Episode:
    """An episode on one task. Recordings have facts from the corpus and the expert, which others lack.

    Attributes:
        task: The task's id.
        statement: The task's statement.
        program: The task's program.
        target: The truth value to reach.
        statement_seen: Whether the statement occurs verbatim in the training tasks.
        form_seen: Whether its form does: ignoring colours, shapes, sizes and numbers.
        tags: Annotations of the task in the corpus.
        outcome: How the episode ended, as in `Outcome`.
        invalid_reason: Why the last action was invalid, if it was.
        actions: The actions, in order.
        rewards: One per action.
        start: The start scene.
        optimal_actions: Length of the expert's solution from the start, including STOP.
        actions_left: Length of the expert's solution from the scene of a wrong STOP.
        stop_probabilities: The agent's estimate before each action.
        decisions: The agent's decision before each action; None if not recorded.
    """

    task: str  # id
    statement: str
    program: str
    target: bool
    statement_seen: bool = False  # whether it occurs verbatim in the training tasks
    form_seen: bool = False  # whether its form does: ignoring colours, shapes, sizes and numbers
    tags: tuple[str, ...] = ()  # annotations of the task in the corpus
    outcome: str
    invalid_reason: str | None = None
    actions: tuple[Action, ...]
    rewards: tuple[float, ...]  # one per action
    start: Scene
    optimal_actions: int | None = None  # length of the expert's solution from the start, including STOP
    actions_left: int | None = None  # length of the expert's solution from the scene of a wrong STOP
    stop_probabilities: tuple[float, ...] | None = None  # the agent's estimate before each action
    decisions: tuple[Decision, ...] | None = None  # the agent's decision before each action; None if not recorded

    @classmethod
    def of(cls, task: Task, actions: Sequence[Action], outcome: str, dynamics: Dynamics, **others: Any) -> Self:
        """The episode of these actions on the task.

        Args:
            task: The task.
            actions: The actions, in order.
            outcome: That of the last action, or of a language model's last answer if that names no action.
            dynamics: The rules, which give the rewards.
            others: Further fields.
        """
        signals = dynamics.rules.signals
        has_ended = outcome in FINAL_OUTCOMES
        last = Outcome(outcome) if has_ended else Outcome.INVALID_ACTION
        before = (signals[Outcome.CONTINUES].reward,) * (len(actions) - has_ended)
        return cls(
            task=task.id,
            statement=task.statement,
            program=task.program,
            target=task.target,
            outcome=str(outcome),
            actions=tuple(actions),
            rewards=(*before, signals[last].reward),
            start=task.start,
            **others,
        )

    @property
    def is_success(self) -> bool:
        """Whether the agent stopped in a goal scene."""
        return self.outcome == "success"

    @property
    def reward(self) -> float:
        """The total."""
        return round(sum(self.rewards), 6)

    @property
    def edits(self) -> int | None:
        """Number of edits in the expert's solution, None if not asked or unsolved."""
        return None if self.optimal_actions is None else self.optimal_actions - 1

    def to_json(self) -> AnyDict:
        """A line of a file of episodes; actions are texts."""
        decisions = None if self.decisions is None else [decision.to_json() for decision in self.decisions]
        return {
            **vars(self),
            "actions": [describe(action) for action in self.actions],
            "start": self.start.to_json(),
            "decisions": decisions,
        }


def scenes(dynamics: Dynamics, start: Scene, actions: Sequence[Action]) -> list[Scene]:
    """The start scene and the scene after each action; STOP and invalid actions do not change it."""
    visited = [start]
    for action in actions:
        if isinstance(action, Stop):
            visited.append(visited[-1])
        else:
            visited.append(dynamics.appearance.apply(visited[-1], action, dynamics.rules.placement).scene)
    if len(actions) == dynamics.horizon and not dynamics.rules.applies_edit_at_horizon:
        visited[-1] = visited[-2]
    return visited


def outcome_words(outcome: str) -> str:
    """An outcome as people read it, such as "wrong STOP"."""
    return outcome.replace("_", " ").replace("stop", "STOP")
