"""Changed tasks: solved by matching the corpus's own scenes (docs/spec.md, "NLVR reward"), or with boxes permuted."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import permutations

from lilgym_mp.corpus.faults import CorpusError
from lilgym_mp.corpus.loading import load_tasks
from lilgym_mp.corpus.records import FLIPIT, SCRATCH
from lilgym_mp.corpus.tasks import TaskSet
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import BOX_COUNT, Item, Scene

BOX_ORDERS = tuple(permutations(range(BOX_COUNT)))  # the identity first
Content = tuple[tuple[Item, ...], ...]


@dataclass(frozen=True, slots=True)
class SceneGoal:
    """One of some scenes, whatever the order of items."""

    contents: frozenset[Content]

    def reached_in(self, scene: Scene) -> bool:
        return content(scene) in self.contents


def content(scene: Scene) -> Content:
    """The items of each box, sorted: equal for scenes that differ only in the order of items."""
    return tuple(tuple(sorted(box.items)) for box in scene.boxes)


def matching_corpus(tasks: TaskSet) -> TaskSet:
    """The Scratch tasks, each solved only by the corpus's scenes for its statement whose label is its target.

    The scenes are the start scenes of the FlipIt tasks of the same corpus and split. Raises CorpusError for FlipIt
    tasks, and when the corpus has no FlipIt tasks.
    """
    origin = tasks.provenance
    if origin.start != SCRATCH:
        raise CorpusError(f"{origin}: scene matching requires Scratch tasks; in FlipIt the scenes are the start scenes")
    labelled: defaultdict[tuple[str, bool], set[Content]] = defaultdict(set)
    for flipit in load_tasks(origin.corpus, origin.appearance, FLIPIT, origin.split):
        labelled[flipit.statement, not flipit.target].add(content(flipit.start))
    goals = (SceneGoal(frozenset(labelled[task.statement, task.target])) for task in tasks)
    return TaskSet((replace(task, other_goal=goal) for task, goal in zip(tasks, goals, strict=True)), origin)


def solvable_matching_corpus(tasks: TaskSet) -> TaskSet:
    """`matching_corpus` without tasks that have no goal scene, as in the paper (Figure 4)."""
    return TaskSet((task for task in matching_corpus(tasks) if goal_contents(task)), tasks.provenance)


def goal_contents(task: Task) -> frozenset[Content]:
    """The contents of the scenes that solve a task of `matching_corpus`."""
    return task.other_goal.contents if isinstance(task.other_goal, SceneGoal) else frozenset()


def with_permuted_boxes(tasks: TaskSet, *, distinct: bool = False) -> TaskSet:
    """Every task with its start scene's boxes in each of the six orders, the original first (docs/spec.md, "Tasks").

    Task "7" yields "7", "7@021" .. "7@210"; digit k is the old index of the new box k. Orders that change the truth
    value are omitted, because the statement refers to the order. `distinct` also omits orders that yield a duplicate
    start scene; otherwise all orders are equally likely in a uniform draw.
    """
    variants = (variant for task in tasks for variant in _variants(task, distinct=distinct))
    return TaskSet(variants, tasks.provenance)


def _variants(task: Task, *, distinct: bool) -> Iterator[Task]:
    truth = task.truth(task.start)
    seen = {task.start}
    yield task
    for order in BOX_ORDERS[1:]:
        start = task.start.permuted(order)
        if (distinct and start in seen) or task.truth(start) != truth:
            continue
        seen.add(start)
        yield replace(task, id=f"{task.id}@{''.join(map(str, order))}", start=start)


def well_spelt_ids(tasks: TaskSet) -> list[str]:
    """The ids of the tasks whose statements are not tagged as mistyped; all ids if every one is."""
    return [task.id for task in tasks if "mistyped" not in task.tags] or list(tasks.ids)
