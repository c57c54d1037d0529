"""Pictures of scenes for people."""

import numpy as np
import pytest
from hypothesis import given, settings

from lilgym_mp.scene import Box, Scene
from lilgym_mp.scene.appearances import Scatter
from lilgym_mp.scene.render import draw, drawing
from lilgym_mp.scene.render.frames import (
    BOX_RGB,
    CELL_RGB,
    FRAME_SHAPE,
    MARGIN,
    PAPER_RGB,
    SCALE,
    SCENE_SHAPE,
    frame,
    scene_picture,
)
from tests.scenes import LARGE, SCENES, B, circle, scene, square


def _boxes(picture):
    """The picture without its margin."""
    return picture[MARGIN : SCENE_SHAPE[0] - MARGIN, MARGIN : SCENE_SHAPE[1] - MARGIN]


def test_frame__shows_the_scene_above_the_lines():
    shown = scene([circle(0, 70, LARGE, B)], [square(40, 80)])
    plain, captioned = frame(shown, []), frame(shown, ["Some line.", "Another."])
    assert (captioned.shape, captioned.dtype) == (FRAME_SHAPE, np.uint8)
    below = SCENE_SHAPE[0]
    assert np.array_equal(captioned[:below], scene_picture(shown))
    assert np.all(plain[below:] == PAPER_RGB)
    assert (captioned[below:] < 128).any()


def test_frame__truncates_a_long_line():
    written = frame(Scene.empty(), ["word " * 100])
    assert np.all(written[SCENE_SHAPE[0] :, FRAME_SHAPE[1] - MARGIN :] == PAPER_RGB)
    assert not np.array_equal(written, frame(Scene.empty(), ["word " * 5]))


@given(SCENES["scatter"])
@settings(max_examples=8)
def test_scene_picture__differs_from_the_observation_only_at_edges(shown):
    image = _enlarged(shown)
    edges = _edges(image)
    for index, box in enumerate(shown.boxes):  # adjacent items of one colour are separated by a line
        for item in box.items:
            edges |= _edges(_enlarged(Scene.empty().with_box(index, Box((item,)))))
    smooth = _boxes(scene_picture(shown))
    assert np.array_equal(smooth[~edges], image[~edges])


def _enlarged(shown):
    """The observation's image on the lighter ground."""
    image = draw(shown)
    for rgb, lighter in ((drawing.BOX_RGB, BOX_RGB), (drawing.SEPARATOR_RGB, PAPER_RGB)):
        image[(image == rgb).all(axis=2)] = lighter
    return image.repeat(SCALE, axis=0).repeat(SCALE, axis=1)


def _edges(image):
    """Whether another colour is near each pixel."""
    colours = image @ np.array([1, 1 << 8, 1 << 16])  # one int per colour
    edges = np.zeros(colours.shape, np.bool_)
    for axis in (0, 1):
        for by in range(-2 * SCALE, 2 * SCALE + 1):
            edges |= np.roll(colours, by, axis) != colours
    return edges


def test_scene_picture__marks_cells_only_on_request():
    plain, marked = _boxes(scene_picture(Scene.empty())), _boxes(scene_picture(Scene.empty(), Scatter()))
    assert not (plain == CELL_RGB).all(axis=2).any()
    cell = SCALE * 20
    row = (marked[cell // 2] != BOX_RGB).any(axis=1)
    assert [row[column * cell - 2 : column * cell + 2].any() for column in range(1, 5)] == [True] * 4
    assert not row[cell // 2]


@pytest.mark.parametrize("grid", [(38, 10), (380, 100)])
def test_scene_picture__marks_of_fine_grids_do_not_overlap(grid):
    marked = scene_picture(Scene.empty(), Scatter(grid))
    lines = (marked[MARGIN + 5, MARGIN : MARGIN + SCALE * 100] != BOX_RGB).any(axis=1)
    assert 4 < lines.sum() < SCALE * 100 / 4
