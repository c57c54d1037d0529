"""Results of policies on the tasks of a split, with statistics."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import asdict, dataclass
from decimal import ROUND_HALF_UP, Decimal

from lilgym_mp.corpus import CorpusError, NoTasksError, contexts, load_tasks
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.evaluation.episodes import FINAL_OUTCOMES, Episode
from lilgym_mp.evaluation.policies import NamedPolicy, as_policy
from lilgym_mp.evaluation.runs import BATCH_SIZE, evaluate
from lilgym_mp.scene.arrays import AnyDict

TRAINING_SPLIT = "train"


def rounded(value: float, places: int) -> str:
    """The value as it is printed, with halves rounded up: 84.05 is 84.1, not 84.0 as in binary."""
    return str(Decimal(repr(float(value))).quantize(Decimal(1).scaleb(-places), ROUND_HALF_UP))


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
        """Counts episodes and successes."""
        return cls(len(episodes), sum(episode.is_success for episode in episodes))


@dataclass(frozen=True, slots=True)
class Summary:
    """Statistics of a policy on a split.

    Attributes:
        seen: Episodes and successes on statements that occur verbatim in the tasks that the policy was trained on.
        unseen: The same for all other statements.
        mean_reward: Mean total reward of an episode.
        mean_length: Mean number of actions.
        outcomes: Share of all episodes by final outcome, 0 .. 1.
    """

    seen: SuccessCount  # statements that occur verbatim in the tasks that the policy was trained on
    unseen: SuccessCount
    mean_reward: float
    mean_length: float  # mean number of actions
    outcomes: dict[str, float]  # fraction of all episodes by final outcome

    @property
    def accuracy(self) -> float:
        """The share of episodes that ended in success."""
        return self.outcomes["success"]


def summarise(episodes: Sequence[Episode], training_statements: Collection[str]) -> Summary:
    """The statistics of a policy's episodes.

    Args:
        episodes: The episodes, at least one.
        training_statements: Statements that the policy was trained on; if empty, no episode counts as seen or unseen.

    Returns:
        Success counts for seen and unseen statements, means, and shares of the outcomes.

    Raises:
        ValueError: If there are no episodes.
    """
    if not episodes:
        raise ValueError("cannot summarise zero episodes")
    outcomes = Counter(episode.outcome for episode in episodes)
    seen = [episode for episode in episodes if episode.statement in training_statements]
    unseen = [episode for episode in episodes if training_statements and episode.statement not in training_statements]
    return Summary(
        seen=SuccessCount.of(seen),
        unseen=SuccessCount.of(unseen),
        mean_reward=sum(episode.reward for episode in episodes) / len(episodes),
        mean_length=sum(len(episode.actions) for episode in episodes) / len(episodes),
        outcomes={outcome: outcomes[outcome] / len(episodes) for outcome in FINAL_OUTCOMES},
    )


@dataclass(frozen=True)
class EvaluationPlan:
    """The tasks and settings with which all policies are evaluated in one configuration: arguments of `evaluate`."""

    settings: EnvConfig
    split: str
    seed: int = 0
    passes: int = 1
    batch_size: int = BATCH_SIZE
    record_decisions: bool = False
    task_ids: Sequence[str] | None = None  # None: every task of the split

    def __str__(self) -> str:
        settings = self.settings
        repeats = "each task once" if self.passes == 1 else f"each task {self.passes} times"
        return (
            f"{settings.configuration}, corpus {settings.corpus}, split {self.split}, rules {settings.rules}:"
            f" {repeats}, seed {self.seed}"
        )

    @property
    def episodes(self) -> int:
        """Number of episodes per policy."""
        return len(self.settings.tasks(self.split)) * self.passes

    def to_json(self) -> AnyDict:
        """The plan with the provenance of the tasks, and the numbers of start scenes and contexts."""
        tasks = self.settings.tasks(self.split)
        return {
            "settings": self.settings.to_json(),
            "split": self.split,
            "seed": self.seed,
            "passes": self.passes,
            "batch_size": self.batch_size,
            "tasks": {**asdict(tasks.provenance), "start_scenes": len(tasks), "contexts": contexts(tasks)},
        }


@dataclass(frozen=True)
class Result:
    """Result of one policy under one plan."""

    named: NamedPolicy
    plan: EvaluationPlan
    summary: Summary
    episodes: Sequence[Episode]
    cpu_seconds: float  # CPU time of the whole evaluation
    mask: bool = False  # whether illegal actions were masked

    @property
    def name(self) -> str:
        """Name of the policy in tables."""
        return self.named.name

    def to_json(self) -> AnyDict:
        """The result as one row of a file; accuracies from 0 to 1, None if there are no episodes."""
        summary = self.summary
        plan = self.plan
        settings = self.plan.settings
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
            "episodes_seen": summary.seen.episodes,
            "episodes_unseen": summary.unseen.episodes,
            "mean_reward": summary.mean_reward,
            "mean_length": summary.mean_length,
            "outcomes": summary.outcomes,
            "cpu_seconds": round(self.cpu_seconds, 3),
            "mask": self.mask,
            **dict(self.named.details),
        }


def play(
    named: NamedPolicy,
    plan: EvaluationPlan,
    training_statements: Collection[str],
    on_episode: Callable[[Episode], object] = lambda episode: None,
) -> Result:
    """Evaluates a policy on all tasks of the plan.

    `training_statements`: statements that count as seen. `on_episode` is called with each episode as it ends.
    Raises ValueError for a configuration that the policy cannot play.
    """
    policy = as_policy(named.policy(plan.settings))
    began = time.process_time()
    episodes = evaluate(policy, **vars(plan), on_episode=on_episode)
    mask = policy.needs_masks if named.mask is None else named.mask
    summary = summarise(episodes, training_statements)
    seconds = time.process_time() - began
    return Result(named, plan, summary, episodes, seconds, mask)


def playable(named_policies: Collection[NamedPolicy], plan: EvaluationPlan) -> list[NamedPolicy]:
    """The policies that can play the plan's configuration."""
    return [named for named in named_policies if plan.settings.configuration in named.configurations]


def training_statements(settings: EnvConfig, named: NamedPolicy | None = None) -> set[str]:
    """The statements of the training split of the corpus that the policy was trained on; else of the settings' corpus.

    Empty if that corpus has no such split, or is not here.
    """
    recipe = {} if named is None else named.details.get("recipe", {})
    trained_on = recipe.get("corpus", settings.corpus)
    try:
        tasks = load_tasks(trained_on, settings.appearance, settings.start, TRAINING_SPLIT)
    except NoTasksError:
        return set()
    except CorpusError:
        if trained_on == settings.corpus:
            raise
        return set()
    return {task.statement for task in tasks}
