"""Masks that are kept up to date from slots are the appearance's own, whatever became of the boxes in between."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import product
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lilgym_mp.appearances import PlacementRules, Scatter
from lilgym_mp.appearances.legality import allowed_corners
from lilgym_mp.appearances.placement import is_free
from lilgym_mp.envs.cores import compiled_makers
from lilgym_mp.envs.scatter_masks import ScatterMasks
from lilgym_mp.envs.scatter_room import cell_room
from lilgym_mp.envs.scatter_tables import EMPTY_SLOT, PLACE_PITCH, packed
from lilgym_mp.rules import RULE_SETS
from lilgym_mp.scene import BOX_SIDE, Box, Item, Scene
from tests.envs.alike import random_actions
from tests.scenes import LARGE, SMALL, circle, loose_boxes, scatter_boxes, scene, square, triangle

SLOTS = 9
GRIDS = [(19, 5), (38, 10), (95, 4), (19, 2), (38, 1), (76, 50)]
BY_RULES = pytest.mark.parametrize("rules", RULE_SETS)


class Shown:
    """Masks of some environments' scenes, shown one after another."""

    def __init__(self, appearance: Scatter, rules: str, count: int = 1, slots: int = SLOTS) -> None:
        self._slots = slots
        self._appearance = appearance
        self._rules: PlacementRules = RULE_SETS[rules].placement
        compiled = compiled_makers()  # None where the extra numba is not installed
        makers = [ScatterMasks, *([compiled.masks] if compiled else [])]
        # Until they are shown, they may be anything.
        self._masks = [np.ones((count, appearance.action_count), np.bool_) for _ in makers]
        self._kept = [make(appearance, self._rules, masks) for make, masks in zip(makers, self._masks, strict=True)]

    def assert_exact(self, scenes: Sequence[Scene], loose: Iterable[int] = ()) -> None:
        """`loose`: boxes whose items are told otherwise than by slots."""
        boxes = [box for scene in scenes for box in scene.boxes]
        told = {number: boxes[number].items for number in loose}
        wide = np.full((len(boxes), 2 * self._slots), EMPTY_SLOT)
        counts = np.array([7 if number in told else len(box.items) for number, box in enumerate(boxes)])
        for number, box in enumerate(boxes):
            items = (square(3, 3),) * 7 if number in told else box.items  # slots that do not tell of a box may be any
            wide[number, : 2 * len(items) : 2] = slots_of(items)
        for kept, masks in zip(self._kept, self._masks, strict=True):
            kept.refresh(wide[:, ::2], counts, told)
            for mask, shown in zip(masks, scenes, strict=True):
                assert np.array_equal(mask, self._appearance.legal_mask(shown, self._rules))


def slots_of(items: Sequence[Item]) -> Any:
    kinds = np.array([item.kind for item in items], np.int64)
    return packed(kinds, np.array([item.x * PLACE_PITCH + item.y for item in items], np.int64))


def edits_of(box: Box, removed: Sequence[int]) -> list[Box]:
    """The box filled item by item, and emptied again of items at places `removed` of those that are left."""
    boxes = [Box(box.items[:count]) for count in range(len(box.items) + 1)]
    for place in removed[: len(box.items)]:
        boxes.append(boxes[-1].without(place % len(boxes[-1].items)))
    return boxes


@BY_RULES
@pytest.mark.parametrize("grid", GRIDS, ids=str)
def test_masks__are_exact_after_every_edit_of_a_literal_box(grid: tuple[int, int], rules: str) -> None:
    box = Box(
        (circle(40, 40), square(0, 0, LARGE), triangle(70, 70, LARGE), square(90, 0, SMALL), circle(13, 57, SMALL))
    )
    shown = Shown(Scatter(grid), rules)
    for now in edits_of(box, [1, 0, 2, 1, 0]):
        shown.assert_exact([scene([], now.items, [])])


@BY_RULES
@given(data=st.data(), box=scatter_boxes(), removed=st.lists(st.integers(0, 7), min_size=8, max_size=8))
def test_masks__are_exact_after_every_edit(rules: str, data: st.DataObject, box: Box, removed: list[int]) -> None:
    shown = Shown(Scatter(data.draw(st.sampled_from(GRIDS[:3]))), rules)
    for now in edits_of(box, removed):
        shown.assert_exact([scene(now.items)])


@BY_RULES
@given(data=st.data(), boxes=st.lists(scatter_boxes(), min_size=6, max_size=6))
def test_masks__are_exact_after_any_changes(rules: str, data: st.DataObject, boxes: list[Box]) -> None:
    """Each box of two scenes becomes any of the six again and again, or stays."""
    shown = Shown(Scatter(), rules, 2)
    for _ in range(3):
        left, middle, right, *others = data.draw(st.lists(st.sampled_from(boxes), min_size=6, max_size=6))
        shown.assert_exact([Scene((left, middle, right)), Scene(tuple(others))])


@BY_RULES
@given(data=st.data(), boxes=st.lists(loose_boxes, min_size=3, max_size=3), tame=scatter_boxes())
def test_masks__are_exact_of_items_that_overlap_or_lie_outside(
    rules: str, data: st.DataObject, boxes: list[Box], tame: Box
) -> None:
    shown = Shown(Scatter(data.draw(st.sampled_from(GRIDS))), rules)
    left, middle, right = boxes
    shown.assert_exact([Scene((left, middle, tame))], loose=[0, 1])
    shown.assert_exact([Scene((left, right, tame))], loose=[0, 1, 2])
    shown.assert_exact([Scene((tame, right, tame))], loose=[1])
    shown.assert_exact([Scene((tame, tame, tame))])
    shown.assert_exact([Scene((left, tame, tame))], loose=[0])


def test_masks__stay_as_they_are_when_an_item_lies_wholly_outside() -> None:
    shown = Shown(Scatter(), "release")
    for item in (circle(0, -10, SMALL), square(100, 50), triangle(-40, -40)):
        shown.assert_exact([scene()])
        shown.assert_exact([scene([item])], loose=[0])


def test_masks__are_exact_of_boxes_that_hold_one_item() -> None:
    shown = Shown(Scatter(), "paper", slots=1)
    for now in ([circle(40, 40)], [square(0, 0, LARGE)], [], [circle(40, 40)]):
        shown.assert_exact([scene(now, [square(60, 60)])])


@pytest.mark.parametrize("grid", GRIDS, ids=str)
def test_cell_room__has_a_bit_for_each_place_that_an_item_leaves_and_each_part_uncovered(grid: tuple[int, int]) -> None:
    cell = Scatter(grid).cell
    room = cell_room(*cell, searches=True)
    there = square(37, 44, LARGE)
    left = room.left[room.lines.take(room.corners - slots_of([there]))]
    places = np.argwhere(allowed_corners(*cell, searches=True)).tolist()
    free = sum(is_free(kind, x, y, [there]) for kind, x, y in places)
    width, height = cell[0], cell[1] // len(room.corners)
    covered = [
        (x, y)
        for x, y in product(range(0, BOX_SIDE, width), range(0, BOX_SIDE, height))
        if x < 67 and x + width > 37 and y < 74 and y + height > 44
    ]
    assert int(np.bitwise_count(room.empty & left).sum()) == free + room.corners.size - len(covered)


def test_masks__are_exact_of_more_boxes_than_are_looked_at_at_once() -> None:
    chance = np.random.default_rng(0)
    shown = Shown(Scatter(), "paper", 600)
    spots = [(0, 0), (40, 3), (66, 41), (9, 60)]
    for _ in range(2):
        counts = chance.integers(len(spots) + 1, size=(600, 3)).tolist()
        boxes = [[[circle(x, y, LARGE) for x, y in spots[:count]] for count in three] for three in counts]
        shown.assert_exact([scene(*three) for three in boxes])


@BY_RULES
def test_action_masks__of_a_batch_are_exact_throughout_long_random_play(rules: str) -> None:
    env: Any = gym.make_vec("lilgym_mp/ScatterFlipIt-v0", num_envs=64, rules=rules)
    env.reset(seed=0)
    generator = np.random.default_rng(0)
    for step in range(150):
        masks = env.action_masks()
        if step % 10 == 9:
            for mask, state in zip(masks, env.states(), strict=True):
                assert np.array_equal(mask, env.dynamics.legal_mask(state))
        env.step(random_actions(masks, generator))
    env.close()
