"""Required and desired speeds of this package, compared with the measurements."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from lilgym_mp.benchmark.catalogue import worker_name
from lilgym_mp.benchmark.measuring import Bench, Measurement
from lilgym_mp.evaluation.settings import CONFIGURATIONS


class Goal(NamedTuple):
    """A required speed and, if there is one, a better one to aim for."""

    what: str
    unit: str
    must: float
    aim: float | None
    appearances: Sequence[str]
    value: Callable[[Bench, str], float | None]  # the measurement for a configuration; None if not measured

    @property
    def less_is_better(self) -> bool:
        return self.unit == "us"


class GoalResult(NamedTuple):
    """The measurement for a goal: the worst of its configurations."""

    goal: Goal
    value: float

    @property
    def verdict(self) -> str:
        """Whether the aim, or at least the requirement, was met."""
        goal = self.goal
        for bound, name in ((goal.aim, "aim met"), (goal.must, "must met")):
            if bound is not None and (self.value <= bound if goal.less_is_better else self.value >= bound):
                return name
        return "missed"


def _rate(name: str, num_envs: int) -> Callable[[Bench, str], float | None]:
    return _of(name, num_envs, lambda measurement: measurement.median)


def _microseconds(name: str, num_envs: int) -> Callable[[Bench, str], float | None]:
    return _of(name, num_envs, lambda measurement: 1e6 / measurement.median)


def _of(name: str, num_envs: int, value: Callable[[Measurement], float]) -> Callable[[Bench, str], float | None]:
    def find(bench: Bench, configuration: str) -> float | None:
        measurement = bench.find(configuration, name, num_envs)
        return None if measurement is None else value(measurement)

    return find


def _ratio(name: str, other: str, num_envs: int) -> Callable[[Bench, str], float | None]:
    def find(bench: Bench, configuration: str) -> float | None:
        ours, theirs = (bench.find(configuration, each, num_envs) for each in (name, other))
        return None if ours is None or theirs is None else ours.ratio_to(theirs)

    return find


_TOWER, _SCATTER, _BOTH = ("tower",), ("scatter",), ("tower", "scatter")
_ONE, _TWO = worker_name(1), worker_name(2)

GOALS = (
    Goal("single, gym.make, Tower", "steps/s", 190e3, 250e3, _TOWER, _rate("single", 1)),
    Goal("single, gym.make, Scatter", "steps/s", 100e3, 150e3, _SCATTER, _rate("single", 1)),
    Goal("batched 64, copied, Tower", "steps/s", 450e3, 700e3, _TOWER, _rate("batched", 64)),
    Goal("batched 64, copied, Scatter", "steps/s", 230e3, 350e3, _SCATTER, _rate("batched", 64)),
    Goal("batched 64, copied, with masks, Scatter", "steps/s", 150e3, 300e3, _SCATTER, _rate("batched, masks", 64)),
    Goal("batched 256, not copied, Tower", "steps/s", 1e6, 2.5e6, _TOWER, _rate("batched, no copy", 256)),
    Goal("SB3, 64, batched against subproc", "times", 25, 50, _BOTH, _ratio("SB3, batched", "SB3, subproc", 64)),
    Goal("256, two processes against one, Tower", "times", 1.4, 1.8, _TOWER, _ratio(_TWO, _ONE, 256)),
    Goal("256, two processes against one, Scatter", "times", 1.4, 1.8, _SCATTER, _ratio(_TWO, _ONE, 256)),
    Goal("exact masks, Scatter, batched 64", "us", 20, 5, _SCATTER, _microseconds("mask, in a batch", 64)),
    Goal("program truth, in play", "us", 5, 1, _BOTH, _microseconds("program truth", 1)),
    Goal("reset", "us", 10, 5, _BOTH, _microseconds("reset", 1)),
    Goal("PettingZoo parallel, Tower", "steps/s", 110e3, 150e3, _TOWER, _rate("PettingZoo, parallel", 1)),
    Goal("PettingZoo AEC, Tower", "steps/s", 40e3, None, _TOWER, _rate("PettingZoo, AEC (env)", 1)),
)


def goal_results(bench: Bench) -> list[GoalResult]:
    """The result of each goal for which something was measured."""
    found: list[GoalResult] = []
    for goal in GOALS:
        configurations = [name for name in bench.configurations if CONFIGURATIONS[name][0] in goal.appearances]
        values = [value for name in configurations if (value := goal.value(bench, name)) is not None]
        if values:
            found.append(GoalResult(goal, max(values) if goal.less_is_better else min(values)))
    return found
