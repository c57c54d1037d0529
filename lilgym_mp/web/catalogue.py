"""Tasks of the served corpus by configuration and split."""

from __future__ import annotations

from functools import cache
from itertools import product

from lilgym_mp.corpus import NoTasksError, TaskSet, load_all_tasks, load_tasks
from lilgym_mp.corpus.records import SPLITS
from lilgym_mp.evaluation.settings import CONFIGURATIONS, Settings
from lilgym_mp.rules import Dynamics
from lilgym_mp.solver import Solver


class Catalogue:
    """Loads task sets and solvers of the served corpus on first use."""

    def __init__(self, corpus: str) -> None:
        """Raises CorpusError if there is no such corpus or it has no tasks."""
        self.corpus = corpus
        next(load_all_tasks(corpus))
        self._dynamics = cache(lambda configuration, rules: Settings(configuration, corpus, rules).dynamics())
        self._solver = cache(lambda configuration, rules: Solver(self.dynamics(configuration, rules)))

    def tasks(self, configuration: str, split: str) -> TaskSet:
        """Raises ValueError for unknown names, NoTasksError if there are no such tasks, CorpusError for bad data."""
        settings = Settings(configuration, self.corpus)
        return load_tasks(self.corpus, settings.appearance, settings.start, split)

    def sizes(self) -> dict[str, dict[str, int]]:
        """The number of tasks by configuration and split; empty ones are left out."""
        sizes: dict[str, dict[str, int]] = {}
        for configuration, split in product(CONFIGURATIONS, SPLITS):
            try:
                sizes.setdefault(configuration, {})[split] = len(self.tasks(configuration, split))
            except NoTasksError:
                continue
        return {configuration: splits for configuration, splits in sizes.items() if splits}

    def dynamics(self, configuration: str, rules: str = "paper") -> Dynamics:
        """The MDP of a configuration. Raises ValueError for unknown names."""
        return self._dynamics(configuration, rules)

    def solver(self, configuration: str, rules: str = "paper") -> Solver:
        """The expert of a configuration. Raises UnsupportedAppearance, other ValueErrors for unknown names."""
        return self._solver(configuration, rules)
