"""The tasks that a run plays: of train, but for the statements held out, and more made of them as the recipe says."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np

from lilgym_mp.arrays import BoolArray, Int64Array
from lilgym_mp.augmentation import COLOUR_PERMUTATIONS, SHAPE_PERMUTATIONS, Augmentation
from lilgym_mp.corpus import NoTasksError, TaskSet, load_tasks
from lilgym_mp.corpus.matching import solvable_matching_corpus
from lilgym_mp.corpus.permutation import with_permuted_boxes
from lilgym_mp.corpus.records import FLIPIT, SCRATCH
from lilgym_mp.evaluation import Settings
from lilgym_mp.learning.ppo.recipe import PPORecipe
from lilgym_mp.task import Task

TRAINING_SPLIT = "train"
MOST_VALIDATED = 300  # tasks; of more, every so many are played
_HELD_OUT_SEED = 0  # the same statements for every run, so that runs can be compared


@dataclass(frozen=True)
class TrainingTasks:
    """What a run plays and what it is validated on."""

    tasks: TaskSet  # all that episodes may be of
    from_empty: BoolArray  # (tasks,) Scratch tasks of a FlipIt run
    validation: tuple[str, ...]  # ids in the corpus's own train split
    sha256: str  # of the file that they come from

    @property
    def statements(self) -> tuple[str, ...]:
        """Every statement, once."""
        return tuple(dict.fromkeys(task.statement for task in self.tasks))


def training_tasks(settings: Settings, recipe: PPORecipe) -> TrainingTasks:
    """Raises CorpusError for unusable data, ValueError where nothing is left to learn from."""
    main = load_tasks(settings.corpus, settings.appearance, settings.start, TRAINING_SPLIT)
    held_out = _held_out(main, recipe.held_out)
    validation = [task.id for task in main if task.statement in held_out]
    base = solvable_matching_corpus(main) if recipe.nlvr_reward else main
    played = _without(base, held_out)
    empty: TaskSet | None = None
    if settings.start == FLIPIT and recipe.empty_starts:
        with suppress(NoTasksError):
            empty = _without(load_tasks(settings.corpus, settings.appearance, SCRATCH, TRAINING_SPLIT), held_out)
    if recipe.permute_boxes:
        played = with_permuted_boxes(played)
    tasks = list(_named(played, "", settings.appearance, recipe))
    if empty is not None:
        tasks += _named(empty, "empty:", settings.appearance, recipe)
    # Exchanging colours makes statements that are held out of others.
    tasks = [task for task in tasks if task.statement not in held_out]
    if not tasks:
        raise ValueError(f"{main.provenance}: no task is left to learn from; lower held-out")
    from_empty = np.array([task.id.startswith("empty:") for task in tasks])
    step = max(1, len(validation) // MOST_VALIDATED)
    return TrainingTasks(TaskSet(tasks, main.provenance), from_empty, tuple(validation[::step]), main.provenance.sha256)


def plays_empty_starts(tasks: TrainingTasks) -> bool:
    return bool(tasks.from_empty.any())


def _held_out(tasks: TaskSet, share: float) -> set[str]:
    statements = sorted({task.statement for task in tasks})
    order = np.random.default_rng(_HELD_OUT_SEED).permutation(len(statements))
    return {statements[index] for index in order[: round(share * len(statements))]}


def _without(tasks: TaskSet, held_out: set[str]) -> TaskSet:
    return TaskSet((task for task in tasks if task.statement not in held_out), tasks.provenance)


def _named(tasks: TaskSet, prefix: str, appearance: str, recipe: PPORecipe) -> Iterator[Task]:
    """The tasks with `prefix` before their ids, and what the recipe's exchanges make of each."""
    for suffix, exchange_for in _exchanges(recipe):
        met: set[tuple[object, ...]] = set()
        for task in tasks:
            new = exchange_for(task.statement).task(task, appearance) if suffix else task
            if new is None or (suffix and (new.statement, new.start) == (task.statement, task.start)):
                continue
            if (key := (new.statement, new.target, new.start)) in met and suffix:
                continue
            met.add(key)
            yield replace(new, id=f"{prefix}{task.id}{suffix}")


def _exchanges(recipe: PPORecipe) -> Iterator[tuple[str, Callable[[str], Augmentation]]]:
    """What is exchanged for a statement, the same for all of its tasks, with an ending of their ids."""
    for number, colours in enumerate(COLOUR_PERMUTATIONS if recipe.recolour else COLOUR_PERMUTATIONS[:1]):
        yield (f"#{number}" if number else ""), lambda _, colours=colours: colours
        if recipe.exchange_shapes:
            yield f"#{number}s", lambda statement, colours=colours: _with_shapes(colours, statement)


def _with_shapes(colours: Augmentation, statement: str) -> Augmentation:
    rng = np.random.default_rng([*colours.colours, crc32(statement.encode())])
    return replace(
        colours, shapes=SHAPE_PERMUTATIONS[rng.integers(1, len(SHAPE_PERMUTATIONS))], mirrored=bool(rng.integers(2))
    )


class TaskSampler:
    """Draws tasks: environments in groups, each of one statement at a time."""

    def __init__(self, tasks: TrainingTasks, recipe: PPORecipe) -> None:
        self._empty_share = recipe.empty_starts
        self._group = recipe.same_statement
        numbers: dict[str, int] = {}
        self.statement_of: Int64Array = np.array(
            [numbers.setdefault(task.statement, len(numbers)) for task in tasks.tasks], np.int64
        )
        self.statements = tuple(numbers)
        self._mains = _by_statement(self.statement_of, ~tasks.from_empty, len(numbers))
        self._empties = _by_statement(self.statement_of, tasks.from_empty, len(numbers))
        sizes = np.array([len(found) for found in self._mains], np.float64)
        if not sizes.any():
            sizes += 1
        self._shares = (sizes / sizes.sum()).cumsum()
        self.current = np.full(recipe.envs // self._group, -1, np.int64)  # (groups,) statement that each plays

    def resample_statements(self, rng: np.random.Generator) -> None:
        """Gives every group another statement, for the episodes that begin henceforth."""
        found = np.searchsorted(self._shares, rng.random(len(self.current)), side="right")
        self.current = np.minimum(found, len(self.statements) - 1)

    def draw(self, env_ids: Int64Array, rng: np.random.Generator) -> list[int]:
        """The next task's number for each of some environments."""
        if self._group == 1:  # each episode has a statement of its own
            found = np.searchsorted(self._shares, rng.random(len(env_ids)), side="right")
            self.current[env_ids] = np.minimum(found, len(self.statements) - 1)
        drawn: list[int] = []
        for statement in self.current[env_ids // self._group].tolist():
            mains, empties = self._mains[statement], self._empties[statement]
            chosen = empties if len(empties) and (not len(mains) or rng.random() < self._empty_share) else mains
            drawn.append(int(chosen[rng.integers(len(chosen))]))
        return drawn


def _by_statement(statement_of: Int64Array, wanted: BoolArray, count: int) -> list[Int64Array]:
    tasks = np.flatnonzero(wanted)
    order = tasks[np.argsort(statement_of[tasks], kind="stable")]
    return np.split(order, np.searchsorted(statement_of[order], np.arange(1, count)))
