"""What there is to imitate: statements, and scenes with their truth and the expert's optimal first actions."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.appearances import Scatter, Tower
from lilgym_mp.augmentation import facts, random_pair
from lilgym_mp.corpus.tokens import words
from lilgym_mp.generator.training_pairs import training_pairs
from lilgym_mp.learning.imitation.action_heads import ActionHeads, action_heads
from lilgym_mp.learning.imitation.box_features import BoxFeatureTable
from lilgym_mp.programs import Program, compile_program
from lilgym_mp.rules import Dynamics, State
from lilgym_mp.scene import BOX_COUNT, Scene
from lilgym_mp.solver import Solver
from lilgym_mp.task import Task

BOX_ORDERS = tuple(permutations(range(BOX_COUNT)))
MOST_RANDOM_EDITS = 3
STARTS = 4  # of a generated statement
Rng = np.random.Generator


@dataclass
class DatasetEntry:
    """One statement and what is known of it so far: M scenes, of which some with optimal actions."""

    statement: str
    program: Program
    starts: tuple[Scene, ...]
    exchanges_colours: bool  # whether statement and program name the same colours
    scenes: list[tuple[int, int, int]] = field(default_factory=list)  # boxes of each scene, by index
    truths: list[bool] = field(default_factory=list)
    steps: list[int] = field(default_factory=list)  # of a shortest solution; 0 where no actions are known
    actions: list[NDArray[np.int64] | None] = field(default_factory=list)  # the heads' indices
    with_actions: list[int] = field(default_factory=list)  # which of the scenes have actions
    known: dict[tuple[int, int, int], int] = field(default_factory=dict)  # scene by its boxes


def entries_from_tasks(tasks: Iterable[Task]) -> list[DatasetEntry]:
    """A entry for each statement and program among the tasks, with the start scenes of all its tasks."""
    found: dict[tuple[str, str], list[Task]] = {}
    for task in tasks:
        found.setdefault((task.statement, task.program), []).append(task)
    return [
        _entry(statement, program, tuple(dict.fromkeys(task.start for task in group)))
        for (statement, program), group in found.items()
    ]


def derived_entry(entry: DatasetEntry, rng: Rng) -> DatasetEntry | None:
    """The entry with colours, shapes, sides and numbers exchanged in statement and program, where that can be."""
    statement, program = random_pair(entry.statement, entry.program.source, rng)
    if program == entry.program.source:
        return None
    return _entry(statement, program, entry.starts)


def generated_entries(appearance: str, seed: int, starts: Sequence[Scene], rng: Rng) -> Iterator[DatasetEntry]:
    """Endless entries from generated statements, each with some of the start scenes."""
    for statement, program in training_pairs(appearance, seed):
        chosen = rng.choice(len(starts), min(STARTS, len(starts)), replace=False)
        yield _entry(statement, program, tuple(starts[index] for index in chosen.tolist()))


def _entry(statement: str, program: str, starts: tuple[Scene, ...]) -> DatasetEntry:
    return DatasetEntry(statement, compile_program(program), starts, facts(statement, program).colours)


class Pool:
    """The last entries that came, of which the oldest go."""

    def __init__(self, source: Iterator[DatasetEntry | None], most: int) -> None:
        self._source = source
        self.entries: deque[DatasetEntry] = deque(maxlen=most)

    def grow(
        self, collector: DataCollector, count: int, solved: int, judged: int, other_scenes: Sequence[Scene]
    ) -> None:
        """Takes `count` more from the source and keeps those that the expert solves scenes of."""
        for entry in itertools.islice(self._source, count):
            if entry is not None:
                collector.collect(entry, solved, judged, other_scenes)
                if entry.with_actions:
                    self.entries.append(entry)


def held_out(entries: Sequence[DatasetEntry], share: float, seed: int) -> tuple[list[DatasetEntry], list[DatasetEntry]]:
    """The entries to learn from and those kept apart: whole statements, so that none is in both."""
    statements = sorted({tuple(words(entry.statement)) for entry in entries})
    order = np.random.default_rng(seed).permutation(len(statements))
    apart = {statements[index] for index in order[: round(share * len(statements))]}
    learnt = [entry for entry in entries if tuple(words(entry.statement)) not in apart]
    return learnt, [entry for entry in entries if tuple(words(entry.statement)) in apart]


class DataCollector:
    """Fills entries with scenes: starts, what random edits make of them, the expert's way on, and goals."""

    def __init__(
        self, dynamics: Dynamics, table: BoxFeatureTable, rng: Rng, budget: int | None = None, empty_starts: float = 0.0
    ) -> None:
        """`empty_starts`: the share of walks that begin at the empty scene instead of one of the entry's starts."""
        appearance = dynamics.appearance
        assert isinstance(appearance, Tower | Scatter)
        self.table = table
        self.heads: ActionHeads = action_heads(appearance)
        self._dynamics = dynamics
        self._appearance = appearance
        self._solver = Solver(dynamics, budget)
        self._rng = rng
        self._empty_starts = empty_starts
        self.sets = 0  # asked of the expert

    def use(self, rng: Rng) -> None:
        """Takes all chance from `rng` from now on."""
        self._rng = rng

    def collect(self, entry: DatasetEntry, solved: int, judged: int, other_scenes: Sequence[Scene]) -> None:
        """Adds walks to the entry with about `solved` more scenes with actions, and `judged` with truths alone."""
        wanted = len(entry.with_actions) + solved
        for _ in range(4 * solved):  # some scenes are known already, some cannot be solved
            if len(entry.with_actions) >= wanted:
                break
            self._add_trajectory(entry, wanted)
        for _ in range(judged):
            self._add_truth_label(entry, other_scenes)

    def add(self, entry: DatasetEntry, scene: Scene, *, solve: bool) -> int:
        """Index of the scene in the entry, judged, and solved for the other truth value if asked."""
        left, middle, right = (self.table.index(box) for box in scene.boxes)
        boxes = (left, middle, right)
        index = entry.known.get(boxes)
        if index is None:
            index = entry.known[boxes] = len(entry.scenes)
            entry.scenes.append(boxes)
            entry.truths.append(bool(entry.program(scene)))
            entry.steps.append(0)
            entry.actions.append(None)
        if solve and not entry.steps[index]:
            task = Task("", entry.statement, entry.program.source, not entry.truths[index], scene)
            found = self._solver.optimal_actions(State(task, scene, 0))
            self.sets += 1
            heads = self.heads.index_of[list(found.actions)] if found.actions else np.zeros(0, np.int64)
            if found.steps > 1 and len(heads):
                entry.steps[index] = found.steps
                entry.actions[index] = heads
                entry.with_actions.append(index)
        return index

    def _add_trajectory(self, entry: DatasetEntry, wanted: int) -> None:
        """From a start, randomly edited, along optimal actions until the truth changes."""
        rng = self._rng
        scene = self.start(entry).permuted(BOX_ORDERS[rng.integers(len(BOX_ORDERS))])
        for _ in range(rng.integers(MOST_RANDOM_EDITS + 1)):
            scene = self.edited(scene)
        for _ in range(self._dynamics.horizon):
            index = self.add(entry, scene, solve=True)
            actions = entry.actions[index]
            if actions is None or len(entry.with_actions) >= wanted:
                return
            truth = entry.truths[index]
            self.add(entry, self.edited(scene), solve=False)  # what is near it, whatever its truth
            number = self.heads.action_of[actions[rng.integers(len(actions))]]
            scene, _ = self._appearance.apply(
                scene, self._appearance.decode(int(number)), self._dynamics.rules.placement
            )
            if entry.truths[self.add(entry, scene, solve=False)] != truth:
                self.add(entry, self.edited(scene), solve=False)
                return

    def _add_truth_label(self, entry: DatasetEntry, other_scenes: Sequence[Scene]) -> None:
        """Adds a scene with its truth alone: an edit away from one that is known, or from other_scenes."""
        rng = self._rng
        if other_scenes and rng.random() < 0.5:
            scene = other_scenes[int(rng.integers(len(other_scenes)))]
        else:
            boxes = [self.table.boxes[box] for box in entry.scenes[rng.integers(len(entry.scenes))]]
            scene = Scene((boxes[0], boxes[1], boxes[2]))
        if rng.random() < 0.8:
            scene = self.edited(scene)
        self.add(entry, scene, solve=False)

    def start(self, entry: DatasetEntry) -> Scene:
        """A start at random."""
        if self._rng.random() < self._empty_starts:
            return Scene.empty()
        return entry.starts[self._rng.integers(len(entry.starts))]

    def edited(self, scene: Scene) -> Scene:
        """The scene after a random valid edit: ADD and REMOVE equally likely where both are possible."""
        rng = self._rng
        placement = self._dynamics.rules.placement
        heads = self.heads
        removing = rng.random() < 0.5 and any(box.items for box in scene.boxes)
        for _ in range(100):
            head = 1 + (heads.adds + rng.integers(heads.removes) if removing else rng.integers(heads.adds))
            action = self._appearance.decode(int(heads.action_of[head]))
            after, invalid = self._appearance.apply(scene, action, placement)
            if invalid is None:
                return after
        return scene
