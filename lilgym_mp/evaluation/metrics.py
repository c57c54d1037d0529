"""Accuracy and other summary statistics of episodes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

from lilgym_mp.corpus.forms import statement_form
from lilgym_mp.evaluation.runs import Episode
from lilgym_mp.rules import Outcome

FINAL_OUTCOMES = tuple(str(outcome) for outcome in Outcome if outcome is not Outcome.CONTINUES)


@dataclass(frozen=True, slots=True)
class SuccessCount:
    """Number of episodes, and of successes among them."""

    episodes: int
    successes: int

    @property
    def accuracy(self) -> float | None:
        """Task-completion accuracy, None if there are no episodes."""
        return self.successes / self.episodes if self.episodes else None

    @classmethod
    def of(cls, episodes: Collection[Episode]) -> SuccessCount:
        return cls(len(episodes), sum(episode.is_success for episode in episodes))


@dataclass(frozen=True, slots=True)
class Summary:
    """Statistics of a policy on a split."""

    all: SuccessCount
    seen: SuccessCount  # statements that occur verbatim in the training tasks
    unseen: SuccessCount
    seen_forms: SuccessCount  # statements that share a form with a training statement
    unseen_forms: SuccessCount
    mean_reward: float
    mean_length: float  # mean number of actions
    outcomes: dict[str, float]  # fraction of all episodes by final outcome

    @property
    def accuracy(self) -> float:
        return self.all.successes / self.all.episodes


def summarise(episodes: Sequence[Episode], training_statements: Collection[str]) -> Summary:
    """Without training statements, no episode counts as seen or unseen. Raises ValueError if there are no episodes."""
    if not episodes:
        raise ValueError("cannot summarise zero episodes")
    forms = set(map(statement_form, training_statements))
    outcomes = Counter(episode.outcome for episode in episodes)

    def count(is_counted: Callable[[Episode], bool]) -> SuccessCount:
        return SuccessCount.of([episode for episode in episodes if is_counted(episode)])

    return Summary(
        all=SuccessCount.of(episodes),
        seen=count(lambda episode: episode.statement in training_statements),
        unseen=count(lambda episode: bool(forms) and episode.statement not in training_statements),
        seen_forms=count(lambda episode: statement_form(episode.statement) in forms),
        unseen_forms=count(lambda episode: bool(forms) and statement_form(episode.statement) not in forms),
        mean_reward=sum(episode.reward for episode in episodes) / len(episodes),
        mean_length=sum(len(episode.actions) for episode in episodes) / len(episodes),
        outcomes={outcome: outcomes[outcome] / len(episodes) for outcome in FINAL_OUTCOMES},
    )
