"""Success as likeness to the corpus's own scenes, instead of by program. Source: SPEC section 6 (NLVR reward)."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

from lilgym_mp.corpus.faults import CorpusError
from lilgym_mp.corpus.loading import load_tasks
from lilgym_mp.corpus.records import FLIPIT, SCRATCH
from lilgym_mp.corpus.tasks import TaskSet
from lilgym_mp.scene import Item, Scene
from lilgym_mp.task import Task

Content = tuple[tuple[Item, ...], ...]


@dataclass(frozen=True, slots=True)
class MatchingTask(Task):
    """A task that only the given scenes solve."""

    goals: frozenset[Content]  # `content` of each

    def solved_by(self, scene: Scene) -> bool:
        return content(scene) in self.goals


def content(scene: Scene) -> Content:
    """What is in each box, whatever the order in which it came."""
    return tuple(tuple(sorted(box.items)) for box in scene.boxes)


def matching_corpus(tasks: TaskSet) -> TaskSet:
    """The Scratch tasks, each solved only by the corpus's start scenes for its statement that have its target as label.

    The scenes are those of the FlipIt tasks of the same corpus and split. Raises CorpusError for FlipIt tasks, and
    where the corpus has no scene for any statement.
    """
    origin = tasks.provenance
    if origin.start != SCRATCH:
        raise CorpusError(
            f"{origin}: scenes are compared for Scratch tasks only; in FlipIt they are where the tasks start"
        )
    labelled: defaultdict[tuple[str, bool], set[Content]] = defaultdict(set)
    for flipit in load_tasks(origin.corpus, origin.appearance, FLIPIT, origin.split):
        labelled[flipit.statement, not flipit.target].add(content(flipit.start))
    matching = (_matching(task, frozenset(labelled[task.statement, task.target])) for task in tasks)
    return TaskSet(matching, origin, {name: tasks.tags(name) for name in tasks.ids})


def solvable_matching_corpus(tasks: TaskSet) -> TaskSet:
    """The same without the tasks that no scene of the corpus solves, as the paper leaves them out (its Figure 4)."""
    kept = [task for task in matching_corpus(tasks) if isinstance(task, MatchingTask) and task.goals]
    return TaskSet(kept, tasks.provenance, {task.id: tasks.tags(task.id) for task in kept})


def _matching(task: Task, goals: frozenset[Content]) -> MatchingTask:
    return MatchingTask(task.id, task.statement, task.program, task.target, task.start, goals)
