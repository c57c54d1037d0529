"""Expert iteration: imitation of a reward model's search instead of the expert's solutions.

It learns from rewards and the rules of editing. A scene's truth is known from the outcome of a counted STOP, and a plan
of the search is imitated if a STOP confirms it.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np

from lilgym_mp.envs.rules import Dynamics
from lilgym_mp.learning.common.agents import Agent, AgentError, open_agent
from lilgym_mp.learning.common.labelled_scenes import Collector, Rng
from lilgym_mp.learning.common.planning import Planner
from lilgym_mp.learning.imitation.box_features import BoxFeatureTable
from lilgym_mp.learning.imitation.dataset import DataCollector, DatasetEntry
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import Action, AddItem
from lilgym_mp.scene.appearances import Scatter, part_of
from lilgym_mp.scene.appearances.scatter.actions import remove_index
from lilgym_mp.solver.edit_tables import addition_actions, addition_table, removal_table

STOPS_PER_LABEL = 3  # scenes stopped in for each scene with truth alone that is asked for
MOST_PLANS = 6  # for a scene, as short as the best and nearly as sure


def open_teacher(run: Path) -> Agent:
    """Raises AgentError if the run is not a reward model's."""
    agent = open_agent(run)
    if not agent.teaches:
        raise AgentError(f"{run}: a teacher must be a run of reward-model, not of {agent.description.kind}")
    return agent


class TaughtCollector(DataCollector):
    """Collects scenes in episodes of its own, with the search's plans from them."""

    def __init__(self, planner: Planner, table: BoxFeatureTable, rng: Rng) -> None:
        super().__init__(planner.dynamics, table, rng)
        self._planner = planner
        self.played = Collector(planner.dynamics, table, rng)

    def collect(self, entry: DatasetEntry, solved: int, truth_only: int, other_scenes: Sequence[Scene]) -> None:
        self.played.rng = self.rng
        self.played.explore(entry, STOPS_PER_LABEL * truth_only)
        enough = len(entry.with_actions) + solved
        for _ in range(2 * solved):
            if len(entry.with_actions) < enough:
                self._teach(entry, self.played.begin(entry))

    def task(self, entry: DatasetEntry) -> Task:
        return entry.tasks[entry.random_task(self.rng)]

    def add_last_scenes(self, entry: DatasetEntry, task: Task, scenes: Sequence[Scene], count: int) -> None:
        self.played.steps += len(scenes)
        for steps in range(len(scenes))[-count:]:
            self._teach(entry, self.played.stop(entry, entry.tasks.index(task), scenes[steps], steps))

    def _teach(self, entry: DatasetEntry, index: int) -> None:
        """Adds the actions of confirmed plans from a known scene to the opposite truth value."""
        truth = entry.truths[index]
        steps = entry.paths[index].edits
        scene = self.table.scene(entry.scenes[index])
        plans = self._planner.plans(scene, entry.statement, not truth, steps, MOST_PLANS)
        self.expert_queries += 1
        for plan in plans:
            indices = self.played.follow(entry, index, plan.actions)
            solved = [entry.truths[at] != truth for at in indices]
            if True in solved:
                edits = plan.actions[: solved.index(True)]
                for first, at in enumerate(indices[: len(edits)]):
                    self._add_actions(entry, at, edits[first:])

    def _add_actions(self, entry: DatasetEntry, index: int, edits: Sequence[Action]) -> None:
        """Adds the edits that may come first; those of a shorter solution replace what was known."""
        steps = len(edits) + 1
        if 0 < entry.steps[index] < steps:
            return
        if not entry.steps[index]:
            entry.with_actions.append(index)
        scene = self.table.scene(entry.scenes[index])
        found = self.heads.index_of[sorted(first_edits(self._planner.dynamics, scene, edits))]
        before = entry.actions[index] if entry.steps[index] == steps else None
        entry.steps[index] = steps
        entry.actions[index] = found[found >= 0] if before is None else np.union1d(before, found[found >= 0])


def first_edits(dynamics: Dynamics, scene: Scene, edits: Sequence[Action]) -> set[int]:
    """Action indices: those of the edits that may be made first, and of others that give an equivalent scene."""
    goal = _after(dynamics, scene, edits)
    found: set[int] = set()
    for position, edit in enumerate(edits):
        if position == 0 or _after(dynamics, scene, (edit, *edits[:position], *edits[position + 1 :])) == goal:
            find = part_of(dynamics.appearance.name, "equivalent edits for imitation", EQUIVALENT)
            found.update(find(dynamics, scene, edit))
    return found


def _after(dynamics: Dynamics, scene: Scene, edits: Sequence[Action]) -> Scene | None:
    """The scene after the edits; None if one is invalid."""
    for edit in edits:
        scene, invalid = dynamics.appearance.apply(scene, edit, dynamics.rules.placement)
        if invalid is not None:
            return None
    return scene


def _equivalent_blocks(dynamics: Dynamics, scene: Scene, edit: Any) -> list[int]:
    """Edits of boxes equal to the edit's that do the same to them."""
    equal = [other for other, box in enumerate(scene.boxes) if box == scene.boxes[edit.box]]
    return [dynamics.appearance.encode(edit._replace(box=other)) for other in equal]


def _equivalent_items(dynamics: Dynamics, scene: Scene, edit: Any) -> list[int]:
    """Edits of boxes equal to the edit's that do the same to them, as far as the features tell."""
    placement = dynamics.rules.placement
    scatter = cast("Scatter", dynamics.appearance)
    is_addition = isinstance(edit, AddItem)
    action = scatter.encode(edit)

    def results(index: int) -> tuple[np.ndarray, np.ndarray]:
        """The actions on a box, and what each does to it, negative if nothing."""
        items = scene.boxes[index].items
        if is_addition:
            done = addition_table(scatter, placement, index, items).canonical
            return np.array(addition_actions(scatter, index, np.arange(len(done)))), done
        done = removal_table(scatter, items)
        return np.arange(len(done)) + remove_index(scatter.box_cells[index].start, scatter.cell_count), done

    found = {index: results(index) for index in range(len(scene.boxes))}
    index, wanted = next(
        (index, done[actions == action]) for index, (actions, done) in found.items() if action in actions
    )
    equal = [other for other, box in enumerate(scene.boxes) if box == scene.boxes[index]]
    return [one for other in equal for one in found[other][0][found[other][1] == wanted].tolist()]


EQUIVALENT = {"tower": _equivalent_blocks, "scatter": _equivalent_items}
