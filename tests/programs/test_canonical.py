"""Canonical form, unparsing and prefix tokens preserve programs' truth values."""

import random
from contextlib import suppress

import pytest

from lilgym_mp.corpus import load_tasks
from lilgym_mp.corpus.scene_walks import ScenePool
from lilgym_mp.programs import compile_program
from lilgym_mp.programs.bounded import bounded_truths
from lilgym_mp.programs.canonical import canonical_form
from lilgym_mp.programs.prefix import PrefixError, prefix_tokens, tree_from_tokens
from lilgym_mp.programs.printing import source_of
from lilgym_mp.programs.syntax import parse
from lilgym_mp.scene import Scene
from tests.scenes import scene_of
from tests.stress.program_language import repeated
from tests.stress.program_truth import differences, value

SCENES = 16


def canonical(source):
    return source_of(canonical_form(parse(source)))


def check(corpus, step):
    """Checks every `step`-th training program of the corpus; returns the number of those that have tokens."""
    count = 0
    for appearance in ("tower", "scatter"):
        rng = random.Random(3)
        probes = [Scene.empty(), *rng.sample(ScenePool.sample(appearance, rng, 24).scenes, SCENES)]
        for source in sorted({task.program for task in load_tasks(corpus, appearance, "scratch", "train")})[::step]:
            program = compile_program(source)
            values = [value(program, scene, reference=True) for scene in probes]
            assert not list(differences(program, probes, values)), source
            with suppress(PrefixError):
                count += bool(prefix_tokens(canonical_form(program.tree)))
    return count


@pytest.mark.long
def test_builtin_programs__keep_their_truth_in_canonical_form_and_have_tokens():
    assert check("builtin", 15) > 100


@pytest.mark.long
@pytest.mark.usefixtures("official_data")
def test_official_programs__keep_their_truth_in_canonical_form_and_have_tokens():
    assert check("lilgym", 40) > 45


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("ge(count(all_items), 1)", "exist(all_items)"),
        ("count(all_items) > 0", "exist(all_items)"),
        ("0 == count(all_items)", "not exist(all_items)"),
        ("3 > count(all_items)", "count(all_items) <= 2"),
        ("NOT(AND(True, count(all_items) == 2))", "not (True and count(all_items) == 2)"),
        ("NOT(count(all_items) == 2)", "count(all_items) != 2"),
        ("exist(filter_color(all_items, Color.BLUE))", "exist(filter_obj(all_items, lambda x: is_blue(x)))"),
        ("exist(filter_obj(all_items, is_blue))", "exist(filter_obj(all_items, lambda x: is_blue(x)))"),
        (
            "exist(filter_obj(all_items, lambda q: q.color == Color.BLUE))",
            "exist(filter_obj(all_items, lambda x: is_blue(x)))",
        ),
        (
            "exist(filter_shape(filter_color(all_items, Color.BLUE), Shape.CIRCLE))",
            "exist(filter_obj(all_items, lambda x: is_blue(x) and is_circle(x)))",
        ),
        (
            "exist(filter_obj(all_items, lambda x: is_circle(x) and is_blue(x)))",
            "exist(filter_obj(all_items, lambda x: is_blue(x) and is_circle(x)))",
        ),
        ("count(filter_obj(all_boxes, lambda b: b.is_tower())) == 3", "All(all_boxes, lambda x: x.is_tower())"),
        ("Any(all_boxes, lambda b: b.is_tower())", "exist(filter_obj(all_boxes, lambda x: x.is_tower()))"),
        ("count(all_boxes[0].all_items_in_box()) == 2", "count(all_boxes[0]) == 2"),
        (
            "exist(filter_obj(all_items, lambda x: get_above(x)))",
            "exist(filter_obj(all_items, lambda x: exist(get_above(x))))",
        ),
        (
            "exist(filter_obj(all_items, lambda x: is_touching_wall(x, Side.ANY)))",
            "exist(filter_obj(all_items, lambda x: is_touching_wall(x)))",
        ),
        ("1 <= count(all_items) <= 3", "exist(all_items) and count(all_items) <= 3"),
        ("all_same(query_color(all_items))", "all_same_color(all_items)"),
        ("equal_int(count(all_items), 2)", "count(all_items) == 2"),
    ],
)
def test_canonical_form__is_unique_for_equivalent_programs(source, expected):
    assert canonical(source) == expected
    assert canonical(expected) == expected


ONE_ITEM = scene_of("square 0,0 small blue")


@pytest.mark.parametrize(
    ("source", "scene"),
    [
        ("Any(all_boxes, lambda b: is_square(unique(b)))", ONE_ITEM),
        ("not count(filter_obj(all_boxes, lambda b: is_circle(unique(b)))) == 3", ONE_ITEM),
        ("All(all_items, lambda x: exist(filter_color(all_items, Size.SMALL)))", ONE_ITEM),
        ("NOT(equal_color(unique(all_items).color, Size.SMALL))", ONE_ITEM),
        ("OR(True, OR(all_boxes, True))", Scene.empty()),
        ("not exist(all_items.all_items_in_box())", Scene.empty()),
        ("All(all_items, lambda x: all_items and is_blue(x))", ONE_ITEM),
        ("All(all_items, lambda x: exist(get_above(x)) and is_blue(x.box))", ONE_ITEM),
        ("exist(set([all_items])) or True", ONE_ITEM),
        ("not AND(True, exist(filter_obj(union(all_boxes, all_items), lambda b: b.is_tower())))", ONE_ITEM),
    ],
)
def test_canonical_form__keeps_the_value_where_a_part_fails_or_has_an_odd_type(source, scene):
    assert bounded_truths(canonical(source), [scene]) == bounded_truths(source, [scene])


def test_canonical_form__of_a_nested_comparison_chain_stays_short():
    assert len(canonical(repeated(25, "(1 <= {1} <= 1)", "1"))) < 2_000


def test_canonical_form__nested_lambdas_get_distinct_variables():
    source = "exist(filter_obj(all_boxes, lambda x: exist(filter_obj(x.all_items_in_box(), lambda x: is_blue(x)))))"
    assert canonical(source) == "exist(filter_obj(all_boxes, lambda x: exist(filter_obj(x, lambda y: is_blue(y)))))"


@pytest.mark.parametrize(
    "source",
    [
        "not (True and False) or not True and not (False or True)",
        "(1 + 2) % 2 == 1 + 2 % 2",
        "min(all_boxes, key=lambda b: count(b)).is_tower()",
        "all_boxes[0:2][1].is_tower() and all_boxes[::2][0].is_tower()",
        "1 in {1, 2} and 3 not in [1]",
        "is_touching_corner(all_items[0], side=Side.LEFT)",
        "(1).is_tower() or Color.BLUE.is_tower()",
    ],
)
def test_source_of__parses_back_to_the_same_tree(source):
    assert parse(source_of(parse(source))) == parse(source)


def test_tree_from_tokens__keeps_a_chain_of_tests_together():
    failing_first = (
        "filter_obj(all_items, lambda x: all_items[1] in all_boxes and all_same_size(all_items) and is_small(x))"
    )
    form = canonical_form(parse(failing_first))  # its last two tests must not change places: the first may fail
    assert tree_from_tokens(prefix_tokens(form)) == form


@pytest.mark.parametrize(
    ("tokens", "reason"),
    [
        ([], "end before"),
        (["exist(1)"], "end before"),
        (["all_items", "all_items"], "1 tokens follow"),
        (["nothing"], "unknown token 'nothing'"),
        (["is_blue(1)", "v0"], "inside only 0 lambdas"),
    ],
)
def test_tree_from_tokens__rejects_invalid_sequences(tokens, reason):
    with pytest.raises(PrefixError, match=reason):
        tree_from_tokens(tokens)


def test_prefix_tokens__reject_constructs_without_tokens():
    with pytest.raises(PrefixError, match=r"no token for all_items\[1:\]"):
        prefix_tokens(parse("exist(all_items[1:])"))
    with pytest.raises(PrefixError, match="no token for 21"):
        prefix_tokens(parse("count(all_items) == 21"))
