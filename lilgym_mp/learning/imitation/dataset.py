"""The aggregated dataset (DAgger): statements with scenes labelled with truth and the expert's optimal actions."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from lilgym_mp.corpus.matching import BOX_ORDERS
from lilgym_mp.corpus.tokens import words
from lilgym_mp.envs.rules import Dynamics, State
from lilgym_mp.learning.common.augmentation import recolourable
from lilgym_mp.learning.common.labelled_scenes import Boxes, LabelledStatement, Rng
from lilgym_mp.learning.common.tasks import choose_held_out
from lilgym_mp.learning.imitation.action_heads import ActionHeads, action_heads
from lilgym_mp.learning.imitation.box_features import BoxFeatureTable
from lilgym_mp.programs import Program, compile_program
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.scene.arrays import Int64Array
from lilgym_mp.scene.grouping import grouped
from lilgym_mp.solver import Solver

MAX_RANDOM_EDITS = 3


@dataclass(kw_only=True)
class DatasetEntry(LabelledStatement):
    """One statement and the scenes labelled for it so far: M scenes, some of them with optimal actions."""

    program: Program
    starts: tuple[Scene, ...]
    exchanges_colours: bool  # in words and scenes alike
    steps: list[int] = field(default_factory=list)  # length of a shortest solution; 0 without optimal actions
    actions: list[Int64Array | None] = field(default_factory=list)  # logit indices of the optimal actions
    with_actions: list[int] = field(default_factory=list)  # indices of the scenes with optimal actions

    def add(self, boxes: Boxes, *, truth: bool) -> int:
        self.steps.append(0)
        self.actions.append(None)
        return super().add(boxes, truth=truth)


def entries_from_tasks(tasks: Iterable[Task], *, reads_programs: bool = True) -> list[DatasetEntry]:
    """One entry per statement and program, with its tasks; unless the programs may be read, all exchange colours."""
    groups = grouped(((task.statement, task.program), task) for task in tasks)
    return [
        DatasetEntry(
            statement=statement,
            tasks=group,
            program=compile_program(program),
            starts=tuple(dict.fromkeys(task.start for task in group)),
            exchanges_colours=not reads_programs or recolourable(statement, program),
        )
        for (statement, program), group in groups.items()
    ]


def split_held_out(entries: Sequence[DatasetEntry], fraction: float) -> tuple[list[DatasetEntry], list[DatasetEntry]]:
    """Training and held-out entries, split by statement so that no statement is in both."""
    held_out = choose_held_out(sorted({words(entry.statement) for entry in entries}), fraction)
    parts = grouped((words(entry.statement) in held_out, entry) for entry in entries)
    return parts.get(False, []), parts.get(True, [])


class DataCollector:
    """Adds labelled scenes to entries: perturbed start scenes, expert trajectories from them, and their neighbours."""

    def __init__(
        self,
        dynamics: Dynamics,
        table: BoxFeatureTable,
        rng: Rng,
        budget: int | None = None,
        empty_start_fraction: float = 0.0,
    ) -> None:
        """`budget`: scenes the solver expands per query, at most."""
        self.table = table
        self.rng = rng
        self.heads: ActionHeads = action_heads(dynamics.appearance)
        self.expert_queries = 0
        self._dynamics = dynamics
        self._appearance = dynamics.appearance
        self._solver = Solver(dynamics, budget)
        self._empty_start_fraction = empty_start_fraction

    def collect(self, entry: DatasetEntry, solved: int, truth_only: int, other_scenes: Sequence[Scene]) -> None:
        """Adds about `solved` scenes with optimal actions, and `truth_only` with truth labels alone."""
        enough = len(entry.with_actions) + solved
        for _ in range(4 * solved):  # some scenes are known already, some cannot be solved
            if len(entry.with_actions) >= enough:
                break
            self._add_trajectory(entry, enough)
        for _ in range(truth_only):
            self._add_truth_label(entry, other_scenes)

    def add(self, entry: DatasetEntry, scene: Scene, *, solve: bool) -> int:
        """Adds the scene with its truth, and with `solve` the optimal actions towards the opposite truth value.

        Returns the scene's index in the entry.
        """
        boxes = self.table.of(scene)
        index = entry.index.get(boxes)
        if index is None:
            index = entry.add(boxes, truth=entry.program(scene))
        if solve and not entry.steps[index]:
            task = Task("", entry.statement, entry.program.source, not entry.truths[index], scene)
            optimal = self._solver.optimal_actions(State(task, scene, 0))
            self.expert_queries += 1
            logit_indices = self.heads.index_of[list(optimal.actions)] if optimal.actions else np.zeros(0, np.int64)
            if optimal.steps > 1 and len(logit_indices):
                entry.steps[index] = optimal.steps
                entry.actions[index] = logit_indices
                entry.with_actions.append(index)
        return index

    def task(self, entry: DatasetEntry) -> Task:
        """A task to be played by the network."""
        start = self.start(entry)
        return Task("", entry.statement, entry.program.source, not entry.program(start), start)

    def add_last_scenes(self, entry: DatasetEntry, task: Task, scenes: Sequence[Scene], count: int) -> None:
        """Adds the last scenes of the network's episode with optimal actions."""
        for scene in dict.fromkeys(scenes[-count:]):
            self.add(entry, scene, solve=True)

    def _add_trajectory(self, entry: DatasetEntry, enough: int) -> None:
        """Adds the scenes from a randomly edited start along optimal actions until the truth changes."""
        rng = self.rng
        scene = self.start(entry).permuted(BOX_ORDERS[rng.integers(len(BOX_ORDERS))])
        for _ in range(rng.integers(MAX_RANDOM_EDITS + 1)):
            scene = self.edited(scene)
        for _ in range(self._dynamics.horizon):
            index = self.add(entry, scene, solve=True)
            actions = entry.actions[index]
            if actions is None or len(entry.with_actions) >= enough:
                return
            truth = entry.truths[index]
            self.add(entry, self.edited(scene), solve=False)  # a neighbour of either truth value
            action = self.heads.action_of[actions[rng.integers(len(actions))]]
            scene, _ = self._appearance.apply(
                scene, self._appearance.decode(int(action)), self._dynamics.rules.placement
            )
            if entry.truths[self.add(entry, scene, solve=False)] != truth:
                self.add(entry, self.edited(scene), solve=False)
                return

    def _add_truth_label(self, entry: DatasetEntry, other_scenes: Sequence[Scene]) -> None:
        """Adds a scene with its truth alone: a known one or one of `other_scenes`, usually edited once."""
        rng = self.rng
        if other_scenes and rng.random() < 0.5:
            scene = other_scenes[int(rng.integers(len(other_scenes)))]
        else:
            scene = self.table.scene(entry.scenes[rng.integers(len(entry.scenes))])
        if rng.random() < 0.8:
            scene = self.edited(scene)
        self.add(entry, scene, solve=False)

    def start(self, entry: DatasetEntry) -> Scene:
        """A random start scene of the entry, or the empty scene."""
        if self.rng.random() < self._empty_start_fraction:
            return Scene.empty()
        return entry.starts[self.rng.integers(len(entry.starts))]

    def edited(self, scene: Scene) -> Scene:
        """The scene after a random legal edit: ADD or REMOVE with equal probability where both are possible."""
        rng = self.rng
        heads = self.heads
        removing = rng.random() < 0.5 and any(box.items for box in scene.boxes)
        first, count = (heads.add_count, heads.remove_count) if removing else (0, heads.add_count)
        for _ in range(100):
            action = self._appearance.decode(int(heads.action_of[1 + first + rng.integers(count)]))
            after, invalid = self._appearance.apply(scene, action, self._dynamics.rules.placement)
            if invalid is None:
                return after
        return scene
