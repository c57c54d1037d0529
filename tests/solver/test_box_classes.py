"""Boxes with equal signatures are interchangeable."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lilgym_mp.corpus import load_tasks
from lilgym_mp.programs import compile_program
from lilgym_mp.scene import Box, Scene
from lilgym_mp.solver import Solver, tower_search
from lilgym_mp.solver.box_classes import queries_of
from tests.scenes import B, K, Y, scatter_boxes, tower_boxes
from tests.scenes import tower as stack
from tests.solver.tasks import mdp, task

SEPARABLE = (
    "count(filter_obj(all_boxes, lambda b: b.is_tower() and count(b) == 2)) == 1",
    "exist(filter_obj(all_items, lambda x: is_blue(x) and exist(get_above(x)))) or count(all_items) > 5",
    "All(filter_obj(all_boxes, exist), lambda b: is_black(unique(filter_obj(b, is_top))))",
    "Any(all_boxes, lambda b: filter_color(b, Color.BLUE)) != exist(filter_obj(all_items, is_top))",
    "count(filter_color(all_items, Color.BLACK)) == count(filter_obj(all_boxes, lambda b: is_yellow(unique(b))))",
)


@pytest.mark.parametrize("program", SEPARABLE)
@pytest.mark.parametrize("boxes", [tower_boxes, scatter_boxes()], ids=["tower", "scatter"])
@given(data=st.data())
@settings(max_examples=20)
def test_signature__determines_the_programs_value(program, boxes, data):
    queries = queries_of(program)
    drawn = data.draw(st.lists(boxes, min_size=3, max_size=9))
    left, middle, right = drawn[:3]
    for box in drawn[3:]:
        for index, known in enumerate((left, middle, right)):
            if all(query(known) == query(box) for query in queries):
                scene = Scene((left, middle, right))
                assert compile_program(program)(scene) == compile_program(program)(scene.with_box(index, box))


@pytest.mark.parametrize(
    "program",
    [
        "count(all_boxes[0]) == 1",
        "exist(filter_obj(all_boxes, lambda b: count(b) == count(all_items)))",
        "exist(filter_obj(all_items, lambda x: exist(get_img_all_above(x))))",
        "count(get_set_colors(all_items)) == 2",
        "All(all_items, is_blue)",
        "exist(filter_obj(all_boxes, lambda b: exist(filter_obj(all_boxes, lambda c: count(b) == count(c)))))",
    ],
)
def test_signature__is_none_if_the_program_is_not_separable(program):
    assert queries_of(program) is None


def test_signature__distinguishes_errors_from_values():
    queries = queries_of("exist(filter_obj(all_boxes, lambda b: is_blue(unique(b))))")
    boxes = [Box(tuple(blocks)) for blocks in (stack(B), stack(K), stack(B, Y))]
    assert len({tuple(query(box) for query in queries) for box in boxes}) == 3


def test_search_by_class__finds_solutions_as_short_as_exhaustive_search(monkeypatch):
    starts = load_tasks("builtin", "tower", "flipit", "dev")[:120:2]
    programs = [*SEPARABLE, "count(all_items) == 5", "count(filter_color(all_items, Color.BLUE)) == 13"]
    dynamics = mdp("tower", horizon=6)
    tasks = [*starts, *map(task, programs)]
    exhaustive = [Solver(dynamics).solve(one) for one in tasks]
    monkeypatch.setattr(tower_search, "MAX_EXHAUSTIVE_EDITS", 0)
    by_class = [Solver(dynamics).solve(one) for one in tasks]
    assert [(one.status, one.steps) for one in by_class] == [(one.status, one.steps) for one in exhaustive]
    assert sum(one.scenes for one in by_class) < sum(one.scenes for one in exhaustive)
