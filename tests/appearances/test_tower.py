"""Tower: what each action makes of a stack, and which start scenes are refused."""

import pytest

from lilgym_mp.envs.rules import RULE_SETS
from lilgym_mp.scene import Item, SceneError, Shape, Size
from lilgym_mp.scene.actions import STOP, ActionError, AddBlock, AddItem, RemoveBlock
from lilgym_mp.scene.appearances import InvalidReason, Tower
from tests.scenes import B, K, Y, items_of, scene, scene_of, tower

TOWER = Tower()
PLACEMENT = RULE_SETS["paper"].placement


def test_add__blocks_stack_from_the_bottom_21_pixels_apart():
    grown = scene()
    for level, (y, colour) in enumerate(zip((80, 59, 38, 17), (Y, K, B, K), strict=True)):
        grown = TOWER.apply(grown, AddBlock(1, colour), PLACEMENT).scene
        assert grown.boxes[1].items[level] == Item(40, y, Shape.SQUARE, colour, Size.MEDIUM)
        assert len(grown.boxes[1].items) == level + 1


def test_edit__of_a_full_or_an_empty_tower_is_invalid():
    before = scene_of("tower k | | tower yyyy")
    assert TOWER.apply(before, AddBlock(2, B), PLACEMENT) == (before, InvalidReason.FULL_TOWER)
    assert TOWER.apply(before, RemoveBlock(1), PLACEMENT) == (before, InvalidReason.EMPTY_TOWER)


def test_apply__anything_but_an_edit_of_tower_raises_action_error():
    for action in (STOP, AddItem(0, 0, Shape.SQUARE, B, Size.MEDIUM)):
        with pytest.raises(ActionError, match=r"is not an edit of tower"):
            TOWER.apply(scene(), action, PLACEMENT)


@pytest.mark.parametrize(
    ("items", "message"),
    [
        ("tower yyyy; square 40,0", "at most 4 blocks, not 5"),
        ("circle 40,80", r"item 0 must be a medium square at \(40, 80\) to stack, not a medium circle at \(40, 80\)"),
        ("square 40,80 small", r"item 0 .* not a small square at \(40, 80\)"),
        ("square 41,80", r"item 0 .* not a medium square at \(41, 80\)"),
        ("square 40,59", r"item 0 .* not a medium square at \(40, 59\)"),
        ("square 40,80; square 40,60", r"item 1 must be a medium square at \(40, 59\) .*\(40, 60\)"),
    ],
)
def test_check_scene__anything_but_a_tower_is_refused_naming_box_and_item(items, message):
    with pytest.raises(SceneError, match=f"^box 2: .*{message}"):
        TOWER.check_scene(scene([], tower(Y), items_of(items)))
