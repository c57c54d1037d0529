"""Traces of program evaluation."""

from lilgym_mp.programs.tracing import trace
from tests.scenes import SMALL, B, K, circle, scene, square, tower

SHOWN = scene([circle(0, 0, SMALL, K), square(40, 80, colour=B)], [], tower(B))


def values(source):
    return {part.source: part.value for part in trace(source, SHOWN)}


def test_trace__lists_items_that_satisfy_a_condition():
    traced = values("exist(filter_obj(all_items, lambda x: is_black(x)))")
    assert (
        traced["lambda x: is_black(x)"] == "satisfied by [small black circle at column 0, row 0 in the left box] of 3"
    )


def test_trace__lists_boxes_that_satisfy_a_nested_condition():
    source = "count(filter_obj(all_boxes, lambda b: exist(filter_obj(b, lambda x: is_blue(x))))) == 2"
    traced = values(source)
    assert traced[source] == "True"
    condition = "lambda b: exist(filter_obj(b, lambda x: is_blue(x)))"
    assert traced[condition] == "satisfied by [the left box, the right box] of 3"
    assert not any(
        "filter_obj(b, " in part and not part.startswith(("count", "filter_obj(all", "lambda b")) for part in traced
    )


def test_trace__shows_the_error_of_a_part_without_a_value():
    traced = values("is_blue(unique(filter_obj(all_items, is_yellow)))")
    assert all(value.startswith("no value: ") for part, value in traced.items() if "unique" in part)
    assert traced["filter_obj(all_items, is_yellow)"] == "[]"


def test_trace__has_the_indices_of_items_in_values():
    places = {part.source: part.items for part in trace("exist(filter_obj(all_items, lambda x: is_blue(x)))", SHOWN)}
    assert places["filter_obj(all_items, lambda x: is_blue(x))"] == ((0, 1), (2, 0))
    assert places["lambda x: is_blue(x)"] == ((0, 1), (2, 0))
    assert places["exist(filter_obj(all_items, lambda x: is_blue(x)))"] == ()
