"""Images: pixels compared with literals and Pillow, the canvas compared with `draw`, and text pictures."""

import copy
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image, ImageDraw

from lilgym_mp.scene import Box, Scene, Shape
from lilgym_mp.scene.render import draw
from lilgym_mp.scene.render.canvas import Canvas
from lilgym_mp.scene.render.characters import text
from tests.scenes import UNCHECKED_SCENES, circle, scene, scene_of, square, unchecked_boxes

YELLOW_RGB, BLACK_RGB, BLUE_RGB = (250, 255, 0), (0, 0, 0), (15, 131, 255)
BOX_RGB, SEPARATOR_RGB = (211, 211, 211), (128, 128, 128)
FEWER = settings(max_examples=40)  # as each draws several pictures
IMAGE_SIZES = pytest.mark.parametrize("image_size", ["half", "native"])


def by_pillow(shown):
    """(100, 380, 3) the image drawn with Pillow as in docs/spec.md, "Drawing"."""
    image = Image.new("RGB", (380, 100), SEPARATOR_RGB)
    pen = ImageDraw.Draw(image)
    for index in range(3):
        pen.rectangle((140 * index, 0, 140 * index + 99, 99), fill=BOX_RGB)
    for index, box in enumerate(shown.boxes):
        for item in box.items:
            left, top = 140 * index + item.x, item.y
            right, bottom = left + item.side - 1, top + item.side - 1
            fill = (YELLOW_RGB, BLACK_RGB, BLUE_RGB)[item.colour]
            if item.shape is Shape.CIRCLE:
                pen.ellipse((left, top, right, bottom), fill=fill)
            elif item.shape is Shape.SQUARE:
                pen.rectangle((left, top, right, bottom), fill=fill)
            else:
                apex = right - (item.side - 1) // 2
                pen.polygon([(apex, top), (right, bottom), (left, bottom)], fill=fill)
    return np.asarray(image)


# Pixels


SMALL_SHAPES = {
    "triangle": [
        ".....#....",
        "....##....",
        "....###...",
        "...####...",
        "...#####..",
        "..######..",
        "..#######.",
        ".########.",
        ".#########",
        "##########",
    ],
    "circle": [
        "...####...",
        "..######..",
        ".########.",
        "##########",
        "##########",
        "##########",
        "##########",
        ".########.",
        "..######..",
        "...####...",
    ],
}


@pytest.mark.parametrize("shape", SMALL_SHAPES)
def test_draw__a_small_triangle_and_circle(shape):
    pixels = draw(scene_of(f"{shape} 30,50 small"))[50:60, 30:40]
    rows = ["".join("#" if tuple(pixel) == YELLOW_RGB else "." for pixel in row) for row in pixels]
    assert rows == SMALL_SHAPES[shape]


@FEWER
@given(UNCHECKED_SCENES)
def test_draw__equals_pillow_drawing_onto_the_whole_image(shown):
    assert np.array_equal(draw(shown), by_pillow(shown))


@FEWER
@given(UNCHECKED_SCENES)
def test_draw__half_size_is_the_truncated_mean_of_two_by_two_pixels(shown):
    half = draw(shown, "half")
    assert (half.shape, half.dtype) == ((50, 190, 3), np.uint8)
    means = draw(shown).reshape(50, 2, 190, 2, 3).mean((1, 3))
    assert np.array_equal(half, np.trunc(means))


@st.composite
def scenes_in_a_row(draw):
    """A sequence of scenes with boxes in common, and others with an item more or less."""
    drawn = draw(st.lists(unchecked_boxes, min_size=1, max_size=3))
    boxes = [Box(), *drawn, *(box.without(index) for box in drawn for index in range(len(box.items)))]
    return draw(st.lists(st.tuples(*[st.sampled_from(boxes)] * 3).map(Scene), min_size=2, max_size=7))


@IMAGE_SIZES
@FEWER
@given(shown=scenes_in_a_row())
def test_canvas__equals_draw_after_any_sequence_of_scenes(image_size, shown):
    canvas = Canvas(image_size)
    for one in shown * 3:
        assert np.array_equal(canvas.show(one), draw(one, image_size))


def test_canvas__redraws_completely_after_an_interrupt(monkeypatch):
    canvas, before = Canvas(), Scene.empty()
    canvas.show(before)

    def interrupted(canvas, scene):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(Canvas, "_begin", interrupted)
        with pytest.raises(KeyboardInterrupt):
            canvas.show(scene([circle(0, 0)], [square(9, 9), square(50, 9)]))  # after the circle was drawn
    assert np.array_equal(canvas.show(before), draw(before, "half"))


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda canvas: pickle.loads(pickle.dumps(canvas))])
def test_canvas__copy_has_its_own_buffer(duplicate):
    canvas = Canvas("half")
    canvas.show(scene_of("circle 0,0"))
    copied = duplicate(canvas)
    shown, other = scene_of("circle 0,0; square 40,40"), scene_of("| square 0,0")
    canvas.show(other)
    assert np.array_equal(copied.show(shown), draw(shown, "half"))
    assert np.array_equal(canvas.pixels, draw(other, "half"))


# For people


def test_text__draws_the_boxes_with_characters():
    shown = scene_of("square 0,0 blue | circle 40,70 large | triangle 80,80 black")
    assert text(shown, ["A line."], coloured=False).splitlines() == [
        "+--------------------+  +--------------------+  +--------------------+",
        "|b#b#                |  |                    |  |                    |",
        "|b#b#                |  |                    |  |                    |",
        "|                    |  |                    |  |                    |",
        "|                    |  |                    |  |                    |",
        "|                    |  |                    |  |                    |",
        "|                    |  |                    |  |                    |",
        "|                    |  |                    |  |                    |",
        "|                    |  |         oyoy       |  |                    |",
        "|                    |  |        yoyoyo      |  |                 ^k |",
        "|                    |  |         oyoy       |  |                k^k^|",
        "+--------------------+  +--------------------+  +--------------------+",
        "A line.",
    ]


@FEWER
@given(UNCHECKED_SCENES)
def test_text__clips_any_scene_to_the_frame(shown):
    lines = text(shown, [], coloured=False).splitlines()
    assert [len(line) for line in lines] == [70] * 12
