"""Images and indices of Tower boxes."""

from __future__ import annotations

import numpy as np
import pytest

from lilgym_mp.render import draw
from lilgym_mp.scene import Box, SceneError
from lilgym_mp.solver.tower_boxes import box_columns, tower_box_images, tower_box_index
from tests.scenes import B, K, Y, circle, scene, tower


@pytest.mark.parametrize("image_size", ["half", "native"])
def test_images__are_the_parts_of_a_scene_image(image_size: str):
    shown = scene(tower(B, K, Y, Y), tower(), tower(K, B))
    image = draw(shown, image_size)
    images = tower_box_images(image_size)
    for index, box in enumerate(shown.boxes):
        assert np.array_equal(image[:, box_columns(index, image_size)], images[tower_box_index(box)])


def test_images__are_all_different():
    images = tower_box_images()
    assert images.shape == (121, 50, 50, 3)
    assert len({image.tobytes() for image in images}) == 121


def test_index__refuses_other_boxes():
    with pytest.raises(SceneError, match="is not a Tower box"):
        tower_box_index(Box((circle(0, 0),)))
