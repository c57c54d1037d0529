"""Several policies on the same tasks."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from lilgym_mp.corpus import contexts, load_tasks
from lilgym_mp.corpus.forms import statement_form
from lilgym_mp.evaluation.metrics import Share, Summary, summarise
from lilgym_mp.evaluation.named_policies import NamedPolicy
from lilgym_mp.evaluation.runs import BATCH_SIZE, Episode, evaluate
from lilgym_mp.evaluation.settings import Settings

TRAINING_SPLIT = "train"


@dataclass(frozen=True)
class EvaluationPlan:
    """How every policy is evaluated in one configuration."""

    settings: Settings
    split: str
    seed: int = 0
    passes: int = 1
    batch_size: int = BATCH_SIZE
    record_decisions: bool = False

    def __str__(self) -> str:
        settings = self.settings
        visits = "each task once" if self.passes == 1 else f"each task {self.passes} times"
        return (
            f"{settings.configuration}, corpus {settings.corpus}, split {self.split}, rules {settings.rules}:"
            f" {visits}, seed {self.seed}"
        )

    @property
    def episodes(self) -> int:
        """How many each policy plays."""
        return len(self.settings.make(self.split).evaluation_tasks()) * self.passes

    def to_json(self) -> dict[str, Any]:
        return {
            "settings": self.settings.to_json(),
            "split": self.split,
            "seed": self.seed,
            "passes": self.passes,
            "batch_size": self.batch_size,
        }


@dataclass(frozen=True)
class Result:
    """What one policy did under one plan."""

    named: NamedPolicy
    plan: EvaluationPlan
    summary: Summary
    seen_forms: Share  # episodes whose statement has a form that training statements have
    unseen_forms: Share
    episodes: Sequence[Episode]
    cpu_seconds: float  # of playing
    mask: bool = False  # whether illegal actions were kept from it

    @property
    def name(self) -> str:
        return self.named.name

    def to_json(self) -> dict[str, Any]:
        """The result as one row of a file; accuracies from 0 to 1, None of no episodes."""
        summary, plan, settings = self.summary, self.plan, self.plan.settings
        return {
            "agent": self.name,
            "configuration": settings.configuration,
            "corpus": settings.corpus,
            "split": plan.split,
            "rules": settings.rules,
            "horizon": settings.horizon,
            "supervision": self.named.supervision,
            "start_scenes": len(self.episodes) // plan.passes,
            "contexts": len({(episode.statement, episode.target) for episode in self.episodes}),
            "passes": plan.passes,
            "seed": plan.seed,
            "accuracy": summary.accuracy,
            "accuracy_seen": summary.seen.accuracy,
            "accuracy_unseen": summary.unseen.accuracy,
            "accuracy_seen_forms": self.seen_forms.accuracy,
            "accuracy_unseen_forms": self.unseen_forms.accuracy,
            "episodes_seen": summary.seen.episodes,
            "episodes_unseen": summary.unseen.episodes,
            "mean_reward": summary.mean_reward,
            "mean_length": summary.mean_length,
            "outcomes": summary.outcomes,
            "cpu_seconds": round(self.cpu_seconds, 3),
            "mask": self.mask,
            **dict(self.named.details),
        }

    def episodes_json(self) -> list[dict[str, Any]]:
        return [
            {
                name: list(value) if isinstance(value, tuple) else value
                for name, value in episode._asdict().items()
                if name != "decisions"  # these are for recordings
            }
            for episode in self.episodes
        ]


def play(
    named: NamedPolicy,
    plan: EvaluationPlan,
    training_statements: Collection[str],
    on_episode: Callable[[Episode], object] = lambda episode: None,
) -> Result:
    """Every task of the plan, played by the policy.

    `training_statements`: what counts as seen. `on_episode` hears of each episode as it ends.
    Raises ValueError for a configuration that it does not play.
    """
    policy = named.policy(plan.settings)
    began = time.process_time()
    episodes = evaluate(
        policy,
        plan.settings,
        plan.split,
        seed=plan.seed,
        passes=plan.passes,
        batch_size=plan.batch_size,
        record_decisions=plan.record_decisions,
        on_episode=on_episode,
    )
    mask = getattr(policy, "needs_masks", True) if named.mask is None else named.mask
    return result_of(named, plan, episodes, training_statements, cpu_seconds=time.process_time() - began, mask=mask)


def result_of(
    named: NamedPolicy,
    plan: EvaluationPlan,
    episodes: Sequence[Episode],
    training_statements: Collection[str],
    *,
    cpu_seconds: float,
    mask: bool,
) -> Result:
    """The result that these episodes come to."""
    forms = set(map(statement_form, training_statements))
    seen_forms = [statement_form(episode.statement) in forms for episode in episodes]
    return Result(
        named,
        plan,
        summarise(episodes, training_statements),
        Share.of([episode for episode, seen in zip(episodes, seen_forms, strict=True) if seen]),
        Share.of([episode for episode, seen in zip(episodes, seen_forms, strict=True) if not seen]),
        episodes,
        cpu_seconds,
        mask,
    )


def play_all(
    named_policies: Collection[NamedPolicy],
    plan: EvaluationPlan,
    training_statements: Collection[str],
    on_episode: Callable[[Episode], object] = lambda episode: None,
) -> Iterator[Result]:
    """The result of each policy that plays the configuration; all draw from generators of the same seed."""
    for named in playing(named_policies, plan):
        yield play(named, plan, training_statements, on_episode)


def playing(named_policies: Collection[NamedPolicy], plan: EvaluationPlan) -> list[NamedPolicy]:
    """The policies that play the plan's configuration."""
    return [named for named in named_policies if plan.settings.configuration in named.configurations]


def training_statements(settings: Settings) -> set[str]:
    """The statements of the settings' training split."""
    tasks = load_tasks(settings.corpus, settings.appearance, settings.start, TRAINING_SPLIT)
    return {task.statement for task in tasks}


def task_counts(plan: EvaluationPlan) -> dict[str, Any]:
    """The tasks of a trial: where they are from, start scenes and contexts."""
    tasks = plan.settings.make(plan.split).tasks
    return {**asdict(tasks.provenance), "start_scenes": len(tasks), "contexts": contexts(tasks)}
