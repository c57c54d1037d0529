"""Episodes of text agents, their progression and summary statistics."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from lilgym_mp.contrib.llm.agents import Answer, Message
from lilgym_mp.contrib.report.aggregation import add_up, resampled_means
from lilgym_mp.envs.resampling import percentile_interval
from lilgym_mp.envs.rules import State
from lilgym_mp.solver import Solver
from lilgym_mp.wrappers.replies import CUT, FILTERED, NOT_UNDERSTOOD, REFUSED

PROBLEMS = (CUT, FILTERED, REFUSED, NOT_UNDERSTOOD)  # of answers; an episode that ends with one has it as its outcome
Z_95 = 1.959964  # normal quantile of a two-sided 95 % interval


@dataclass(frozen=True)
class Turn:
    """One answer of the agent."""

    answer: str
    understood: bool
    action: str | None  # the action taken; None if the answer named none
    seconds: float
    prompt_tokens: int | None
    completion_tokens: int | None
    reasoning: str | None = None  # what the server sent apart from the answer
    retries: int = 0  # failed calls before the answer
    problem: str | None = None  # why no action was taken: one of PROBLEMS

    @property
    def said(self) -> Answer:
        """The agent's answer, with the problem only if the server named it."""
        problem = None if self.problem == NOT_UNDERSTOOD else self.problem
        return Answer(self.answer, self.prompt_tokens, self.completion_tokens, self.reasoning, self.retries, problem)


@dataclass(frozen=True)
class Transcript:
    """An episode with its complete conversation."""

    task: str
    statement: str
    target: bool
    outcome: str
    reward: float  # sum over the episode
    progression: float
    actions: list[str]
    turns: list[Turn]
    messages: list[Message]

    @property
    def is_success(self) -> bool:
        """Whether the episode ended by stopping in a goal scene."""
        return self.outcome == "success"

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Transcript:
        """Inverse of `dataclasses.asdict`. Raises KeyError or TypeError for other data."""
        return cls(**{**data, "turns": [Turn(**turn) for turn in data["turns"]]})


@dataclass(frozen=True)
class Failure:
    """An episode that ended because the agent failed."""

    task: str
    error: str
    messages: list[Message]


def progression(solver: Solver, start: State, last: State, *, success: bool) -> float:
    """Progress towards the goal, 0 to 1, as in BALROG: 1 - (distance from `last`) / (distance from `start`).

    The distance is the length of the expert's shortest solution, STOP included. 1 only on success; 0 if the expert
    finds no solution from either state.
    """
    if success:
        return 1.0
    total = solver.distance(start)
    left = solver.distance(last)
    return 0.0 if total is None or left is None else max(0.0, 1 - left / total)


def wilson_interval(successes: float, episodes: int) -> tuple[float, float]:
    """The 95 % confidence interval of a success rate (Wilson 1927). Raises ValueError without episodes."""
    if episodes < 1 or not 0 <= successes <= episodes:
        raise ValueError(f"no success rate from {successes} successes in {episodes} episodes")
    weight = episodes + Z_95**2
    centre = (successes + Z_95**2 / 2) / weight
    half = Z_95 / weight * math.sqrt(successes * (1 - successes / episodes) + Z_95**2 / 4)
    return max(0.0, centre - half), min(1.0, centre + half)


def success_interval(rates: Sequence[tuple[str, float]]) -> tuple[float, float]:
    """The 95 % interval of the mean of success rates, each with its statement.

    Statements, with all of their rates, are resampled, as in `lilgym-mp report`. If all rates are 0, or all 1, there is
    nothing to resample: Wilson's interval, of one trial for each statement. Raises ValueError without rates.
    """
    count = len({statement for statement, _ in rates})
    if {rate for _, rate in rates} <= {0.0} or {rate for _, rate in rates} <= {1.0}:
        return wilson_interval(count if rates and rates[0][1] else 0, count)
    return percentile_interval(resampled_means(add_up([rates])))


def summarise_transcripts(
    episodes: Sequence[Transcript], failed_episodes: int = 0, prices: tuple[float, float] | None = None
) -> dict[str, Any]:
    """The results of an agent, by name as in `summary.json`.

    Args:
        episodes: The episodes that were played to an end.
        failed_episodes: How many failed because the agent did; counted apart.
        prices: The prices of a million tokens read and of a million written.

    Returns:
        Results by name; token counts and the cost are None if unknown.

    Raises:
        ValueError: Without episodes.
    """
    count = len(episodes)
    successes = sum(episode.is_success for episode in episodes)
    if not count:
        raise ValueError("cannot summarise zero episodes")
    low, high = success_interval([(episode.statement, float(episode.is_success)) for episode in episodes])
    progressions = [episode.progression for episode in episodes]
    deviation = statistics.stdev(progressions) if count > 1 else 0.0
    turns = [turn for episode in episodes for turn in episode.turns]
    outcomes = [episode.outcome for episode in episodes]
    return {
        "episodes": count,
        "successes": successes,
        "success": successes / count,
        "statements": len({episode.statement for episode in episodes}),
        "success_low": low,  # 95 % confidence interval, over statements
        "success_high": high,
        "progression": statistics.fmean(progressions),
        "progression_deviation": deviation / math.sqrt(count),  # standard error of the mean
        "mean_reward": statistics.fmean(episode.reward for episode in episodes),
        "mean_actions": statistics.fmean(len(episode.actions) for episode in episodes),
        "outcomes": {outcome: outcomes.count(outcome) for outcome in sorted(set(outcomes))},
        "failed_episodes": failed_episodes,
        **calls(turns, failed_episodes, prices),
    }


def calls(turns: Sequence[Turn], failed_episodes: int, prices: tuple[float, float] | None) -> dict[str, Any]:
    """What an agent's answers were and cost, by name as in `summary.json`."""
    read, written = (_total([getattr(turn, name) for turn in turns]) for name in ("prompt_tokens", "completion_tokens"))
    cost = None
    if prices is not None and read is not None and written is not None:
        cost = (read * prices[0] + written * prices[1]) / 1e6
    return {
        "answers": len(turns),
        "misunderstood": sum(not turn.understood for turn in turns),  # answers that named no action, of all problems
        "problems": {name: sum(turn.problem == name for turn in turns) for name in PROBLEMS},  # answers by problem
        "call_seconds": sum(turn.seconds for turn in turns),  # added up, also of calls at the same time
        "prompt_tokens": read,
        "completion_tokens": written,
        "failed_calls": sum(turn.retries for turn in turns) + failed_episodes,  # before an answer, or a failure
        "cost": cost,  # of all tokens, in the currency of the prices
    }


def _total(numbers: Sequence[int | None]) -> int | None:
    """The sum; None if any number is unknown."""
    known = [number for number in numbers if number is not None]
    return sum(known) if 0 < len(known) == len(numbers) else None
