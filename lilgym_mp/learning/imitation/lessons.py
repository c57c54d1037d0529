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
from lilgym_mp.learning.imitation.boxes import BoxTable
from lilgym_mp.learning.imitation.layout import ActionLayout, action_layout
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
class Lesson:
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


def lessons_of(tasks: Iterable[Task]) -> list[Lesson]:
    """A lesson for each statement and program among the tasks, with the start scenes of all its tasks."""
    found: dict[tuple[str, str], list[Task]] = {}
    for task in tasks:
        found.setdefault((task.statement, task.program), []).append(task)
    return [
        _lesson(statement, program, tuple(dict.fromkeys(task.start for task in group)))
        for (statement, program), group in found.items()
    ]


def derived_lesson(lesson: Lesson, rng: Rng) -> Lesson | None:
    """The lesson with colours, shapes, sides and numbers exchanged in statement and program, where that can be."""
    statement, program = random_pair(lesson.statement, lesson.program.source, rng)
    if program == lesson.program.source:
        return None
    return _lesson(statement, program, lesson.starts)


def generated_lessons(appearance: str, seed: int, starts: Sequence[Scene], rng: Rng) -> Iterator[Lesson]:
    """Endless lessons from generated statements, each with some of the start scenes."""
    for statement, program in training_pairs(appearance, seed):
        chosen = rng.choice(len(starts), min(STARTS, len(starts)), replace=False)
        yield _lesson(statement, program, tuple(starts[index] for index in chosen.tolist()))


def _lesson(statement: str, program: str, starts: tuple[Scene, ...]) -> Lesson:
    return Lesson(statement, compile_program(program), starts, facts(statement, program).colours)


class Pool:
    """The last lessons that came, of which the oldest go."""

    def __init__(self, source: Iterator[Lesson | None], most: int) -> None:
        self._source = source
        self.lessons: deque[Lesson] = deque(maxlen=most)

    def grow(self, explorer: Explorer, count: int, solved: int, judged: int, elsewhere: Sequence[Scene]) -> None:
        """Takes `count` more from the source and keeps those that the expert solves scenes of."""
        for lesson in itertools.islice(self._source, count):
            if lesson is not None:
                explorer.explore(lesson, solved, judged, elsewhere)
                if lesson.with_actions:
                    self.lessons.append(lesson)


def held_out(lessons: Sequence[Lesson], share: float, seed: int) -> tuple[list[Lesson], list[Lesson]]:
    """The lessons to learn from and those kept apart: whole statements, so that none is in both."""
    statements = sorted({tuple(words(lesson.statement)) for lesson in lessons})
    order = np.random.default_rng(seed).permutation(len(statements))
    apart = {statements[index] for index in order[: round(share * len(statements))]}
    learnt = [lesson for lesson in lessons if tuple(words(lesson.statement)) not in apart]
    return learnt, [lesson for lesson in lessons if tuple(words(lesson.statement)) in apart]


class Explorer:
    """Fills lessons with scenes: starts, what random edits make of them, the expert's way on, and goals."""

    def __init__(
        self, dynamics: Dynamics, table: BoxTable, rng: Rng, budget: int | None = None, empty_starts: float = 0.0
    ) -> None:
        """`empty_starts`: the share of walks that begin at the empty scene instead of one of the lesson's starts."""
        appearance = dynamics.appearance
        assert isinstance(appearance, Tower | Scatter)
        self.table = table
        self.layout: ActionLayout = action_layout(appearance)
        self._dynamics = dynamics
        self._appearance = appearance
        self._solver = Solver(dynamics, budget)
        self._rng = rng
        self._empty_starts = empty_starts
        self.sets = 0  # asked of the expert

    def use(self, rng: Rng) -> None:
        """Takes all chance from `rng` from now on."""
        self._rng = rng

    def explore(self, lesson: Lesson, solved: int, judged: int, elsewhere: Sequence[Scene]) -> None:
        """Adds walks to the lesson with about `solved` more scenes with actions, and `judged` with truths alone."""
        wanted = len(lesson.with_actions) + solved
        for _ in range(4 * solved):  # some scenes are known already, some cannot be solved
            if len(lesson.with_actions) >= wanted:
                break
            self._walk(lesson, wanted)
        for _ in range(judged):
            self._judge(lesson, elsewhere)

    def add(self, lesson: Lesson, scene: Scene, *, solve: bool) -> int:
        """Index of the scene in the lesson, judged, and solved for the other truth value if asked."""
        left, middle, right = (self.table.index(box) for box in scene.boxes)
        boxes = (left, middle, right)
        index = lesson.known.get(boxes)
        if index is None:
            index = lesson.known[boxes] = len(lesson.scenes)
            lesson.scenes.append(boxes)
            lesson.truths.append(bool(lesson.program(scene)))
            lesson.steps.append(0)
            lesson.actions.append(None)
        if solve and not lesson.steps[index]:
            task = Task("", lesson.statement, lesson.program.source, not lesson.truths[index], scene)
            found = self._solver.optimal_actions(State(task, scene, 0))
            self.sets += 1
            heads = self.layout.head_of[list(found.actions)] if found.actions else np.zeros(0, np.int64)
            if found.steps > 1 and len(heads):
                lesson.steps[index] = found.steps
                lesson.actions[index] = heads
                lesson.with_actions.append(index)
        return index

    def _walk(self, lesson: Lesson, wanted: int) -> None:
        """From a start, randomly edited, along optimal actions until the truth changes."""
        rng = self._rng
        scene = self.start(lesson).permuted(BOX_ORDERS[rng.integers(len(BOX_ORDERS))])
        for _ in range(rng.integers(MOST_RANDOM_EDITS + 1)):
            scene = self.edited(scene)
        for _ in range(self._dynamics.horizon):
            index = self.add(lesson, scene, solve=True)
            actions = lesson.actions[index]
            if actions is None or len(lesson.with_actions) >= wanted:
                return
            truth = lesson.truths[index]
            self.add(lesson, self.edited(scene), solve=False)  # what is near it, whatever its truth
            number = self.layout.action_of[actions[rng.integers(len(actions))]]
            scene, _ = self._appearance.apply(
                scene, self._appearance.decode(int(number)), self._dynamics.rules.placement
            )
            if lesson.truths[self.add(lesson, scene, solve=False)] != truth:
                self.add(lesson, self.edited(scene), solve=False)
                return

    def _judge(self, lesson: Lesson, elsewhere: Sequence[Scene]) -> None:
        """Adds a scene with its truth alone: an edit away from one that is known, or from elsewhere."""
        rng = self._rng
        if elsewhere and rng.random() < 0.5:
            scene = elsewhere[int(rng.integers(len(elsewhere)))]
        else:
            boxes = [self.table.boxes[box] for box in lesson.scenes[rng.integers(len(lesson.scenes))]]
            scene = Scene((boxes[0], boxes[1], boxes[2]))
        if rng.random() < 0.8:
            scene = self.edited(scene)
        self.add(lesson, scene, solve=False)

    def start(self, lesson: Lesson) -> Scene:
        """A start at random."""
        if self._rng.random() < self._empty_starts:
            return Scene.empty()
        return lesson.starts[self._rng.integers(len(lesson.starts))]

    def edited(self, scene: Scene) -> Scene:
        """The scene after a random valid edit: ADD and REMOVE equally likely where both are possible."""
        rng = self._rng
        placement = self._dynamics.rules.placement
        layout = self.layout
        removing = rng.random() < 0.5 and any(box.items for box in scene.boxes)
        for _ in range(100):
            head = 1 + (layout.adds + rng.integers(layout.removes) if removing else rng.integers(layout.adds))
            action = self._appearance.decode(int(layout.action_of[head]))
            after, invalid = self._appearance.apply(scene, action, placement)
            if invalid is None:
                return after
        return scene
