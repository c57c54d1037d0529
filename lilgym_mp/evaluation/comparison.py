"""Several policies on the same tasks."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from lilgym_mp.corpus import load_tasks
from lilgym_mp.evaluation.metrics import Summary, summarise
from lilgym_mp.evaluation.policies import Policy, random_legal, random_unmasked
from lilgym_mp.evaluation.runs import BATCH_SIZE, Episode, evaluate
from lilgym_mp.evaluation.settings import Settings

TRAINING_SPLIT = "train"


@dataclass(frozen=True)
class Contestant:
    """A policy with its name in tables and files."""

    name: str
    policy: Policy
    details: Mapping[str, Any] = field(default_factory=dict[str, Any])  # what else is needed to get it again


@dataclass(frozen=True)
class Result:
    """What one policy did."""

    name: str
    summary: Summary
    episodes: Sequence[Episode]
    details: Mapping[str, Any] = field(default_factory=dict[str, Any])  # what else is needed to get it again


BASELINES = (Contestant("random legal", random_legal), Contestant("random unmasked", random_unmasked))


@dataclass(frozen=True)
class Trial:
    """What every contestant goes through."""

    settings: Settings
    split: str
    seed: int = 0
    passes: int = 1
    batch_size: int = BATCH_SIZE

    def results(self, contestants: Collection[Contestant], training_statements: Collection[str]) -> Iterator[Result]:
        """What came of each contestant; all draw from generators of the same seed."""
        for contestant in contestants:
            episodes = evaluate(
                contestant.policy,
                self.settings,
                self.split,
                seed=self.seed,
                passes=self.passes,
                batch_size=self.batch_size,
            )
            yield Result(contestant.name, summarise(episodes, training_statements), episodes, contestant.details)

    def __str__(self) -> str:
        settings = self.settings
        visits = "each task once" if self.passes == 1 else f"each task {self.passes} times"
        return (
            f"{settings.configuration}, corpus {settings.corpus}, split {self.split}, rules {settings.rules}:"
            f" {visits}, seed {self.seed}"
        )

    def to_json(self) -> dict[str, Any]:
        return {
            "settings": self.settings.to_json(),
            "split": self.split,
            "seed": self.seed,
            "passes": self.passes,
            "batch_size": self.batch_size,
        }


def training_statements(settings: Settings) -> set[str]:
    """The statements of the settings' training split."""
    tasks = load_tasks(settings.corpus, settings.appearance, settings.start, TRAINING_SPLIT)
    return {task.statement for task in tasks}
