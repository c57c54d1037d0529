"""Reconstructing scenes from images: exact for scenes of play and corpora, an error for images of no scene."""

import random
from contextlib import suppress
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lilgym_mp.corpus import load_tasks
from lilgym_mp.corpus.scene_walks import ScenePool
from lilgym_mp.perception import PerceptionError, read_scene
from lilgym_mp.scene import Colour, Item, Scene, Shape, Size
from lilgym_mp.scene.render import draw
from tests.scenes import MEDIUM, SCENES, SMALL, items, items_of, scene, scene_of, square

IMAGE_SIZES = pytest.mark.parametrize("image_size", ["half", "native"])


def as_sets(shown):
    return [sorted(box.items) for box in shown.boxes]


def check_redrawn(image, image_size="half"):
    """Asserts that what is read from an image draws it again, or that it is an error."""
    with suppress(PerceptionError):
        assert np.array_equal(draw(read_scene(image, "scatter"), image_size), image)


def check_recovered(scenes, appearance, image_size):
    read = [read_scene(draw(shown, image_size), appearance) for shown in scenes]
    assert [as_sets(shown) for shown in read] == [as_sets(shown) for shown in scenes]


# Tower


@given(shown=SCENES["tower"])
def test_tower__blocks_are_ordered_from_bottom_to_top(shown):
    assert read_scene(draw(shown, "half"), "tower") == shown


def test_tower__a_floating_block_is_an_error():
    with pytest.raises(PerceptionError, match="box 1: its items are not a tower"):
        read_scene(draw(scene([], [square(40, 59)]), "half"), "tower")


# Scatter, legal scenes


@IMAGE_SIZES
@given(shown=SCENES["scatter"])
def test_scatter__reconstructions_of_legal_scenes_draw_the_same_image(image_size, shown):
    image = draw(shown, image_size)
    assert np.array_equal(draw(read_scene(image, "scatter"), image_size), image)


def test_scatter__items_are_ordered_by_x_then_y():
    given_items = items_of("square 50,60 blue; circle 50,10; triangle 0,60 large black; square 50,33")
    read = read_scene(draw(scene([], given_items), "half"), "scatter")
    assert [*read.boxes[1].items] == sorted(given_items)


@pytest.mark.parametrize(("image_size", "shape"), [("native", Shape.CIRCLE), *(("half", shape) for shape in Shape)])
def test_scatter__every_single_item_is_recovered(image_size, shape):
    for size in Size:
        corners = range(0, 101 - size.pixels, 17)
        ends = [*corners, 100 - size.pixels]
        for colour, x, y in product(Colour, ends, ends):
            shown = scene([], [], [Item(x, y, shape, colour, size)])
            assert read_scene(draw(shown, image_size), "scatter") == shown


@pytest.mark.parametrize(
    "touching",
    [
        "square 10,10; square 30,10; square 50,20",
        "square 11,11 large; square 41,11 small; square 41,21 small",
        "circle 11,11; circle 31,11; circle 21,29",
        "triangle 10,40; square 10,60; triangle 30,41",
    ],
)
def test_scatter__touching_items_of_one_colour_are_separated(touching):
    check_recovered([scene_of(touching), scene_of(f"| | {touching}")], "scatter", "half")


def test_scatter__fewest_items_are_preferred():
    filling = [square(x, y, SMALL) for x in (10, 20) for y in (10, 20)]
    assert read_scene(draw(scene(filling), "half"), "scatter") == scene([square(10, 10, MEDIUM)])


# Scatter, scenes of the released rules


@IMAGE_SIZES
@pytest.mark.parametrize(
    "drawn", ["circle 10,10 large blue; square 35,20 black", "circle 60,10 large; square 80,35", "square -3,40 blue"]
)
def test_scatter__occluded_or_cut_off_items_are_an_error(image_size, drawn):
    with pytest.raises(PerceptionError, match=r"box 0: .* occlude"):
        read_scene(draw(scene_of(drawn), image_size), "scatter")


@pytest.mark.parametrize("item", ["square -3,40 blue", "triangle 85,74 black"])
def test_scatter__items_that_leave_their_box_sideways_are_recovered(item):
    check_recovered([scene_of(f"| {item}; square 40,40")], "scatter", "half")


@given(drawn_items=st.lists(items(overhang=10), min_size=1, max_size=2))
def test_scatter__reconstruction_of_any_items_draws_the_same_image_or_is_an_error(drawn_items):
    check_redrawn(draw(scene([], drawn_items), "half"))


# Play and corpora


@pytest.mark.usefixtures("official_data")
@pytest.mark.parametrize("appearance", ["tower", "scatter"])
def test_official_starts__are_recovered(appearance):
    starts = {task.start for task in load_tasks("lilgym", appearance, "flipit", "dev")}
    check_recovered(list(starts)[::4], appearance, "half")


@pytest.mark.parametrize(("appearance", "image_size"), [("tower", "half"), ("scatter", "native")])
def test_builtin_starts_and_scenes_of_play__are_recovered(appearance, image_size):
    starts = [task.start for task in load_tasks("builtin", appearance, "flipit", "dev")[::8]]
    played = ScenePool.sample(appearance, random.Random(7), 12).scenes
    check_recovered([*starts, *played], appearance, image_size)


# Invalid images


@pytest.mark.parametrize(
    ("image", "reason"),
    [
        (np.zeros((50, 190), np.uint8), r"not uint8 \(50, 190\)"),
        (np.zeros((50, 190, 3), np.float32), r"not float32 \(50, 190, 3\)"),
        ([[0, 0, 0]], r"not int64 \(1, 3\)"),
    ],
)
def test_wrong_array__error_names_the_valid_shapes(image, reason):
    with pytest.raises(PerceptionError, match=rf"uint8 array of shape \(50, 190, 3\) or \(100, 380, 3\), {reason}"):
        read_scene(image, "tower")


@IMAGE_SIZES
@given(place=st.tuples(st.integers(0, 49), st.integers(0, 189)), pixel=st.tuples(*[st.integers(0, 255)] * 3))
def test_one_changed_pixel__is_an_error_or_reproduced(image_size, place, pixel):
    image = draw(scene_of("circle 10,10 | square 40,40 large black | triangle 50,50 large blue"), image_size)
    image[place] = pixel
    check_redrawn(image, image_size)


@pytest.mark.parametrize(
    ("pixel", "value", "message"),
    [((20, 110), 211, "row 20, column 110"), ((50, 50), 0, "box 0: no items explain its black pixels")],
    ids=["box colour on a separator", "single coloured pixel"],
)
def test_pixel_of_no_scene__is_an_error(pixel, value, message):
    image = draw(Scene.empty())
    image[pixel] = value
    with pytest.raises(PerceptionError, match=message):
        read_scene(image, "scatter")
