"""What episodes of a language model come to."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from lilgym_mp.rules import State
from lilgym_mp.solver import Solver

if TYPE_CHECKING:
    from lilgym_mp.llm.player import Episode

SURENESS = 1.959964  # standard deviations of a two-sided 95 % interval


def progression(solver: Solver, start: State, last: State, *, success: bool) -> float:
    """The share of the way to the goal, 0 to 1: BALROG's progression, by the expert's distance.

    The way is what a shortest solution takes from the start, its STOP included; what it takes from the last scene is
    what is left. 1 only of success; 0 where the expert finds no solution from the start or from the last scene.
    """
    if success:
        return 1.0
    whole, left = _actions_to_go(solver, start), _actions_to_go(solver, last)
    return 0.0 if whole is None or left is None else max(0.0, 1 - left / whole)


def _actions_to_go(solver: Solver, state: State) -> int | None:
    solution = solver.solve_from(state._replace(steps=0))
    return solution.steps if solution.solved else None


def wilson_interval(successes: int, episodes: int) -> tuple[float, float]:
    """Bounds of the 95 % confidence interval of a share (Wilson 1927). Raises ValueError of no episodes."""
    if episodes < 1 or not 0 <= successes <= episodes:
        raise ValueError(f"{successes} successes in {episodes} episodes have no share")
    share, squared = successes / episodes, SURENESS**2
    centre = (share + squared / (2 * episodes)) / (1 + squared / episodes)
    spread = math.sqrt(share * (1 - share) / episodes + squared / (4 * episodes**2)) * SURENESS
    half = spread / (1 + squared / episodes)
    return max(0.0, centre - half), min(1.0, centre + half)


@dataclass(frozen=True)
class Summary:
    """An agent on a split; tokens are None where the agent does not tell them."""

    episodes: int
    successes: int
    success: float
    success_low: float  # 95 % confidence interval
    success_high: float
    progression: float  # mean
    progression_deviation: float  # standard error of the mean
    mean_reward: float
    mean_actions: float
    answers: int
    misunderstood: int  # answers that did not decide for an action
    seconds: float  # that the agent took in all
    prompt_tokens: int | None
    completion_tokens: int | None
    outcomes: dict[str, int]

    def to_json(self) -> dict[str, Any]:
        return asdict(self)


def summarise(episodes: Sequence[Episode]) -> Summary:
    """Raises ValueError when there are no episodes."""
    count, successes = len(episodes), sum(episode.is_success for episode in episodes)
    low, high = wilson_interval(successes, count)
    ways = [episode.progression for episode in episodes]
    mean = sum(ways) / count
    variance = sum((way - mean) ** 2 for way in ways) / (count - 1) if count > 1 else 0.0
    turns = [turn for episode in episodes for turn in episode.turns]
    outcomes = [episode.outcome for episode in episodes]
    return Summary(
        episodes=count,
        successes=successes,
        success=successes / count,
        success_low=low,
        success_high=high,
        progression=mean,
        progression_deviation=math.sqrt(variance / count),
        mean_reward=sum(episode.reward for episode in episodes) / count,
        mean_actions=sum(len(episode.actions) for episode in episodes) / count,
        answers=len(turns),
        misunderstood=sum(not turn.understood for turn in turns),
        seconds=sum(turn.seconds for turn in turns),
        prompt_tokens=_total([turn.prompt_tokens for turn in turns]),
        completion_tokens=_total([turn.completion_tokens for turn in turns]),
        outcomes={outcome: outcomes.count(outcome) for outcome in sorted(set(outcomes))},
    )


def _total(numbers: Sequence[int | None]) -> int | None:
    """The sum; None where a number is not known."""
    known = [number for number in numbers if number is not None]
    return sum(known) if known and len(known) == len(numbers) else None
