"""Episodes in numbers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from lilgym_mp.evaluation.runs import Episode
from lilgym_mp.rules import Outcome

ENDS = tuple(str(outcome) for outcome in Outcome if outcome is not Outcome.CONTINUES)


@dataclass(frozen=True, slots=True)
class Share:
    """How many of some episodes were a success."""

    episodes: int
    successes: int

    @property
    def accuracy(self) -> float | None:
        """Task-completion accuracy, None of no episodes."""
        return self.successes / self.episodes if self.episodes else None

    @classmethod
    def of(cls, episodes: Collection[Episode]) -> Share:
        return cls(len(episodes), sum(episode.is_success for episode in episodes))


@dataclass(frozen=True, slots=True)
class Summary:
    """A policy on a split."""

    all: Share
    seen: Share  # of statements that stand verbatim in training
    unseen: Share
    mean_reward: float
    mean_length: float  # actions
    outcomes: dict[str, float]  # shares of all episodes, by way to end

    @property
    def accuracy(self) -> float:
        return self.all.successes / self.all.episodes


def summarise(episodes: Sequence[Episode], training_statements: Collection[str]) -> Summary:
    """Raises ValueError when there are no episodes."""
    if not episodes:
        raise ValueError("there are no episodes to summarise")
    count = len(episodes)
    ends = Counter(episode.outcome for episode in episodes)
    return Summary(
        all=Share.of(episodes),
        seen=Share.of([episode for episode in episodes if episode.statement in training_statements]),
        unseen=Share.of([episode for episode in episodes if episode.statement not in training_statements]),
        mean_reward=sum(episode.reward for episode in episodes) / count,
        mean_length=sum(len(episode.actions) for episode in episodes) / count,
        outcomes={end: ends[end] / count for end in ENDS},
    )
