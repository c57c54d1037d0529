"""Scenes labelled with the statement's truth, which only the outcome of a STOP tells; STOPs and steps are counted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from lilgym_mp.envs.rules import Dynamics, Outcome, State
from lilgym_mp.learning.common.boxes import BoxIndex
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import STOP, Action
from lilgym_mp.scene.appearances.places import places_of
from lilgym_mp.scene.arrays import Float64Array, Int64Array, Rng
from lilgym_mp.scene.grouping import grouped

Boxes = tuple[int, int, int]  # a scene as indices in the box table
MAX_TRIES = 20  # random edits until one is legal
LONGEST_WALK = 4  # edits from a start or a known scene
CLIMB_LENGTH = 6  # edits
CLIMB_WIDTH = 12  # random edits, of which one is made
LONGEST_BUILD = 10  # edits from the empty scene


class PathFromStart(NamedTuple):
    """From which start a scene was reached, and by how many edits."""

    task: int  # index in the entry's tasks, from whose start
    edits: int


@dataclass
class LabelledStatement:
    """A statement and what is known of it."""

    statement: str
    tasks: list[Task] = field(default_factory=list)
    scenes: list[Boxes] = field(default_factory=list)
    truths: list[bool] = field(default_factory=list)  # in these scenes
    paths: list[PathFromStart] = field(default_factory=list)  # to these scenes
    pairs: list[tuple[int, int]] = field(default_factory=list)  # one edit apart, true and false
    index: dict[Boxes, int] = field(default_factory=dict)
    start_boxes: Int64Array = field(default_factory=lambda: np.zeros((0, 3), np.int64))  # of the tasks, once needed
    by_truth: tuple[list[int], list[int]] = field(default_factory=lambda: ([], []))

    def add(self, boxes: Boxes, *, truth: bool) -> int:
        """Adds a labelled scene, and returns its index."""
        index = self.index[boxes] = len(self.scenes)
        self.scenes.append(boxes)
        self.truths.append(truth)
        self.by_truth[truth].append(index)
        return index

    def random_task(self, rng: Rng) -> int:
        """The index of a task: of those from the empty scene as often as of the others, if there are both."""
        by_start = grouped((any(task.start.items()), index) for index, task in enumerate(self.tasks))
        side = by_start.get(rng.random() >= 0.5) or next(iter(by_start.values()))
        return side[rng.integers(len(side))]


def entries_of(task_sets: Sequence[Sequence[Task]]) -> list[LabelledStatement]:
    """One entry for each distinct statement."""
    groups = grouped((task.statement, task) for tasks in task_sets for task in tasks)
    return [LabelledStatement(statement, tasks) for statement, tasks in groups.items()]


class Collector:
    """Plays episodes of edits and a STOP, from the starts of an entry's tasks."""

    def __init__(self, dynamics: Dynamics, table: BoxIndex, rng: Rng) -> None:
        self.dynamics = dynamics
        self.table = table
        self.rng = rng
        self.stops = self.steps = 0

    def stop(self, entry: LabelledStatement, task_index: int, scene: Scene, edits: int) -> int:
        """Labels a scene that is `edits` edits from the task's start by an episode that stops there, by a shorter way
        if one is known.

        Returns the scene's index in the entry; a known scene is not played again.
        """
        boxes = self.table.of(scene)
        found = entry.index.get(boxes)
        if found is not None:
            return found
        task_index, edits = self._nearest(entry, boxes, task_index, edits)
        task = entry.tasks[task_index]
        outcome = self.dynamics.step(State(task, scene, edits), STOP).outcome
        self.stops += 1
        self.steps += edits + 1
        entry.paths.append(PathFromStart(task_index, edits))
        return entry.add(boxes, truth=task.target == (outcome is Outcome.SUCCESS))

    def _nearest(self, entry: LabelledStatement, boxes: Boxes, task_index: int, edits: int) -> tuple[int, int]:
        """The task whose start the scene is nearest to, and the edits between them, where distances are known."""
        if self.table.distances is None:
            return task_index, edits
        if len(entry.start_boxes) != len(entry.tasks):
            entry.start_boxes = np.array([self.table.of(task.start) for task in entry.tasks])
        distances = self.table.distances[entry.start_boxes, boxes].sum(1)
        nearest = int(distances.argmin())
        return (nearest, int(distances[nearest])) if distances[nearest] < edits else (task_index, edits)

    def explore(self, entry: LabelledStatement, stops: int) -> None:
        """Stops in about `stops` new scenes: of walks from starts, from the empty scene and from known scenes."""
        enough = len(entry.scenes) + stops
        for _ in range(3 * stops):
            if len(entry.scenes) >= enough:
                return
            self._walk(entry, enough)

    def _walk(self, entry: LabelledStatement, enough: int) -> None:
        rng = self.rng
        index = self.begin(entry)
        task_index, edits = entry.paths[index]
        scene = self.table.scene(entry.scenes[index])
        is_build = not any(box.items for box in scene.boxes)
        for _ in range(rng.integers(1, (LONGEST_BUILD if is_build else LONGEST_WALK) + 1)):
            if edits + 1 >= self.dynamics.horizon or len(entry.scenes) >= enough:
                return
            after = self.edited(scene)
            if after is None:
                return
            scene = after
            edits += 1
            before = index
            index = self.stop(entry, task_index, scene, edits)
            self._compare(entry, before, index)
            task_index, edits = entry.paths[index]

    def begin(self, entry: LabelledStatement) -> int:
        """The index of a known scene, or of a start."""
        rng = self.rng
        choice = rng.random()
        if entry.pairs and choice < 0.4:
            return entry.pairs[rng.integers(len(entry.pairs))][rng.integers(2)]
        if entry.scenes and choice < 0.7:
            side = entry.by_truth[rng.integers(2)] or range(len(entry.scenes))
            return side[rng.integers(len(side))]
        task_index = entry.random_task(rng)
        return self.stop(entry, task_index, entry.tasks[task_index].start, 0)

    def climb(
        self, entries: Sequence[LabelledStatement], judge: Callable[[Sequence[Sequence[Scene]]], Float64Array]
    ) -> None:
        """Walks, one of each entry, of the edits that the model likes best for a truth value, among random ones.

        `judge` gives (E, CLIMB_WIDTH) logits of truth. Where the wanted value is met, the walk turns to the other one.
        """
        rng = self.rng
        current = [self.begin(entry) for entry in entries]
        wanted = rng.integers(2, size=len(entries)).astype(bool)
        for _ in range(CLIMB_LENGTH):
            scenes = [self.table.scene(entry.scenes[index]) for entry, index in zip(entries, current, strict=True)]
            found = [[self.edited(scene) or scene for _ in range(CLIMB_WIDTH)] for scene in scenes]
            best = np.where(wanted[:, None], 1, -1) * judge(found)
            for row, choice in enumerate(best.argmax(1).tolist()):
                entry = entries[row]
                before = current[row]
                task_index, edits = entry.paths[before]
                if edits + 1 >= self.dynamics.horizon:
                    current[row] = self.begin(entry)
                    continue
                after = current[row] = self.stop(entry, task_index, found[row][choice], edits + 1)
                self._compare(entry, before, after)
                wanted[row] ^= entry.truths[after] == wanted[row]

    def follow(self, entry: LabelledStatement, index: int, actions: Sequence[Action]) -> list[int]:
        """Plays a plan from a known scene, and stops in each of its scenes, in an episode of its own.

        Returns the indices of these scenes.
        """
        task_index, edits = entry.paths[index]
        state = State(entry.tasks[task_index], self.table.scene(entry.scenes[index]), edits)
        indices = [index]
        for action in actions[:-1]:
            state = self.dynamics.step(state, action).state
            indices.append(self.stop(entry, task_index, state.scene, state.steps))
            self._compare(entry, *indices[-2:])
        return indices

    @staticmethod
    def _compare(entry: LabelledStatement, before: int, after: int) -> None:
        """Notes two scenes, one edit apart, if one is true and the other false."""
        if entry.truths[before] != entry.truths[after]:
            entry.pairs.append((before, after) if entry.truths[before] else (after, before))

    def edited(self, scene: Scene) -> Scene | None:
        """The scene after a random legal edit: an ADD or a REMOVE; None if none was found."""
        appearance = self.dynamics.appearance
        places = places_of(appearance.grid)
        for _ in range(MAX_TRIES):
            edit = places.random_edit(appearance, scene, self.rng)
            after, invalid = appearance.apply(scene, edit, self.dynamics.rules.placement)
            if invalid is None:
                return after
        return None


def sample_scenes(entry: LabelledStatement, count: int, paired: float, rng: Rng) -> Int64Array:
    """(count,) indices of scenes of the entry: a fraction in contrast pairs, the rest half true and half false."""
    pairs = round(count * paired / 2) if entry.pairs else 0
    chosen: list[Int64Array] = []
    if pairs:
        indices = _recent(len(entry.pairs), pairs, rng)
        chosen.append(np.array([entry.pairs[index] for index in indices.tolist()]).ravel())
    rest = count - 2 * pairs
    for truth, number in ((True, rest // 2), (False, rest - rest // 2)):
        side = entry.by_truth[truth] or entry.by_truth[not truth]
        chosen.append(np.array([side[index] for index in _recent(len(side), number, rng).tolist()], np.int64))
    return np.concatenate(chosen)


def _recent(length: int, count: int, rng: Rng) -> Int64Array:
    """Indices drawn at random, half of them from the latest quarter."""
    first = np.where(rng.random(count) < 0.5, length - max(1, length // 4), 0)
    return first + (rng.random(count) * (length - first)).astype(np.int64)
