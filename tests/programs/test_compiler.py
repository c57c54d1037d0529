"""Program objects: truth values, errors, memoisation, limits."""

import pickle

import pytest

from lilgym_mp.programs import Program, ProgramRuntimeError, compile_program, compiler
from lilgym_mp.programs.tracing import explain_program
from lilgym_mp.scene import Scene
from tests.scenes import scene_of
from tests.stress.program_language import crowded_scene


def test_program__errors_count_as_false_once_per_scene():
    program = Program("is_top(unique(all_items))")
    empty, two = Scene.empty(), crowded_scene(2)
    assert [program(empty), program(empty), program(two), program(crowded_scene(1))] == [False, False, False, True]
    assert sorted(program.errors.values()) == [1, 1]
    assert all(message.startswith("unique:") for message in program.errors)
    with pytest.raises(ProgramRuntimeError, match="exactly one"):
        program.evaluate(empty)


def test_program__is_pickled_by_its_source():
    program = compile_program("count(all_items) == 1")
    copy = pickle.loads(pickle.dumps(program))
    assert copy.source == program.source
    assert copy(crowded_scene(1)) is True


def test_program__equal_boxes_hold_distinct_items():
    scene = Scene(scene_of("square 0,0 small blue").boxes[:1] * 3)
    for source in ("count(all_items) == 3", "count(set(all_items)) == 3", "all_boxes[0] != all_boxes[1]"):
        assert compile_program(source)(scene) is True


@pytest.mark.parametrize("count", [23, 24, 25, 64, 65, 130])
def test_program__boxes_may_hold_any_number_of_items(count):
    scene = crowded_scene(3 * count)
    source = f"All(all_boxes, lambda b: count(filter_obj(b, lambda x: is_yellow(x) or NOT(is_yellow(x)))) == {count})"
    program = compile_program(source)
    assert program(scene) is True
    assert program.evaluate_reference(scene) is True


@pytest.mark.parametrize(
    "source",
    [
        "exist(combinations(all_items, 12))",
        "exist(select(30, all_items))",
        "exist(select(1000000, all_items + all_items)) or exist(combinations(combinations(all_items, 3), 3))",
        "exist(filter_obj(combinations(all_items, 3), lambda a: exist(filter_obj(combinations(all_items, 3), "
        "lambda b: a == b and False))))",
        "Any(all_items, lambda a: Any(all_items, lambda b: Any(all_items, lambda c: Any(all_items, lambda d: "
        "is_top(a) and is_top(d) and False))))",
    ],
)
def test_program__exceeding_a_limit_is_a_runtime_error(source, monkeypatch):
    monkeypatch.setattr("lilgym_mp.programs.costs.STEP_LIMIT", 2_000_000)
    with pytest.raises(ProgramRuntimeError, match=r"steps|elements"):
        compile_program(source).evaluate(crowded_scene(60))


def test_program__that_could_exceed_the_step_limit_has_no_generated_code():
    program = compile_program(
        "count(filter_obj(all_items, lambda a: exist(filter_obj(all_items, lambda b: exist(filter_obj(all_items, "
        "lambda c: a.color == b.color and b.color == c.color and get_above(c) == get_above(a) and False)))))) == 0"
    )
    assert not program.has_generated_code
    assert program(crowded_scene(5)) is True


def test_program__is_evaluated_by_the_generator_registered_last(monkeypatch):
    program = Program("count(all_items) == 1")
    monkeypatch.setattr(compiler, "_GENERATORS", [lambda tree: lambda scene: True])
    assert [program(crowded_scene(count)) for count in range(2, 6)] == [False, False, True, True]
    monkeypatch.setattr(compiler, "_GENERATORS", [])
    assert not Program("count(all_items) == 2").has_generated_code


def test_explain_program__good_and_bad_sources():
    good = explain_program("exist(filter_obj(all_items, is_blue))")
    assert "exist, filter_obj, is_blue" in good
    assert "empty scene: False" in good
    assert "no value" in explain_program("is_blue(unique(all_items))")
    bad = explain_program("exist(all_itms)")
    assert "did you mean all_items" in bad
    assert "^^^^^^^^" in bad
