"""Which programs are well typed: exactly those that generated code could be made for, and those that merely lack it."""

import random

import pytest

from lilgym_mp.corpus import load_tasks
from lilgym_mp.programs import Program
from lilgym_mp.programs.static_types import is_well_typed
from lilgym_mp.programs.syntax import parse
from tests.stress.program_truth import TypedPrograms


@pytest.mark.parametrize(
    "source",
    [
        "exist(filter_obj(all_items, lambda x: is_black(x) and 3))",  # a condition needs a truth, not a bool
        "exist(filter_obj(all_boxes, lambda b: b.is_tower() and get_set_shapes(b)))",
        "count(all_items) == (count(all_items) == 1)",  # numbers and bools compare
        "All(all_boxes, lambda b: is_blue(unique(b)))",  # may fail, but not because of types
        "is_blue(all_boxes[0][1])",
        "exist(filter_obj(combinations(all_items, 2), lambda p: p[0].color == p[1].color))",
    ],
)
def test_program__of_accepted_types_is_well_typed(source):
    assert is_well_typed(parse(source))


@pytest.mark.parametrize(
    "source",
    [
        "count(all_items)",  # not a bool
        "exist(filter_obj(all_items, lambda x: exist(x)))",
        "All(all_items, lambda x: count(x.box))",  # wants a bool
        "exist(filter_obj(all_items, lambda x: is_blue))",  # a function is always true
        "all_items == 3",
        "count(all_items) + exist(all_items) == 2",
        "exist(set([all_items]))",
        "is_blue(all_items[0][1])",
        "exist(all_items) and 3",
    ],
)
def test_program__of_other_types_is_not_well_typed(source):
    assert not is_well_typed(parse(source))


@pytest.mark.parametrize("appearance", ["tower", "scatter"])
def test_programs__of_the_builtin_corpus_are_well_typed(appearance):
    assert all(is_well_typed(parse(task.program)) for task in load_tasks("builtin", appearance, "scratch", "train"))


def test_programs__with_generated_code_are_well_typed():
    programs = TypedPrograms(random.Random(5))
    generated = [source for source in (programs.program() for _ in range(300)) if Program(source).has_generated_code]
    assert len(generated) > 60
    assert [source for source in generated if not is_well_typed(parse(source))] == []
