"""Programs stay within the bounds on time and memory in docs/programs.md: the attacks of tests/stress."""

import random
from contextlib import suppress
from time import process_time

import pytest

from lilgym_mp.envs.fast import code_generation, ir
from lilgym_mp.programs import (
    Program,
    ProgramError,
    ProgramRuntimeError,
    StepLimitError,
    compile_program,
    costs,
)
from lilgym_mp.programs.bounded import bounded_truths
from lilgym_mp.programs.reference import Evaluation, build_closure, evaluate
from lilgym_mp.programs.syntax import parse
from lilgym_mp.scene import Box, Colour, Item, Scene, Shape, Size
from tests.stress.program_language import ATTACKS, attack, crowded_scene, nested, repeated, run_limited
from tests.stress.program_truth import TypedPrograms

FEW_STEPS = 100_000  # keeps the tests short
BLUE = Item(0, 0, Shape.SQUARE, Colour.BLUE, Size.SMALL)


@pytest.mark.parametrize("name", ATTACKS)
def test_attacks__end_in_time_and_in_little_memory(name, monkeypatch):
    monkeypatch.setattr(costs, "STEP_LIMIT", FEW_STEPS)
    result = run_limited(attack, ATTACKS[name], seconds=30)
    assert isinstance(result, dict), result
    assert result["compile_seconds"] < 5
    assert result["seconds"] < 2
    assert result["megabytes"] < 60


@pytest.mark.parametrize("name", ATTACKS)
def test_attacks__end_within_the_limit_of_bounded_truths(name):
    scenes = [crowded_scene(72)] * 20
    begun = process_time()
    with suppress(StepLimitError, ProgramError):
        assert set(bounded_truths(ATTACKS[name], scenes)) <= {True, False, None}
    assert process_time() - begun < 0.5  # 0.04 s without other load


def test_bounded_truths__are_those_of_the_program_with_one_limit_for_all_scenes():
    source = "is_blue(unique(all_items))"
    scenes = [Scene.of([BLUE], [], []), Scene.of([BLUE._replace(colour=Colour.BLACK)], [], []), Scene.empty()]
    assert bounded_truths(source, scenes) == [True, False, None]
    with pytest.raises(StepLimitError, match="more than 1000 steps on 3000 scenes"):
        bounded_truths(source, scenes * 1_000, step_limit=1_000)
    with pytest.raises(ProgramError):
        bounded_truths("exist(", scenes)


def test_step_limit__ends_nested_filters_and_leaves_other_programs_alone():
    filters = repeated(6, "exist(filter_obj(all_items, lambda {0}: not {1}))", "exist(all_items)")
    with pytest.raises(StepLimitError, match="more than 10000 steps"):
        compile_program(filters).evaluate(crowded_scene(12), step_limit=10_000)
    assert compile_program("exist(all_items)").evaluate(crowded_scene(12), step_limit=10_000)


def test_memos__of_scenes_and_boxes_shared_by_many_programs_stay_small(monkeypatch):
    for module in ("programs.compiler", "envs.fast.box_functions"):
        monkeypatch.setattr(f"lilgym_mp.{module}.MAX_MEMO", 50)
    scene = crowded_scene(6)
    for number in range(60):
        program = Program(f"exist(filter_obj(all_boxes, lambda b: count(b) + {number} == 2))")
        assert program(scene) is (number == 0)
        assert program.has_generated_code
    assert max(len(memo) for memo in (scene.memo, *(box.memo for box in scene.boxes))) <= 50


def steps_allowed(source):
    """The code generator's upper bound on the reference evaluator's steps. Raises Unsupported."""
    context = code_generation.Context()
    code_generation.Generator(context, kernel=False).lower(parse(source), {})
    return costs.STEP_LIMIT - context.steps_left


def test_code_generation__step_bound_is_an_upper_bound_for_random_programs():
    programs = TypedPrograms(random.Random(11))
    compared = 0
    for _ in range(600):
        source, evaluation = programs.program(), Evaluation(crowded_scene(72))
        with suppress(ProgramError, ProgramRuntimeError, ir.Unsupported):
            allowed = steps_allowed(source)
            evaluate(build_closure(parse(source)), evaluation)
            assert evaluation.step_limit - evaluation.steps_left <= allowed, source
            compared += 1
    assert compared > 100


def test_code_generation__gives_up_early_on_exploding_text():
    source = "exist(all_items)"
    for _ in range(14):
        source = f"All(filter_obj([all_boxes[0]], lambda b: {source}), lambda c: True)"
    context = code_generation.Context()
    with pytest.raises(ir.Unsupported, match="too long"):
        code_generation.Generator(context, kernel=False).lower(parse(source), {})


def test_nesting_of_collections_and_calls__is_limited():
    for source, message in (
        (nested(25, "[{0}]", "equal(v25, v25)", "[1]"), "collections are nested more than 20 deep"),
        (ATTACKS["a function of itself"], "functions call each other more than 50 deep"),
    ):
        with pytest.raises(ProgramRuntimeError, match=message):
            compile_program(source).evaluate(Scene.empty())


def test_sets_of_functions__are_iterated_in_a_fixed_order():
    words = "{is_top, is_blue, is_square, is_circle, is_small}"
    for source in (
        f"filter_obj({words}, lambda f: True)[0] == is_blue",
        f"filter_obj({words}, lambda f: True)[4] == is_top",
        "Any(filter_obj({lambda x: is_blue(x), lambda x: is_black(x)}, lambda f: True)[0:1], "
        "lambda f: All([all_items], lambda s: exist(filter_obj(s, f))))",
    ):
        values = {Program(source).evaluate(Scene((Box((BLUE,)), Box(), Box()))) for _ in range(20)}
        assert values == {True}, source
