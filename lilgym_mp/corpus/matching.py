"""Tasks solved by matching the corpus's own scenes instead of by program. Source: docs/spec.md, "NLVR reward"."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace

from lilgym_mp.corpus.faults import CorpusError
from lilgym_mp.corpus.loading import load_tasks
from lilgym_mp.corpus.records import FLIPIT, SCRATCH
from lilgym_mp.corpus.tasks import TaskSet
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Item, Scene

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
    matching = (replace(task, other_goal=goal) for task, goal in zip(tasks, goals, strict=True))
    return TaskSet(matching, origin, {name: tasks.tags(name) for name in tasks.ids})


def solvable_matching_corpus(tasks: TaskSet) -> TaskSet:
    """`matching_corpus` without tasks that have no goal scene, as in the paper (Figure 4)."""
    kept = [task for task in matching_corpus(tasks) if goal_contents(task)]
    return TaskSet(kept, tasks.provenance, {task.id: tasks.tags(task.id) for task in kept})


def goal_contents(task: Task) -> frozenset[Content]:
    """The contents of the scenes that solve a task of `matching_corpus`."""
    return task.other_goal.contents if isinstance(task.other_goal, SceneGoal) else frozenset()
