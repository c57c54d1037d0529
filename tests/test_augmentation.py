"""Augmentations: rewriting, refusals, and commuting with truth values, images and the rules."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from lilgym_mp.corpus import load_tasks
from lilgym_mp.envs.rules import RULE_SETS
from lilgym_mp.learning.common.augmentation import IDENTITY, Augmentation, AugmentationError
from lilgym_mp.programs import compile_program
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Colour, Scene, SceneError, Shape
from lilgym_mp.scene.actions import STOP, AddBlock, AddItem, RemoveBlock, RemoveItem
from lilgym_mp.scene.appearances import Appearance, Scatter, Tower
from lilgym_mp.scene.appearances.placement import check_apart
from lilgym_mp.scene.render import draw
from tests.scenes import LARGE, SCENES, SMALL, B, K, Y, circle, scene, square, tower, triangle

ROTATED = Augmentation((K, B, Y))
ROUND_TO_POINTED = Augmentation(shapes=(Shape.TRIANGLE, Shape.SQUARE, Shape.CIRCLE))
SQUARES_MOVE = Augmentation(shapes=(Shape.SQUARE, Shape.TRIANGLE, Shape.CIRCLE))
MIRRORED = Augmentation(mirrored=True)
BOXES = Augmentation(boxes=(2, 0, 1))
ANY_ITEM = "exist(all_items)"

NOT_BLACK = Task(
    id="1",
    statement="Black? No: a BLUE block.",
    program="AND(NOT(exist(filter_obj(all_items, is_black))), exist(filter_color(all_items, Color.BLUE)))",
    target=False,
    start=scene(tower(B, Y)),
)

# Language


def test_colours__statement_program_and_scene_change_consistently():
    assert ROTATED.task(NOT_BLACK) == Task(
        id="1",
        statement="Blue? No: a YELLOW block.",
        program="AND(NOT(exist(filter_obj(all_items, is_blue))), exist(filter_color(all_items, Color.YELLOW)))",
        target=False,
        start=scene(tower(Y, K)),
    )


CIRCLES = "exist(filter_obj(all_items, is_circle))"
TOWERS = "exist(filter_obj(all_boxes, lambda x: x.is_tower()))"
LEFT_WALL = "exist(filter_obj(all_boxes[0], lambda x: is_touching_wall(x, Side.LEFT)))"
REFUSED = {  # by augmentation: statements and programs
    ROTATED: [  # they name different colours
        ("Not a blak one, but a blue block.", NOT_BLACK.program),
        ("Neither is there.", NOT_BLACK.program),
        ("A black one or a bkack one, but a blue block.", NOT_BLACK.program),
        ("A black one, but ablue block and a blue one.", NOT_BLACK.program),
    ],
    ROUND_TO_POINTED: [  # a word implies a shape
        ("There is a circle on a block.", CIRCLES),
        ("There is a round circle.", CIRCLES),
        ("There is a circle and a cirlce.", CIRCLES),
        ("There is a circle in a gray square.", CIRCLES),
        ("There is a circle on a black box.", CIRCLES),
        ("There is something.", CIRCLES),
    ],
    SQUARES_MOVE: [("Something is stacked.", TOWERS), ("Something is stacked.", "exist(get_above(all_items))")],
    MIRRORED: [  # other uses of "left", and towers
        ("Something lies right on the wall.", "exist(filter_obj(all_items, is_touching_wall))"),
        ("The left box holds something.", "exist(all_boxes[0])"),
        ("In the left box something touches the left wall.", LEFT_WALL),
        ("There is a tower.", TOWERS),
    ],
    BOXES: [  # the program depends on their order
        ("Some box holds something.", program)
        for program in ("exist(all_boxes[1])", "exist(min(all_boxes, key=count))", "exist(all_boxes[0:2])")
    ],
}


@pytest.mark.parametrize(("augmentation", "pair"), [(key, pair) for key, pairs in REFUSED.items() for pair in pairs])
def test_pair__refused_unless_the_meaning_is_known_to_be_the_same(augmentation: Augmentation, pair: tuple[str, str]):
    assert augmentation.pair(*pair) is None
    assert IDENTITY.pair(*pair) == pair


def test_pair__allowed_for_whole_words_and_boxes_that_hold_items():
    assert ROTATED.pair("Blackish bluebells.", ANY_ITEM) == ("Blackish bluebells.", ANY_ITEM)
    program = "exist(filter_obj(all_boxes, lambda x: exist(filter_obj(x.all_items_in_box(), is_circle))))"
    assert ROUND_TO_POINTED.pair("There is a box with a circle.", program) is not None
    assert ROUND_TO_POINTED.pair("Something is stacked.", TOWERS) is not None


def test_shapes__plurals_and_letter_case_are_preserved():
    program = "AND(exist(filter_obj(all_items, is_circle)), exist(filter_shape(all_items, Shape.TRIANGLE)))"
    assert ROUND_TO_POINTED.pair("Circles, and a TRIANGLE?", program) == (
        "Triangles, and a CIRCLE?",
        "AND(exist(filter_obj(all_items, is_triangle)), exist(filter_shape(all_items, Shape.CIRCLE)))",
    )


def test_mirror__swaps_left_and_right_walls():
    program = "exist(filter_obj(all_items, lambda x: is_touching_wall(x, Side.LEFT)))"
    assert MIRRORED.pair("Something touches the left wall.", program) == (
        "Something touches the right wall.",
        "exist(filter_obj(all_items, lambda x: is_touching_wall(x, Side.RIGHT)))",
    )


@pytest.mark.parametrize("fields", [{"colours": (Y, Y, B)}, {"shapes": (Shape.CIRCLE,)}, {"boxes": (0, 1, 3)}])
def test_fields__must_be_permutations(fields: Any):
    (name,) = fields
    with pytest.raises(AugmentationError, match=f"{name} must be a permutation of"):
        Augmentation(**fields)


# Scenes and truth


def test_scene__all_fields_apply():
    everything = Augmentation((K, B, Y), (Shape.TRIANGLE, Shape.CIRCLE, Shape.SQUARE), (2, 0, 1), mirrored=True)
    before = scene([circle(0, 10, LARGE, Y)], [square(80, 80, colour=K)], [triangle(5, 6, SMALL, B)])
    assert everything.scene(before) == scene(
        [square(85, 6, SMALL, Y)], [triangle(70, 10, LARGE, K)], [circle(0, 80, colour=B)]
    )


@st.composite
def augmentations(draw: st.DrawFn) -> Augmentation:
    return random_augmentation(np.random.default_rng(draw(st.integers(0, 10**6))))


def random_augmentation(rng: np.random.Generator) -> Augmentation:
    colours, shapes, boxes = (
        tuple(values[index] for index in rng.permutation(3).tolist())
        for values in (tuple(Colour), tuple(Shape), (0, 1, 2))
    )
    return Augmentation(colours, shapes, boxes, mirrored=bool(rng.integers(2)))


def check_truths(programs: list[tuple[str, str]], scenes: list[Scene]) -> int:
    """Asserts that truth values follow every allowed augmentation; returns how many were not the identity."""
    rng = np.random.default_rng(3)
    count = 0
    for statement, program in programs:
        for _ in range(3):
            augmentation = random_augmentation(rng)
            pair = augmentation.pair(statement, program)
            if pair is not None:
                before, after = compile_program(program), compile_program(pair[1])
                assert [after(augmentation.scene(shown)) for shown in scenes] == [before(shown) for shown in scenes], (
                    augmentation,
                    program,
                )
                count += augmentation != IDENTITY
    return count


def some_scenes(corpus: str, count: int) -> list[Scene]:
    """Random combinations of the boxes in a corpus's start scenes."""
    rng = np.random.default_rng(5)
    scenes: list[Scene] = []
    for appearance in ("tower", "scatter"):
        boxes = [box for task in load_tasks(corpus, appearance, "flipit", "dev") for box in task.start.boxes]
        picks = rng.integers(len(boxes), size=(count, 3)).tolist()
        scenes += [Scene((boxes[a], boxes[b], boxes[c])) for a, b, c in picks]
    return scenes


def pairs_of(corpus: str, split: str) -> list[tuple[str, str]]:
    sets = [load_tasks(corpus, appearance, "scratch", split) for appearance in ("tower", "scatter")]
    return sorted({(task.statement, task.program) for tasks in sets for task in tasks})


def test_builtin_programs__truth_follows_every_allowed_augmentation():
    assert check_truths(pairs_of("builtin", "dev"), some_scenes("builtin", 20)) > 100


@pytest.mark.usefixtures("official_data")
def test_official_programs__truth_follows_every_allowed_augmentation():
    assert check_truths(pairs_of("lilgym", "train")[::4], some_scenes("lilgym", 8)) > 500


def test_task__overlapping_shapes_are_refused():
    start = scene([circle(10, 10, LARGE), circle(36, 36, LARGE)])
    check_apart(start.boxes[0].items)
    assert SQUARES_MOVE.task(Task("1", "Something.", ANY_ITEM, False, start)) is None
    assert ROUND_TO_POINTED.task(Task("1", "Something.", ANY_ITEM, False, scene([circle(0, 0)]))) is not None


def test_task__must_stay_valid_in_the_appearance():
    task = Task("1", "Something.", ANY_ITEM, False, scene(tower(B)))
    assert SQUARES_MOVE.task(task, "tower") is None
    assert MIRRORED.task(task, "tower") == task


# Images


@pytest.mark.parametrize("image_size", ["half", "native"])
@settings(max_examples=30)
@given(augmentation=augmentations(), shown=SCENES["scatter"])
def test_image__equals_the_image_of_the_augmented_scene(image_size: str, augmentation: Augmentation, shown: Scene):
    expected = augmentation.scene(shown)
    try:
        for box in expected.boxes:
            check_apart(box.items)
    except SceneError:
        assume(False)
    image = draw(shown, image_size)
    before = image.copy()
    assert np.array_equal(augmentation.image(image), draw(expected, image_size))
    assert np.array_equal(image, before)


# Actions and the rules


def test_action__permutes_boxes_colours_and_shapes():
    both = Augmentation((K, B, Y), (Shape.TRIANGLE, Shape.SQUARE, Shape.CIRCLE), (2, 0, 1))
    assert both.action(AddBlock(2, Y)) == AddBlock(0, K)
    assert both.action(RemoveBlock(0)) == RemoveBlock(1)
    assert both.action(AddItem(15, 2, Shape.CIRCLE, Y, SMALL)) == AddItem(1, 2, Shape.TRIANGLE, K, SMALL)
    assert both.action(RemoveItem(0, 4)) == RemoveItem(7, 4)
    assert both.action(RemoveItem(6, 4)) == RemoveItem(6, 4)  # a separator
    assert both.action(STOP) == STOP


@pytest.mark.parametrize(("column", "size", "mirrored"), [(0, SMALL, 4), (0, LARGE, 3), (4, LARGE, 4), (8, SMALL, 10)])
def test_action__mirrored_addition_targets_the_cell_of_the_mirrored_corner(column: int, size: Any, mirrored: int):
    action = AddItem(column, 1, Shape.CIRCLE, Y, size)
    assert MIRRORED.action(action) == action._replace(column=mirrored)


@pytest.mark.parametrize("appearance", [Tower(), Scatter(), Scatter((38, 10))], ids=str)
@settings(max_examples=10)
@given(augmentation=augmentations())
def test_action_indices__are_a_permutation_consistent_with_action(appearance: Appearance, augmentation: Augmentation):
    indices = augmentation.action_indices(appearance)
    assert np.array_equal(np.sort(indices), np.arange(appearance.action_count))
    grid = appearance.grid if isinstance(appearance, Scatter) else (19, 5)
    for index in (0, 5, appearance.action_count - 1):
        assert appearance.decode(int(indices[index])) == augmentation.action(appearance.decode(index), grid)


EXACT = [
    (ROTATED, appearance, rules) for appearance in (Tower(), Scatter(), Scatter((380, 100))) for rules in RULE_SETS
] + [
    (BOXES, Tower(), "release"),
    (BOXES, Scatter(), "paper"),
    (BOXES, Scatter((380, 100)), "release"),
    (MIRRORED, Tower(), "paper"),
    (MIRRORED, Scatter((380, 100)), "paper"),
    (ROUND_TO_POINTED, Tower(), "paper"),
]


@pytest.mark.parametrize(("augmentation", "appearance", "rules"), EXACT)
def test_is_exact__augmentation_commutes_with_steps_and_masks(
    augmentation: Augmentation, appearance: Appearance, rules: str
):
    assert augmentation.is_exact(appearance, rules)
    placement = RULE_SETS[rules].placement
    rng = np.random.default_rng(11)
    small = appearance.action_count < 10_000
    indices = augmentation.action_indices(appearance) if small else None
    for _ in range(12):
        before = Scene.empty()
        for _ in range(12):
            other = augmentation.scene(before)
            action = appearance.decode(int(rng.integers(1, appearance.action_count)))
            if indices is not None:
                mask = appearance.legal_mask(before, placement)
                assert np.array_equal(appearance.legal_mask(other, placement)[indices], mask)
                action = appearance.decode(int(rng.choice(np.flatnonzero(mask)[1:])))
            grid = appearance.grid if isinstance(appearance, Scatter) else (19, 5)
            edit = appearance.apply(before, action, placement)
            same = appearance.apply(other, augmentation.action(action, grid), placement)
            assert same.invalid == edit.invalid
            assert same.scene == augmentation.scene(edit.scene)
            before = edit.scene


@pytest.mark.parametrize(
    ("augmentation", "appearance", "rules"),
    [
        (SQUARES_MOVE, Tower(), "paper"),
        (ROUND_TO_POINTED, Scatter(), "paper"),
        (MIRRORED, Scatter(), "paper"),
        (BOXES, Scatter(), "release"),
    ],
)
def test_is_exact__false_for_other_augmentations(augmentation: Augmentation, appearance: Appearance, rules: str):
    assert not augmentation.is_exact(appearance, rules)
