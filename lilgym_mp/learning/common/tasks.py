"""Training tasks: the train split without held-out statements, plus augmented tasks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np

from lilgym_mp.corpus import NoTasksError, TaskSet, load_tasks
from lilgym_mp.corpus.matching import solvable_matching_corpus, with_permuted_boxes
from lilgym_mp.corpus.records import FLIPIT, SCRATCH
from lilgym_mp.evaluation import Settings
from lilgym_mp.learning.common.augmentation import COLOUR_PERMUTATIONS, SHAPE_PERMUTATIONS, Augmentation
from lilgym_mp.learning.common.recipes import UpdateRecipe
from lilgym_mp.programs.task import Task
from lilgym_mp.scene.arrays import BoolArray, Int64Array

TRAINING_SPLIT = "train"
MAX_VALIDATION_TASKS = 300  # about as many are played, evenly spaced
_HELD_OUT_SEED = 0  # the same for every run, so that runs are comparable


@dataclass(frozen=True)
class TrainingTasks:
    """Tasks for training and validation."""

    tasks: TaskSet  # for training
    from_empty: BoolArray  # (tasks,) Scratch tasks in a FlipIt run
    validation: tuple[str, ...]  # held-out task ids of the corpus's train split
    sha256: str  # SHA-256 of the corpus file

    @property
    def statements(self) -> tuple[str, ...]:
        """The distinct statements."""
        return tuple(dict.fromkeys(task.statement for task in self.tasks))

    @property
    def plays_empty_starts(self) -> bool:
        return bool(self.from_empty.any())


def training_tasks(settings: Settings, recipe: UpdateRecipe, *, matching: bool = False) -> TrainingTasks:
    """`matching`: only tasks with a scene labelled in the corpus, which alone solve them.

    Raises CorpusError for unusable data, ValueError when no training task is left.
    """
    main = load_tasks(settings.corpus, settings.appearance, settings.start, TRAINING_SPLIT)
    held_out = _held_out(main, recipe.held_out)
    validation = [task.id for task in main if task.statement in held_out]
    base = solvable_matching_corpus(main) if matching else main
    training = _without(base, held_out)
    empty: TaskSet | None = None
    if settings.start == FLIPIT and recipe.empty_starts:
        with suppress(NoTasksError):
            empty = _without(load_tasks(settings.corpus, settings.appearance, SCRATCH, TRAINING_SPLIT), held_out)
    if recipe.permute_boxes:
        training = with_permuted_boxes(training)
    tasks = list(_augmented(training, "", settings.appearance, recipe))
    if empty is not None:
        tasks += _augmented(empty, "empty:", settings.appearance, recipe)
    # Recoloured training statements may equal held-out ones.
    tasks = [task for task in tasks if task.statement not in held_out]
    if not tasks:
        raise ValueError(f"{main.provenance}: no training task is left; lower held-out")
    from_empty = np.array([task.id.startswith("empty:") for task in tasks])
    step = max(1, len(validation) // MAX_VALIDATION_TASKS)
    return TrainingTasks(TaskSet(tasks, main.provenance), from_empty, tuple(validation[::step]), main.provenance.sha256)


def _held_out(tasks: TaskSet, fraction: float) -> set[str]:
    statements = sorted({task.statement for task in tasks})
    order = np.random.default_rng(_HELD_OUT_SEED).permutation(len(statements))
    return {statements[index] for index in order[: round(fraction * len(statements))]}


def _without(tasks: TaskSet, held_out: set[str]) -> TaskSet:
    return TaskSet((task for task in tasks if task.statement not in held_out), tasks.provenance)


def _augmented(tasks: TaskSet, prefix: str, appearance: str, recipe: UpdateRecipe) -> Iterator[Task]:
    """The tasks and their augmentations, with `prefix` before and a suffix after each id."""
    for suffix, exchange_for in _exchanges(recipe):
        seen: set[tuple[object, ...]] = set()
        for task in tasks:
            new = exchange_for(task.statement).task(task, appearance) if suffix else task
            if new is None or (suffix and (new.statement, new.start) == (task.statement, task.start)):
                continue
            if (key := (new.statement, new.target, new.start)) in seen and suffix:
                continue
            seen.add(key)
            yield replace(new, id=f"{prefix}{task.id}{suffix}")


def _exchanges(recipe: UpdateRecipe) -> Iterator[tuple[str, Callable[[str], Augmentation]]]:
    """Id suffixes and augmentations; the same augmentation for all tasks of a statement."""
    for index, colours in enumerate(COLOUR_PERMUTATIONS if recipe.recolour else COLOUR_PERMUTATIONS[:1]):
        yield (f"#{index}" if index else ""), lambda _, colours=colours: colours
        if recipe.exchange_shapes:
            yield f"#{index}s", lambda statement, colours=colours: _with_shapes(colours, statement)


def _with_shapes(colours: Augmentation, statement: str) -> Augmentation:
    rng = np.random.default_rng([*colours.colours, crc32(statement.encode())])
    return replace(
        colours, shapes=SHAPE_PERMUTATIONS[rng.integers(1, len(SHAPE_PERMUTATIONS))], mirrored=bool(rng.integers(2))
    )


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

    def resample_statements(self, rng: np.random.Generator) -> None:
        """Samples a statement for every group; it applies to episodes started from now on."""
        self.current = self._sample_statements(len(self.current), rng)

    def _sample_statements(self, count: int, rng: np.random.Generator) -> Int64Array:
        indices = np.searchsorted(self._cumulative, rng.random(count), side="right")
        return np.minimum(indices, len(self.statements) - 1)

    def sample(self, env_ids: Int64Array, rng: np.random.Generator) -> list[int]:
        """The index of the next task for each of the environments."""
        if self._group == 1:  # a new statement for each episode
            self.current[env_ids] = self._sample_statements(len(env_ids), rng)
        sampled: list[int] = []
        for statement in self.current[env_ids // self._group].tolist():
            sampled.append(self.draw_task(statement, rng))
        return sampled

    def draw_statement(self, rng: np.random.Generator) -> int:
        """The index of a statement."""
        return int(self._sample_statements(1, rng)[0])

    def draw_task(self, statement: int, rng: np.random.Generator) -> int:
        """The index of one of the statement's tasks."""
        main, empty = self._main[statement], self._empty[statement]
        chosen = empty if len(empty) and (not len(main) or rng.random() < self._empty_fraction) else main
        return int(chosen[rng.integers(len(chosen))])


def _by_statement(statement_of: Int64Array, mask: BoolArray, count: int) -> list[Int64Array]:
    """The indices of the tasks in the mask, by statement."""
    tasks = np.flatnonzero(mask)
    order = tasks[np.argsort(statement_of[tasks], kind="stable")]
    return np.split(order, np.searchsorted(statement_of[order], np.arange(1, count)))
