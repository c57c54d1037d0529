"""Generated code has the reference evaluator's value or error; tests/stress compares random programs."""

import random

import pytest

from lilgym_mp.programs import Program, ProgramError, compile_program
from lilgym_mp.programs.words import WORDS
from lilgym_mp.scene import Box, Scene
from tests.scenes import scene_of
from tests.stress.program_truth import batch_differences, scenes, value


def assert_agreement(program, probes):
    for scene in probes:
        fresh = Scene.of(*(box.items for box in scene.boxes))
        for _ in range(2):  # the second time from memos
            assert value(program, fresh) == value(program, scene, reference=True), program.source


def many_scenes(seed, rounds):
    rng = random.Random(seed)
    return [scene for _ in range(rounds) for scene in scenes(rng)]


SUPPORTED = (
    "exist(filter_obj(all_items, lambda x: AND(is_blue(x), NOT(is_touching_wall(x, Side.TOP)))))",
    "count(filter_obj(all_boxes, lambda b: b.is_tower() and count(b) >= 2)) == 1",
    "exist(filter_obj(all_items, lambda x: exist(get_below(x)) and is_black(unique(get_below(x)))))",
    "exist(filter_obj(all_boxes, lambda a: count(filter_obj(all_boxes, lambda b: count(a) == count(b))) == 2))",
    "exist(filter_obj(combinations(all_boxes, 2), lambda p: get_set_colors(p[0]) == get_set_colors(p[1])))",
    "exist(all_items) and is_top(unique(filter_color(all_boxes[0], Color.BLUE)))",
    "All(filter_obj(all_boxes, lambda b: b.is_tower()), lambda b: count(b) < 3)",
    "count(filter_obj(filter_obj(all_boxes, lambda b: b.is_tower()), lambda b: count(b) < 3)) == 1",
    "exist(filter_obj(combinations(all_items, 2), lambda p: all_same_color(p) and p[0].box != p[1].box))",
    "all_same_attribute(filter_obj(all_boxes, lambda b: b), lambda b: count(filter_color(b, Color.BLUE)))",
    "count(filter_obj(all_boxes, lambda b: exist(get_above(b)))) == 1",
    "All(all_items, lambda x: equal_color(query_color(x), [Color.BLUE]) or x.color in {Color.BLACK, Color.YELLOW})",
    "equal_set([Color.BLUE, Color.BLACK], get_set_colors(all_items)) and contained([Color.BLUE], {Color.BLUE})",
)


@pytest.mark.parametrize("source", SUPPORTED)
def test_common_constructs__have_generated_code_that_agrees(source):
    program = compile_program(source)
    assert program.has_generated_code
    assert_agreement(program, many_scenes(source, 4))


def test_words_as_functions__are_told_apart():
    """Also where an object of one has the address that an object of another had."""
    tops = (f"query_color(unique(filter_obj({name}.all_items_in_box(), is_top)))" for name in "xy")
    bottoms = (f"query_color(unique(filter_obj({name}.all_items_in_box(), is_bottom)))" for name in "xy")
    same = f"equal_color({', '.join(tops)}) and NOT(equal_color({', '.join(bottoms)}))"
    source = f"exist(filter_obj(all_boxes, lambda x: exist(filter_obj(all_boxes, lambda y: {same}))))"
    for scene in many_scenes(0, 8):
        assert_agreement(Program(source), [scene])


@pytest.mark.parametrize(
    "source",
    [
        "exist(set(all_boxes)[0])",
        "exist(set(all_boxes)[1].all_items_in_box())",
        "exist(union(all_boxes, all_boxes)[0])",
        "count([all_boxes[0], all_boxes[0]]) == 1",
        "len([all_boxes[0], all_boxes[0]]) == 2",
        "exist(combinations(set([all_boxes[2], all_boxes[0]]), 2)[0][0])",
    ],
)
def test_sets_and_repeated_elements_of_a_static_list__are_not_lists_of_distinct_elements(source):
    assert_agreement(compile_program(source), many_scenes(0, 4))


def test_generated_code__box_memo_is_shared_between_programs_without_collisions():
    box = scene_of("square 0,0 small blue; circle 50,50 large black").boxes[0]
    scene = Scene((box, Box(), box))
    bodies = ("is_blue(x)", "is_black(x)", "NOT(is_blue(x))", "is_blue(x) and is_square(x)", "is_yellow(x)")
    counts = [compile_program(f"count(filter_obj(all_items, lambda x: {body})) == 2")(scene) for body in bodies]
    assert counts == [True, True, True, True, False]
    lambdas = ("lambda x: exist(filter_obj(x, is_blue))", "lambda x: exist(filter_obj(x, is_yellow))")
    assert [compile_program(f"exist(filter_obj(all_boxes, {f}))")(scene) for f in lambdas] == [True, False]


VALUES = {  # by parts of the names of the parameters' types; a collection suits most
    "bool": "True; exist(all_items); all_boxes[0].is_tower()",
    "int": "0; 2; 1000000; count(all_items); count(all_items) % 3",
    "Color": "Color.BLACK; all_items[0].color; unique(all_boxes[0]).color",
    "Shape": "Shape.TRIANGLE; all_boxes[0].all_items_in_box()[0].shape",
    "Size": "Size.BIG; Size.SMALL",
    "Side": "Side.TOP; Side.ANY",
    "item": "all_items[0]; unique(all_boxes[0]); unique(filter_color(all_boxes[1], Color.BLACK)); all_items",
    "function": """is_black; exist; get_above; lambda x: x; lambda x: [x, Color.BLUE]; lambda x: {x, Size.BIG};
        lambda x: 1; lambda x: count(x) == 2; lambda x: is_black(x); lambda x: x.color; lambda x: x in {Color.BLUE}""",
    "collection": """all_items; all_boxes; all_boxes[1]; set(all_boxes); [all_boxes[0], all_boxes[0]]; {all_boxes[2]};
        []; [Color.BLACK]; [2, True]; [Color.BLACK, Color.BLACK, Color.BLUE]; {Color.BLACK, unique(all_boxes[0]).color};
        {Shape.TRIANGLE, Color.BLACK}; [Shape.TRIANGLE, Color.BLACK]; {1, Size.BIG, True}; [Side.TOP, Side.LEFT];
        [{Color.BLACK}, {Shape.CIRCLE}]; [[Color.BLACK], [1]]; {all_boxes[0], Color.BLUE}; {Color.BLACK, all_items};
        combinations([Color.BLUE, Shape.CIRCLE], 2); set(combinations(all_boxes, 2)); combinations(all_items, 2);
        [all_items[0], all_boxes[0], 1]; all_boxes[0:2]; filter_obj([], exist); filter_obj(all_boxes, exist);
        filter_obj(all_items, is_black); filter_obj({Color.BLUE}, lambda c: True); get_set_colors(all_items);
        get_set_shapes(all_boxes[1]); query_color(unique(all_boxes[0])); get_above(all_items);
        [unique(all_boxes[0]).color]""",
}
SUITING = {kind: [each.strip() for each in text.split(";")] for kind, text in VALUES.items()}
ANY_VALUE = [each for values in SUITING.values() for each in values]
USES = (
    "{0} == {1}",
    "{0} != {1}",
    "{0} in {1}",
    "{0} < {1}",
    "equal({0}, {1})",
    "exist({0})",
    "count({0}) == 2",
    "not {0}",
)


def odd_program(rng, name):
    """A use of the word with arguments that mostly suit it, and some of any type."""

    def argument(kind):
        suiting = [each for part, values in SUITING.items() if part in kind for each in values]
        return rng.choice(suiting if suiting and rng.random() < 0.8 else ANY_VALUE)

    parameters = [each for each in WORDS[name].parameters if not each.optional or rng.random() < 0.5]
    call = f"{name}({', '.join(f'{each.name}={argument(each.type.name)}' for each in parameters)})"
    used = call if WORDS[name].result == "bool" else rng.choice(USES).format(call, argument(WORDS[name].result))
    return used if rng.random() < 0.8 else f"All(all_boxes, lambda b: {used.replace('all_items', 'b')})"


@pytest.mark.parametrize("count", [2, pytest.param(20, marks=pytest.mark.long)])
def test_every_word__with_arguments_of_any_type_has_the_reference_evaluators_value(count):
    rng = random.Random(count)
    probes = scenes(rng)
    evaluated = generated = 0
    cases = []
    for name in sorted(WORDS):
        for source in sorted({odd_program(rng, name) for _ in range(count)}):
            try:
                program = Program(source)
            except ProgramError:
                continue
            evaluated += 1
            generated += program.has_generated_code
            assert_agreement(program, probes)
            cases.append((source, probes[2], value(program, probes[2], reference=True)))
    assert evaluated > 8 * count
    assert generated > count / 2
    assert not list(batch_differences("scatter", cases[::8]))


@pytest.mark.parametrize(
    "source",
    [
        "count({Shape.TRIANGLE, Color.BLACK}) == 2",
        "exist({Size.BIG, Side.TOP})",
        "equal_set([Color.BLUE, Shape.CIRCLE], {Shape.CIRCLE, Color.BLUE})",
        "not count(union([Color.BLUE, Shape.CIRCLE], {Color.BLUE})) == 1",
        "Color.BLUE in {Color.BLUE, all_boxes[0]}",
        "count(set([all_boxes[0], Color.BLUE])) == 2",
    ],
)
def test_sets_of_values_of_several_kinds__have_the_reference_evaluators_value(source):
    program = Program(source)  # from the third evaluation on by generated code, if it has any
    for scene in many_scenes(0, 1):
        assert program(scene) is program.evaluate_reference(scene) is True
