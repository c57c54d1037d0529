"""Phenomena and forms: each rule on the smallest programs that meet it, and on those that only look like it."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lilgym_mp.contrib.report.phenomena import RULES, SYNTAX_RULES, phenomena, syntactic_phenomena
from lilgym_mp.corpus import load_tasks
from lilgym_mp.corpus.tokens import normalised, statement_form
from lilgym_mp.programs import ProgramError
from tests.scripts import ROOT

ITEMS = "x.all_items_in_box()"

SHOWN = {
    "existence": ["exist(all_items)", "Any(all_items, is_blue)", "not exist(filter_obj(all_items, is_big))"],
    "exact cardinality": [
        "count(all_items) == 3",
        "2 == count(all_items)",
        "equal_int(len(all_items), 2)",
        "count(filter_color(all_items, Color.BLUE)) != 2",
        "count(all_items) % 2 == 1",
        "count(get_set_colors(all_items)) == 2",
    ],
    "soft cardinality": ["ge(count(all_items), 2)", "3 > count(all_items)", "count(all_items) <= 4"],
    "universal": [
        "All(all_items, is_blue)",
        "equal_set(all_items, filter_color(all_items, Color.BLUE))",
        "filter_obj(all_items, is_blue) == all_items",
        "count(all_items) == count(filter_color(filter_shape(all_items, Shape.CIRCLE), Color.BLUE))",
        "contained(all_items, filter_color(all_items, Color.BLUE))",
        f"count(filter_obj(all_boxes, lambda x: exist({ITEMS}))) == 3",
    ],
    "coordination": [
        "Any(all_items, is_blue) and Any(all_items, is_black)",
        "AND(AND(is_blue(all_items[0]), Any(all_items, is_big)), Any(all_items, is_small))",
        "All(all_items, lambda x: is_blue(x) or is_black(x))",
        "exist(union(get_above(all_items), get_below(all_items)))",
        "get_set_colors(all_items) == {Color.BLUE, Color.BLACK}",
    ],
    "negation": [
        "not exist(all_items)",
        "NOT(exist(all_items))",
        "count(all_items) == 0",
        "lt(count(all_items), 1)",
        "Color.BLUE not in get_set_colors(all_items)",
        "exist(all_items) == False",
    ],
    "comparison": [
        "count(filter_color(all_items, Color.BLUE)) > count(filter_color(all_items, Color.BLACK))",
        "all_same_color(all_items)",
        "count(get_set_shapes(all_items)) == 1",
        "equal_size(query_size(all_items[0]), query_size(all_items[1]))",
    ],
    "spatial relation": [
        "Any(all_items, is_top)",
        "exist(filter_obj(all_items, lambda x: is_touching_wall(x, Side.LEFT)))",
        "exist(get_above(all_items))",
    ],
    "presupposition": [
        "is_blue(unique(filter_obj(all_items, is_big)))",
        "exist(min(all_boxes, key=lambda x: count(x)).all_items_in_box())",
        "count(filter_obj(all_items, lambda a: is_big(a))) == 2 and "
        "all_same_color(filter_obj(all_items, lambda b: is_big(b)))",
    ],
    "coreference": [
        "exist(filter_obj(all_items, lambda x: exist(filter_obj(get_above(x), lambda y: "
        "equal_color(query_color(x), query_color(y))))))",
    ],
}

NOT_SHOWN = {
    "exact cardinality": ["count(all_items) == 0", "count(get_set_colors(all_items)) == 1"],
    "soft cardinality": ["count(all_items) < 1", "count(all_items) == 3"],
    "universal": [
        "contained({Color.BLUE}, get_set_colors(all_items))",
        "count(filter_obj(all_items, is_blue)) == 3",
        "count(filter_obj(all_items, is_blue)) == count(filter_obj(all_items, is_black))",
    ],
    "coordination": [
        f"exist(filter_obj(all_boxes, lambda x: count({ITEMS}) == 3 and exist(filter_obj({ITEMS}, is_top))))",
        "exist(filter_obj(all_items, lambda x: is_blue(x) and is_big(x)))",
    ],
    "negation": ["count(all_items) > 0"],
    "comparison": [
        "count(all_items) == 3",
        "count(all_items) == count(filter_obj(all_items, is_blue))",
        "equal_color(query_color(all_items[0]), Color.BLUE)",
    ],
    "spatial relation": ["exist(get_box_exclusive(all_items))", "Any(all_items, is_blue)"],
    "presupposition": [
        "exist(filter_obj(all_items, lambda x: exist(get_above(x)) and is_blue(unique(get_above(x)))))",
        "Any(filter_obj(all_items, is_big), is_blue) and Any(filter_obj(all_items, is_small), is_blue)",
    ],
    "coreference": [
        "exist(filter_obj(all_items, lambda x: exist(filter_obj(get_above(x), lambda x: is_blue(x)))))",
        f"exist(filter_obj(all_boxes, lambda x: exist(filter_obj({ITEMS}, lambda y: y in {ITEMS}))))",
    ],
}

COORDINATION, PREPOSITION = SYNTAX_RULES

OPEN = {
    COORDINATION: [
        "Some corner with two triangles and 1 large square exists.",
        "We see a box with a circle, three squares and a yellow item.",
        "Here stands a stack with a blue block or at least two black blocks.",
        "We find a triangle and a square near the wall.",
        "No circle or triangle that touches the floor is yellow.",
        "Small triangles and squares fill the box.",
    ],
    PREPOSITION: [
        "We see a box with a square on a triangle.",
        "Some stack with at least two blue blocks at the bottom exists.",
        "A yellow block is the top of a stack with four blocks.",
        "In a box with circles and squares in the corners, all are small.",
    ],
}

CLOSED = {
    COORDINATION: [
        "A blue block and a black block exist.",
        "Blue and black triangles fill a box.",
        "Some box with two circles is full and the wall is free.",
        "We see a box with two items and the circle is yellow.",
        "We find a triangle near the wall.",
        "Nothing is here.",
        "",
    ],
    PREPOSITION: [
        "We see a square on a triangle.",
        "A stack with at least two blocks exists.",
        "There is a box with two items of the same colour.",
        "A box with two circles has a triangle at the wall.",
        "On a triangle there lies a square.",
        "",
    ],
}


TABLES = (SHOWN, OPEN), (NOT_SHOWN, CLOSED)


def found(phenomenon, text):
    return phenomenon in (phenomena if phenomenon in RULES else syntactic_phenomena)(text)


@pytest.mark.parametrize("phenomenon", [*RULES, *SYNTAX_RULES])
def test_rule__holds_for_its_examples_alone(phenomenon):
    holds, fails = ({**programs, **statements}.get(phenomenon, []) for programs, statements in TABLES)
    assert holds
    assert [text for text in holds if not found(phenomenon, text)] == []
    assert [text for text in fails if found(phenomenon, text)] == []


@given(st.text())
def test_syntax_rules__accept_any_text(statement):
    assert syntactic_phenomena(statement) <= set(SYNTAX_RULES)


def test_syntax_rules__ignore_case_punctuation_and_digits():
    one = syntactic_phenomena("SOME corner, with 2 triangles and 1 square; exists!")
    assert one == syntactic_phenomena("some corner with two triangles and one square exists") == {COORDINATION}


def test_rules__descriptions_are_documented():
    text = (ROOT / "docs" / "official_data.md").read_text()
    described = {phenomenon: " ".join((rule.__doc__ or "").split()).rstrip(".") for phenomenon, rule in RULES.items()}
    rows = {phenomenon: f"| {phenomenon} | {words[:1].lower()}{words[1:]} |" for phenomenon, words in described.items()}
    missing = [phenomenon for phenomenon, row in rows.items() if row not in text]
    assert not missing, "copy the rules' descriptions into docs/official_data.md"


@pytest.mark.parametrize("word", ["unique", "exist", "min", "all_same", "contained"])
def test_rules__accept_words_used_as_functions(word):
    assert isinstance(phenomena(f"Any(all_boxes, {word})"), frozenset)


def test_phenomena__an_invalid_program_is_an_error():
    with pytest.raises(ProgramError, match="unknown function"):
        phenomena("exists(all_items)")


@pytest.mark.parametrize("appearance", ["tower", "scatter"])
@pytest.mark.long
def test_phenomena__every_builtin_statement_shows_some(appearance):
    tasks = load_tasks("builtin", appearance, "scratch", "train")
    assert [task.id for task in tasks if not phenomena(task.program)] == []


def test_form__replaces_colours_shapes_sizes_and_numbers():
    statement = "At least two Small blue circles, 12 yellow squares and one block."
    assert statement_form(statement) == "at least NUMBER SIZE COLOUR SHAPE NUMBER COLOUR SHAPE and NUMBER block"


def test_normalised__ignores_case_whitespace_and_punctuation():
    assert normalised("A  Blue block, isn't it?") == normalised("a blue block isn't it") == "a blue block isn't it"
