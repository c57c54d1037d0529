"""Tower: what each action makes of a stack, and which start scenes are refused."""

from __future__ import annotations

import pytest

from lilgym_mp.envs.rules import RULE_SETS
from lilgym_mp.scene import Colour, Item, SceneError, Shape, Size
from lilgym_mp.scene.actions import STOP, ActionError, AddBlock, AddItem, RemoveBlock
from lilgym_mp.scene.appearances import InvalidReason, Tower
from tests.scenes import LARGE, SMALL, B, K, Y, circle, scene, square, tower

TOWER = Tower()
PLACEMENT = RULE_SETS["paper"].placement


def test_add__blocks_stack_from_the_bottom_21_pixels_apart():
    grown = scene()
    for level, (y, colour) in enumerate(zip((80, 59, 38, 17), (Y, K, B, K), strict=True)):
        grown = TOWER.apply(grown, AddBlock(1, colour), PLACEMENT).scene
        assert grown.boxes[1].items[level] == Item(40, y, Shape.SQUARE, colour, Size.MEDIUM)
        assert len(grown.boxes[1].items) == level + 1


@pytest.mark.parametrize("colour", Colour)
def test_add__a_fifth_block_is_invalid(colour: Colour):
    full = scene([], [], tower(Y, Y, Y, Y))
    edit = TOWER.apply(full, AddBlock(2, colour), PLACEMENT)
    assert edit.invalid is InvalidReason.FULL_TOWER
    assert edit.scene is full


def test_remove__an_empty_box_is_invalid():
    before = scene([], tower(K))
    edit = TOWER.apply(before, RemoveBlock(0), PLACEMENT)
    assert edit.invalid is InvalidReason.EMPTY_TOWER
    assert edit.scene is before


def test_apply__anything_but_an_edit_of_tower_raises_action_error():
    for action in (STOP, AddItem(0, 0, Shape.SQUARE, B, Size.MEDIUM)):
        with pytest.raises(ActionError, match=r"is not an edit of tower"):
            TOWER.apply(scene(), action, PLACEMENT)


def test_check_scene__towers_pass_unchanged():
    start = scene(tower(Y, K, B, Y), [], tower(B))
    assert TOWER.check_scene(start) == start


@pytest.mark.parametrize(
    ("items", "message"),
    [
        ([*tower(Y, Y, Y, Y), square(40, 0)], r"a tower holds at most 4 blocks, not 5"),
        ([circle(40, 80)], r"item 0 must be a medium square at \(40, 80\) to stack, not a medium circle at \(40, 80\)"),
        ([square(40, 80, SMALL)], r"item 0 must be .* not a small square at \(40, 80\)"),
        ([square(40, 70, LARGE)], r"item 0 must be .* not a large square at \(40, 70\)"),
        ([square(41, 80)], r"item 0 must be .* not a medium square at \(41, 80\)"),
        ([square(40, 59)], r"item 0 must be .* not a medium square at \(40, 59\)"),
        ([square(40, 80), square(40, 60)], r"item 1 must be a medium square at \(40, 59\) to stack, .*\(40, 60\)"),
        (tower(Y, K)[::-1], r"item 0 must be .* not a medium square at \(40, 59\)"),
    ],
)
def test_check_scene__anything_but_a_tower_is_refused_naming_box_and_item(items: list[Item], message: str):
    with pytest.raises(SceneError, match=f"^box 2: {message}"):
        TOWER.check_scene(scene([], tower(Y), items))
