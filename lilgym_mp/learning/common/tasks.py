"""Training tasks: the train split without held-out statements, plus recoloured tasks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from lilgym_mp.corpus import NoTasksError, TaskSet
from lilgym_mp.corpus.records import FLIPIT, SCRATCH
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.envs.registration import configuration_name
from lilgym_mp.learning.common.augmentation import RECOLOURINGS
from lilgym_mp.learning.common.recipes import UpdateRecipe
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.scene.arrays import BoolArray, Int64Array, Rng, Strings

TRAINING_SPLIT = "train"
MAX_VALIDATION_TASKS = 300  # about as many are played, evenly spaced
Choice = TypeVar("Choice")


def train_tasks(settings: EnvConfig, *, scratch: bool = True) -> dict[str, TaskSet]:
    """The train tasks by configuration: its own first; with `scratch`, a FlipIt run plays those of Scratch too.

    Raises CorpusError for unusable data, ValueError for settings that make no environment.
    """
    settings.dynamics()
    tasks = {settings.configuration: settings.tasks(TRAINING_SPLIT)}
    if scratch and settings.start == FLIPIT:
        name = configuration_name(settings.appearance, SCRATCH)
        with suppress(NoTasksError):
            tasks[name] = replace(settings, configuration=name).tasks(TRAINING_SPLIT)
    return tasks


def choose_held_out(choices: Sequence[Choice], fraction: float) -> set[Choice]:
    """The fraction of the choices held out of training, the same for every run, so that runs are comparable."""
    order = np.random.default_rng(0).permutation(len(choices))
    return {choices[index] for index in order[: round(fraction * len(choices))]}


@dataclass(frozen=True)
class TrainingTasks:
    """Tasks for training and validation."""

    tasks: TaskSet  # for training
    from_empty: BoolArray  # (tasks,) Scratch tasks in a FlipIt run
    validation: Strings  # held-out task ids of the corpus's train split
    sha256: str  # SHA-256 of the corpus file

    @property
    def statements(self) -> Strings:
        """The distinct statements."""
        return tuple(dict.fromkeys(task.statement for task in self.tasks))


def training_tasks(settings: EnvConfig, recipe: UpdateRecipe, *, matching: bool = False) -> TrainingTasks:
    """`matching`: only tasks with a scene labelled in the corpus, which alone solve them.

    Raises CorpusError for unusable data, ValueError when no training task is left.
    """
    main, *empty = train_tasks(settings, scratch=recipe.empty_starts > 0).values()
    held_out = choose_held_out(sorted({task.statement for task in main}), recipe.held_out)
    validation = [task.id for task in main if task.statement in held_out]
    base = main
    if matching:
        from lilgym_mp.corpus.matching import solvable_matching_corpus

        base = solvable_matching_corpus(main)
    tasks = list(_recoloured(base, held_out, "", recipe))
    for some in empty:
        tasks += _recoloured(some, held_out, "empty:", recipe)
    if not tasks:
        raise ValueError(f"{main.provenance}: no training task is left; lower held-out")
    from_empty = np.array([task.id.startswith("empty:") for task in tasks])
    step = max(1, len(validation) // MAX_VALIDATION_TASKS)
    return TrainingTasks(TaskSet(tasks, main.provenance), from_empty, tuple(validation[::step]), main.provenance.sha256)


def _recoloured(tasks: TaskSet, held_out: set[str], prefix: str, recipe: UpdateRecipe) -> Iterator[Task]:
    """The tasks, recoloured too if the recipe says so, with `prefix` before and a suffix after each id.

    Tasks with held-out statements are left out, and recoloured ones that become such.
    """
    kept = [task for task in tasks if task.statement not in held_out]
    for task in kept:
        yield replace(task, id=f"{prefix}{task.id}")
    for index, recolouring in enumerate(RECOLOURINGS[1:] if recipe.recolour else (), 1):
        seen = set[tuple[str, bool, Scene]]()
        for task in kept:
            new = recolouring.task(task)
            if new is None or (new.statement, new.start) == (task.statement, task.start):
                continue
            key = new.statement, new.target, new.start
            if key not in seen and new.statement not in held_out:
                seen.add(key)
                yield replace(new, id=f"{prefix}{task.id}#{index}")


class TaskSampler:
    """Samples tasks; environments are grouped, and each group plays one statement at a time."""

    def __init__(self, tasks: TrainingTasks, recipe: UpdateRecipe) -> None:
        self._empty_fraction = recipe.empty_starts
        self._group = recipe.same_statement
        indices: dict[str, int] = {}
        self.statement_of: Int64Array = np.array(
            [indices.setdefault(task.statement, len(indices)) for task in tasks.tasks], np.int64
        )
        self.statements = tuple(indices)
        self._main = _by_statement(self.statement_of, ~tasks.from_empty, len(indices))
        self._empty = _by_statement(self.statement_of, tasks.from_empty, len(indices))
        counts = np.array([len(task_indices) for task_indices in self._main], np.float64)
        if not counts.any():
            counts += 1
        self._cumulative = (counts / counts.sum()).cumsum()  # statements weighted by their number of tasks
        self.current = np.full(recipe.envs // self._group, -1, np.int64)  # (groups,) statement index

    def resample_statements(self, rng: Rng) -> None:
        """Samples a statement for every group; it applies to episodes started from now on."""
        self.current = self.draw_statements(len(self.current), rng)

    def draw_statements(self, count: int, rng: Rng) -> Int64Array:
        """(count,) indices of statements."""
        indices = np.searchsorted(self._cumulative, rng.random(count), side="right")
        return np.minimum(indices, len(self.statements) - 1)

    def sample(self, env_ids: Int64Array, rng: Rng) -> list[int]:
        """The index of the next task for each of the environments."""
        if self._group == 1:  # a new statement for each episode
            self.current[env_ids] = self.draw_statements(len(env_ids), rng)
        sampled: list[int] = []
        for statement in self.current[env_ids // self._group].tolist():
            sampled.append(self.draw_task(statement, rng))
        return sampled

    def draw_task(self, statement: int, rng: Rng) -> int:
        """The index of one of the statement's tasks."""
        main = self._main[statement]
        empty = self._empty[statement]
        chosen = empty if len(empty) and (not len(main) or rng.random() < self._empty_fraction) else main
        return int(chosen[rng.integers(len(chosen))])


def _by_statement(statement_of: Int64Array, mask: BoolArray, count: int) -> list[Int64Array]:
    """The indices of the tasks in the mask, by statement."""
    tasks = np.flatnonzero(mask)
    order = tasks[np.argsort(statement_of[tasks], kind="stable")]
    return np.split(order, np.searchsorted(statement_of[order], np.arange(1, count)))
