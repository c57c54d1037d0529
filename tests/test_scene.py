"""Scenes: the released JSON form, errors in it, and immutability."""

import copy
import dataclasses
import json
import pickle

import pytest
from hypothesis import given

from lilgym_mp.scene import Box, Scene, SceneError
from tests.scenes import LARGE, SMALL, UNCHECKED_SCENES, B, K, circle, scene, square, triangle

JSON = [
    [{"x_loc": 0, "y_loc": 70, "type": "circle", "color": "Yellow", "size": 30}],
    [],
    [
        {"x_loc": 5, "y_loc": -2, "type": "triangle", "color": "#0099ff", "size": 10},
        {"x_loc": 40, "y_loc": 80, "type": "square", "color": "Black", "size": 20},
    ],
]
SCENE = scene([circle(0, 70, LARGE)], [], [triangle(5, -2, SMALL, B), square(40, 80, colour=K)])


def test_json__is_the_released_form():
    assert Scene.from_json(JSON) == SCENE
    assert SCENE.to_json() == JSON


@given(UNCHECKED_SCENES)
def test_json__reading_a_written_scene_restores_it(written):
    assert Scene.from_json(json.loads(json.dumps(written.to_json()))) == written


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (None, r"^a scene must be a list of 3 boxes, not None$"),
        ([[], []], r"^a scene has 3 boxes, not 2$"),
        ([[], {}, []], r"^box 1: a box must be a list of items, not \{\}$"),
        (
            [[{"colour": "Black", "size": 10}], [], []],
            r"^box 0, item 0: an item has keys colour, size; it must have color, size",
        ),
        ([[], [], [7]], r"^box 2, item 0: an item must be an object with keys color, size, type, x_loc, y_loc, not 7$"),
    ],
)
def test_from_json__malformed_data_is_refused_with_its_place(data, message):
    with pytest.raises(SceneError, match=message):
        Scene.from_json(data)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("type", "disc", "unknown type 'disc'; choose from circle, square, triangle"),
        ("color", "yellow", "unknown color 'yellow'; choose from #0099ff, Black, Yellow"),
        ("size", True, "unknown size True; choose from 10, 20, 30"),
        ("x_loc", 1.5, r"x_loc must be a whole number of pixels, not 1\.5"),
        ("y_loc", True, "y_loc must be a whole number of pixels, not True"),
    ],
)
def test_from_json__a_wrong_value_is_refused_with_box_item_and_choices(key, value, message):
    data = copy.deepcopy(JSON)
    data[2][1][key] = value
    with pytest.raises(SceneError, match=f"^box 2, item 1: {message}"):
        Scene.from_json(data)


def test_permuted__box_k_is_the_old_box_order_k():
    left, middle, right = (Box((square(x, 0),)) for x in (1, 2, 3))
    assert Scene((left, middle, right)).permuted((2, 0, 1)).boxes == (right, left, middle)


@pytest.mark.parametrize("order", [(0, 1), (0, 1, 1), (1, 2, 3)])
def test_permuted__an_invalid_permutation_is_refused(order):
    with pytest.raises(SceneError, match=r"is not a permutation of the boxes 0, 1, 2"):
        SCENE.permuted(order)


@pytest.mark.parametrize(
    ("value", "name"), [(SCENE, "boxes"), (SCENE.boxes[0], "items"), (SCENE, "memo"), (circle(0, 0), "x")]
)
def test_fields__cannot_be_set(value, name):
    with pytest.raises((dataclasses.FrozenInstanceError, AttributeError)):
        setattr(value, name, None)


def test_with_box__shares_other_boxes_and_keeps_the_old_scene():
    new = Box((circle(1, 1),))
    changed = SCENE.with_box(1, new)
    assert [*map(id, changed.boxes)] == [id(SCENE.boxes[0]), id(new), id(SCENE.boxes[2])]
    assert Scene.from_json(JSON) == SCENE


def test_equality__is_by_items_and_their_order_not_by_memo():
    remembered = Scene.from_json(JSON)
    remembered.memo["truth"] = True
    remembered.boxes[0].memo["mask"] = 1
    assert remembered == SCENE
    assert scene([circle(0, 0), circle(50, 0)]) != scene([circle(50, 0), circle(0, 0)])
    assert scene([circle(0, 0)]) != scene([], [circle(0, 0)])


def test_pickling__keeps_the_scene_and_drops_the_memos():
    remembered = Scene.from_json(JSON)
    remembered.memo["unpicklable"] = remembered.boxes[0].memo["unpicklable"] = lambda: None
    copied = pickle.loads(pickle.dumps(remembered))
    assert copied == SCENE
    assert not copied.memo
    assert not any(box.memo for box in copied.boxes)
