"""What holds after any play under the paper's rules."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lilgym_mp.envs.rules import RULE_SETS
from lilgym_mp.scene import Colour, Scene, Shape, Size
from lilgym_mp.scene.actions import Action, AddBlock, AddItem, RemoveBlock, RemoveItem
from lilgym_mp.scene.appearances import Appearance, PlacementRules, Scatter, Tower
from tests.scenes import SCENES

PAPER = RULE_SETS["paper"].placement
RELEASE = RULE_SETS["release"].placement
GRIDS = [(19, 5), (38, 10), (19, 1), (95, 20), (380, 100)]


class Play(NamedTuple):
    """A start scene and actions, most of them on boxes; each may be invalid."""

    appearance: Appearance
    start: Scene
    actions: list[Action]

    def scenes(self, rules: PlacementRules) -> list[Scene]:
        """The start scene and that after each action."""
        seen = [self.start]
        for action in self.actions:
            seen.append(self.appearance.apply(seen[-1], action, rules).scene)
        return seen

    def permuted(self, order: Sequence[int]) -> Play:
        """The same play in the scene whose box k is this one's box `order[k]`."""
        actions = [_in_other_box(self.appearance, action, order) for action in self.actions]
        return Play(self.appearance, self.start.permuted(order), actions)


def _in_other_box(appearance: Appearance, action: Action, order: Sequence[int]) -> Action:
    if isinstance(action, AddBlock | RemoveBlock):
        return action._replace(box=order.index(action.box))
    assert isinstance(action, AddItem | RemoveItem)
    assert isinstance(appearance, Scatter)
    pitch = 140 // appearance.cell[0]
    box, column = divmod(action.column, pitch)
    return action._replace(column=order.index(box) * pitch + column)


tower_actions = st.builds(AddBlock, st.integers(0, 2), st.sampled_from(Colour)) | st.builds(
    RemoveBlock, st.integers(0, 2)
)


@st.composite
def scatter_actions(draw: st.DrawFn, scatter: Scatter) -> Action:
    """On any cell of a box, ADD three times as often as REMOVE."""
    width, height = scatter.cell
    column = draw(st.integers(0, 2)) * 140 // width + draw(st.integers(0, 100 // width - 1))
    row = draw(st.integers(0, 100 // height - 1))
    if draw(st.integers(0, 3)) == 0:
        return RemoveItem(column, row)
    return AddItem(column, row, draw(st.sampled_from(Shape)), Colour.BLUE, draw(st.sampled_from(Size)))


@st.composite
def plays(draw: st.DrawFn) -> Play:
    name = draw(st.sampled_from(["scatter", "scatter", "tower"]))
    appearance = Tower() if name == "tower" else Scatter(draw(st.sampled_from(GRIDS)))
    actions = tower_actions if name == "tower" else scatter_actions(appearance)
    return Play(appearance, draw(SCENES[name]), draw(st.lists(actions, min_size=1, max_size=12)))


@given(plays())
def test_paper_play__items_stay_in_their_box_and_apart(play: Play):
    for scene in play.scenes(PAPER):
        play.appearance.check_scene(scene)


@given(plays(), st.permutations(range(3)))
def test_paper_play__permuting_the_boxes_commutes_with_it(play: Play, order: list[int]):
    permuted = [scene.permuted(order) for scene in play.scenes(PAPER)]
    assert play.permuted(order).scenes(PAPER) == permuted


@pytest.mark.parametrize("rules", [PAPER, RELEASE], ids=["paper", "release"])
@given(play=plays())
def test_play__a_valid_edit_appends_or_removes_one_item(rules: PlacementRules, play: Play):
    scene = play.start
    for action in play.actions:
        after, invalid = play.appearance.apply(scene, action, rules)
        changed = [(a.items, b.items) for a, b in zip(scene.boxes, after.boxes, strict=True) if a != b]
        assert len(changed) == (0 if invalid else 1)
        for before, now in changed:
            if isinstance(action, AddBlock | AddItem):
                assert now[:-1] == before
                assert now[-1].colour == action.colour
            else:
                assert now in [before[:index] + before[index + 1 :] for index in range(len(before))]
        scene = after
