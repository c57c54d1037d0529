"""Search for the scene, within reach of edits, where the model is surest that the statement has a truth value.

Tower: from the start and the best scenes so far, every box is replaced by any other, three times over. Scatter: from a
few best scenes, every ADD and REMOVE, and pairs of the best of them, are judged by the change of the sums that they
cause; the best are made by the rules. Progress is measured in logits, the choice by mean probabilities.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations_with_replacement
from typing import NamedTuple, cast

import numpy as np
import torch
from torch import Tensor

from lilgym_mp.envs.rules import Dynamics
from lilgym_mp.learning.common.planning import Plan, Planner
from lilgym_mp.learning.reward_model.features import (
    InputReader,
    look_counts,
    scatter_box_features,
    scatter_item_features,
)
from lilgym_mp.learning.reward_model.learner import RewardModelRecipe
from lilgym_mp.learning.reward_model.network import BoxFeatures, ModulatedNetwork, sum_boxes
from lilgym_mp.scene import BOX_COUNT, Colour, Scene
from lilgym_mp.scene.actions import STOP, Action, AddBlock, RemoveBlock
from lilgym_mp.scene.appearances import Scatter, part_of
from lilgym_mp.scene.appearances.tower.geometry import every_box, tower_tables
from lilgym_mp.scene.arrays import Float64Array, Int64Array
from lilgym_mp.solver.canonical_items import canonical_items
from lilgym_mp.solver.edit_tables import addition_actions, addition_table, removal_actions, removal_table

TOWER_ROUNDS = 3
FINALISTS = 200  # Tower scenes whose probability is averaged over exchanges
SURE = 0.995  # mean probability with which a search in Scatter ends
MACRO_PARTS = 10  # best single edits of a scene that are combined to pairs


class Judge:
    """The model's opinion of scenes for one statement, made true or false, under at most `exchanges` exchanges, E."""

    def __init__(
        self, network: ModulatedNetwork, reader: InputReader, statement: str, exchanges: int, *, target: bool
    ) -> None:
        self.network = network
        self.reader = reader
        self._sign = 1.0 if target else -1.0
        kinds = reader.kinds(statement)[:exchanges]
        self.reading = network.read(*reader.statements([statement] * len(kinds), kinds))

    def logits(self, sums: Tensor) -> Tensor:
        """(E, N) of success, from values (E, N, 2 (d + k)) summed over boxes, or those of the first exchanges."""
        return self._sign * self.network.logits(self.reading.first(len(sums)), sums)

    def scene_logits(self, scenes: Sequence[Scene]) -> Tensor:
        """(E, N) of success."""
        indices = np.array([self.reader.table.of(scene) for scene in scenes])
        _, values = self.box_values(indices.ravel())
        return self.logits(values.unflatten(1, (-1, BOX_COUNT)).sum(2))

    def box_values(self, indices: Int64Array) -> tuple[Tensor, Tensor]:
        """(E, U, d + k) item sums of boxes and (E, U, 2 (d + k)) their values."""
        features = self.reader.boxes(indices[None])
        sums = self.network.item_sums(self.reading, features)
        return sums, self.network.box_values(self.reading, sums, features.looks)


@dataclass
class SearchPlanner(Planner):
    """Plans for statements in one configuration."""

    network: ModulatedNetwork
    reader: InputReader
    dynamics: Dynamics
    recipe: RewardModelRecipe
    is_flipit: bool  # a start is never solved: STOP is no plan there

    def plan(self, scene: Scene, statement: str, target: bool, steps: int = 0) -> Plan:
        return self.plans(scene, statement, target, steps)[0]

    @torch.inference_mode()
    def plans(self, scene: Scene, statement: str, target: bool, steps: int = 0, most: int = 1) -> list[Plan]:
        """The best plan, then others that are as short and whose probability is less lower than an edit is worth."""
        table = self.reader.renewed_table()
        judge = Judge(self.network, self.reader, statement, self.recipe.averaged_exchanges, target=target)
        most_edits = max(0, self.dynamics.horizon - 1 - steps)
        may_stop = not self.is_flipit or steps > 0
        search = part_of(table.appearance, "search with a reward model", SEARCHES)(judge, self.dynamics, self.recipe)
        plans = search.plans(scene, most_edits, most, may_stop=may_stop)
        lowest = plans[0].success_probability - self.recipe.edit_cost
        return [
            plan for plan in plans if len(plan.actions) == len(plans[0].actions) and plan.success_probability >= lowest
        ]


# Tower


def _box_edits(index: int, before: int, after: int) -> list[Action]:
    colours = tower_tables().colours
    heights = tower_tables().heights
    kept = (heights[before] + heights[after] - every_box().distances[before, after]) // 2
    removals: list[Action] = [RemoveBlock(index)] * int(heights[before] - kept)
    return [*removals, *(AddBlock(index, Colour(int(colours[after, level]))) for level in range(kept, heights[after]))]


class _TowerSearch:
    """Every box is replaced by any other, from the start and the best scenes so far."""

    def __init__(self, judge: Judge, dynamics: Dynamics, recipe: RewardModelRecipe) -> None:
        self._judge = judge
        self._recipe = recipe

    def plans(self, scene: Scene, most_edits: int, most: int, *, may_stop: bool) -> list[Plan]:
        start = self._judge.reader.table.of(scene)
        distances = every_box().distances[list(start)]  # (3, 121)
        boxes = distances.shape[1]
        _, values = self._judge.box_values(np.arange(boxes))

        def edits_to(scenes: Int64Array) -> Int64Array:
            return distances[np.arange(BOX_COUNT), scenes].sum(1)

        beam = np.array([start], np.int64)
        known = beam
        for _ in range(TOWER_ROUNDS):
            found = np.repeat(beam, BOX_COUNT * boxes, axis=0).reshape(len(beam), BOX_COUNT, boxes, BOX_COUNT)
            for index in range(BOX_COUNT):
                found[:, index, :, index] = np.arange(boxes)
            candidates = _distinct(found.reshape(-1, BOX_COUNT), distances, most_edits)
            first = values[:1], torch.from_numpy(candidates)[None]
            scores = self._judge.logits(sum_boxes(*first))[0].numpy() - self._recipe.edit_cost * edits_to(candidates)
            best = np.argsort(-scores, kind="stable")
            beam = candidates[best[: self._recipe.beam]]
            known = np.concatenate([known, candidates[best[:FINALISTS]]])
        if not may_stop:
            known = known[edits_to(known) > 0]
        if not len(known):
            return [Plan((STOP,), 0.0)]
        probabilities = mean_probabilities(
            self._judge.logits(sum_boxes(values, torch.from_numpy(known).expand(len(values), -1, -1)))
        )
        order = np.argsort(self._recipe.edit_cost * edits_to(known) - probabilities, kind="stable")

        def edits(goal: Sequence[int]) -> Iterator[Action]:
            for index, (before, after) in enumerate(zip(start, goal, strict=True)):
                yield from _box_edits(index, before, after)

        return [Plan((*edits(known[one].tolist()), STOP), float(probabilities[one])) for one in order[:most].tolist()]


def _distinct(scenes: Int64Array, distances: Int64Array, most_edits: int) -> Int64Array:
    """The scenes within `most_edits`, the nearest of those that differ in the order of boxes only."""
    edits = distances[np.arange(BOX_COUNT), scenes].sum(1)
    scenes = scenes[edits <= most_edits]
    edits = edits[edits <= most_edits]
    order = np.argsort(edits, kind="stable")
    keys = np.sort(scenes[order], axis=1) @ np.array([1 << 16, 1 << 8, 1])
    _, first = np.unique(keys, return_index=True)
    return scenes[order[first]]


# Scatter


class _Node(NamedTuple):
    """A scene that the search has reached."""

    scene: Scene
    actions: tuple[int, ...]
    logit: float
    probability: float


class _Edit(NamedTuple):
    """The addition of a canonical item to a box, or the removal of one of its items."""

    box: int
    canonical: int  # -1: a removal
    position: int


class _ScatterSearch:
    def __init__(self, judge: Judge, dynamics: Dynamics, recipe: RewardModelRecipe) -> None:
        self._judge = judge
        self._dynamics = dynamics
        self._recipe = recipe
        self._scatter = cast("Scatter", dynamics.appearance)
        self._table = judge.reader.table
        self._added = judge.network.item_units(judge.reading, _canonical()[0][None])  # (E, 1323, d + k)

    def plans(self, scene: Scene, most_edits: int, most: int, *, may_stop: bool) -> list[Plan]:
        start = self._nodes([(scene, ())])[0]
        beam = [start]
        reached = {scene: start}
        for _ in range(most_edits):
            wanted = sorted((one for node in beam for one in self._expanded(node, most_edits)), key=lambda one: -one[0])
            made: dict[Scene, tuple[int, ...]] = {}
            for _, node, edits in wanted:
                after = self._made(node, edits)
                if after is not None and after[0] not in reached:
                    made.setdefault(*after)
                if len(made) >= self._recipe.beam:
                    break
            nodes = self._nodes(list(made.items()))
            reached.update((node.scene, node) for node in nodes)
            beam = sorted(nodes, key=lambda node: -node.logit)
            if not beam or max(node.probability for node in nodes) > SURE:
                break
        choices = [node for node in reached.values() if may_stop or node.actions]
        if not choices:
            return [Plan((STOP,), 0.0)]
        choices.sort(key=lambda node: self._recipe.edit_cost * len(node.actions) - node.probability)
        return [Plan((*map(self._scatter.decode, node.actions), STOP), node.probability) for node in choices[:most]]

    def _nodes(self, scenes: Sequence[tuple[Scene, tuple[int, ...]]]) -> list[_Node]:
        """The scenes with their exact values."""
        if not scenes:
            return []
        logits = self._judge.scene_logits([scene for scene, _ in scenes])
        means = logits.mean(0).tolist()
        probabilities = mean_probabilities(logits).tolist()
        return [_Node(*one) for one in zip(*zip(*scenes, strict=True), means, probabilities, strict=True)]

    def _expanded(self, node: _Node, most_edits: int) -> list[tuple[float, _Node, tuple[_Edit, ...]]]:
        """Single edits and pairs of the best of them, with the logits that the changed sums give."""
        left = most_edits - len(node.actions)
        if left <= 0:
            return []
        judge = self._judge
        edits = [edit for index in range(BOX_COUNT) for edit in self._edits(node.scene, index)]
        indices = np.array(self._table.of(node.scene))
        sums, values = judge.box_values(indices)
        looks = np.concatenate(
            [look_counts(np.array(box.items, np.int64).reshape(1, -1, 5)) for box in node.scene.boxes]
        )
        change, look_change = self._changes(node.scene, edits, judge.reader.boxes(indices[None]))
        box = np.array(edits)[:, 0]

        def scores(*parts: tuple[Int64Array, ...]) -> Float64Array:
            """Mean logits after some edits, of a box each part."""
            total = values.sum(1, keepdim=True)
            for part in parts:
                at = box[part[0]]
                box_sums = sums[:, at] + sum(change[:, index] for index in part)
                after = looks[at] + sum(look_change[index] for index in part)
                features = torch.from_numpy(scatter_box_features(after)).float()[None]
                total = total - values[:, at] + judge.network.box_values(judge.reading, box_sums, features)
            return judge.logits(total).mean(0).double().numpy()

        single = scores((np.arange(len(edits)),))
        most = 4 * self._recipe.beam
        wanted = [(float(single[at]), node, (edits[at],)) for at in np.argsort(-single)[:most]]
        if left < 2:
            return wanted
        pairs = combinations_with_replacement(np.argsort(-single)[:MACRO_PARTS].tolist(), 2)
        pairs = [  # two removals from a box would change positions
            (at, other)
            for at, other in pairs
            if edits[at].box != edits[other].box or min(edits[at].canonical, edits[other].canonical) >= 0
        ]
        one, two = np.array(pairs, np.int64).reshape(-1, 2).T
        double = np.where(box[one] == box[two], scores((one, two)), scores((one,), (two,)))
        order = np.argsort(-double)[:most].tolist()
        return wanted + [(float(double[at]), node, tuple(edits[edit] for edit in pairs[at])) for at in order]

    def _changes(self, scene: Scene, edits: Sequence[_Edit], features: BoxFeatures) -> tuple[Tensor, Int64Array]:
        """The changes of a box's item sums (E, n, d + k) and looks (n, 9) by each edit; `features` of the scene's."""
        box, canonical, position = np.array(edits).T
        is_removal = canonical < 0
        change = self._added[:, canonical.clip(0)]
        look_change = _canonical()[1][canonical.clip(0)]
        if is_removal.any():
            units = self._judge.network.item_units(self._judge.reading, features.items)
            removed_items = features.members[0, box[is_removal], position[is_removal]]
            change[:, torch.from_numpy(is_removal)] = -units[:, removed_items]
            removed = [scene.boxes[edit.box].items[edit.position] for edit in edits if edit.canonical < 0]
            look_change[is_removal] = -look_counts(np.array(removed)[:, None])
        return change, look_change

    def _edits(self, scene: Scene, index: int) -> list[_Edit]:
        """One addition for each canonical item that the rules allow, and every possible removal."""
        items = scene.boxes[index].items
        placement = self._dynamics.rules.placement
        canonical = addition_table(self._scatter, placement, index, items).canonical
        additions = [_Edit(index, one, -1) for one in np.unique(canonical[canonical >= 0]).tolist()]
        positions = removal_table(self._scatter, items)
        return additions + [_Edit(index, -1, one) for one in np.unique(positions[positions >= 0]).tolist()]

    def _made(self, node: _Node, edits: Sequence[_Edit]) -> tuple[Scene, tuple[int, ...]] | None:
        """The scene after the edits, by the rules, and the actions so far; None if one has become impossible."""
        scene = node.scene
        actions = node.actions
        for edit in edits:
            action = self._action(scene, edit)
            if action is None:
                return None
            after, invalid = self._scatter.apply(scene, self._scatter.decode(action), self._dynamics.rules.placement)
            if invalid is not None:
                return None
            scene = after
            actions = (*actions, action)
        return scene, actions

    def _action(self, scene: Scene, edit: _Edit) -> int | None:
        items = scene.boxes[edit.box].items
        placement = self._dynamics.rules.placement
        if edit.canonical < 0:
            actions = removal_actions(self._scatter, edit.box, items, edit.position)
        else:
            table = addition_table(self._scatter, placement, edit.box, items)
            actions = addition_actions(self._scatter, edit.box, np.flatnonzero(table.canonical == edit.canonical))
        return actions[0] if actions else None


SEARCHES = {"tower": _TowerSearch, "scatter": _ScatterSearch}


@cache
def _canonical() -> tuple[Tensor, Int64Array]:
    """Features (1323, F) and look counts (1323, 9) of canonical items."""
    items = np.array(canonical_items())
    return torch.from_numpy(scatter_item_features(items)).float(), look_counts(items[:, None])


def mean_probabilities(logits: Tensor) -> Float64Array:
    """(N,) from (E, N)."""
    return torch.sigmoid(logits).mean(0).double().numpy()
