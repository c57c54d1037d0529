"""Generated statements agree with their programs, and the grammar parses English correctly."""

from __future__ import annotations

import random
from itertools import islice

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from lilgym_mp.corpus.tokens import normalised, statement_form
from lilgym_mp.generator import LEVELS, Draft, ScenePool, drafts, random_meaning, realise, validate_draft
from lilgym_mp.generator.meanings.interpretation import STANDARD, Interpretation, holds
from lilgym_mp.generator.meanings.program_realisation import program_source
from lilgym_mp.generator.meanings.semantics import (
    AtWall,
    BoxCount,
    Clause,
    Compound,
    Count,
    CountComparison,
    Description,
    EveryItem,
    Matches,
    NounPhrase,
    Order,
    Partitive,
    PartitiveCount,
    RelatedTo,
    Relation,
    Wall,
)
from lilgym_mp.generator.meanings.statement_grammar import parse_statement
from lilgym_mp.generator.noise import with_typo
from lilgym_mp.generator.quantities import NONE, SOME, at_least, exactly
from lilgym_mp.programs import compile_program
from lilgym_mp.scene import Colour, Item, Scene, Shape, Size

POOLS = {appearance: ScenePool.sample(appearance, random.Random(1), 20) for appearance in ("tower", "scatter")}
APPEARANCE = st.sampled_from(sorted(POOLS))

BLUE, BLACK = Description(colours=frozenset({Colour.BLUE})), Description(colours=frozenset({Colour.BLACK}))
CIRCLE, SQUARE = Description(Shape.CIRCLE), Description(Shape.SQUARE)
MEANINGS: dict[str, Clause] = {
    "at least two blue": Count(at_least(2), NounPhrase(BLUE)),
    "no circle": Count(NONE, NounPhrase(CIRCLE)),
    "circle at the left wall": Count(SOME, NounPhrase(CIRCLE, (AtWall(Wall.LEFT),))),
    "all black items are circles": EveryItem(NounPhrase(BLACK), Matches(CIRCLE)),
    "more circles than squares": CountComparison(NounPhrase(CIRCLE), Order.MORE, NounPhrase(SQUARE)),
    "two boxes with one circle": BoxCount(exactly(2), (Count(exactly(1), NounPhrase(CIRCLE)),)),
    "circle touching a square": Count(SOME, NounPhrase(CIRCLE, (RelatedTo(Relation.TOUCHING, NounPhrase(SQUARE)),))),
    "two circles, both black": PartitiveCount(exactly(2), NounPhrase(CIRCLE), Partitive.ALL, Matches(BLACK)),
    "blue but no circle": Compound(True, (Count(SOME, NounPhrase(BLUE)), Count(NONE, NounPhrase(CIRCLE)))),
}


def truths(program: str, appearance: str) -> list[bool]:
    return [compile_program(program).evaluate(scene) for scene in POOLS[appearance].scenes]


@settings(max_examples=80)
@given(APPEARANCE, st.sampled_from(LEVELS), st.integers(0, 10**9))
def test_statement__parses_to_the_meaning_of_its_program(appearance: str, level: int, seed: int):
    draft = next(drafts(appearance, level, random.Random(seed)))
    parses = parse_statement(draft.statement)
    assume(parses)  # test_grammar__covers_nearly_all_drafts counts the rest
    scenes = POOLS[appearance].scenes[::7]
    program = compile_program(draft.program).evaluate
    for parse in parses:
        wrong = [scene.to_json() for scene in scenes if holds(parse, scene) != program(scene)]
        assert not wrong, f"{draft.statement!r} parsed as {parse} differs from {draft.program} on {wrong[0]}"


@pytest.mark.parametrize("appearance", POOLS)
def test_grammar__covers_nearly_all_drafts(appearance: str):
    sample = [draft for level in LEVELS for draft in islice(drafts(appearance, level, random.Random(8)), 200)]
    assert sum(not parse_statement(draft.statement) for draft in sample) <= 0.01 * len(sample)


@settings(max_examples=30)
@given(APPEARANCE, st.sampled_from(LEVELS), st.integers(0, 10**9))
def test_program__is_true_where_its_meaning_holds(appearance: str, level: int, seed: int):
    meaning = random_meaning(appearance, level, random.Random(seed))
    program = compile_program(program_source(meaning)).evaluate
    assert all(holds(meaning, scene) == program(scene) for scene in POOLS[appearance].scenes[::7])


@pytest.mark.parametrize("case", MEANINGS)
def test_realise__gives_many_wordings_with_the_same_meaning(case: str):
    meaning = MEANINGS[case]
    program = program_source(meaning)
    texts = {realise(meaning, "scatter", 1, random.Random(seed)).statement for seed in range(30)}
    assert len(set(map(normalised, texts))) >= 5
    expected = truths(program, "scatter")
    for text in texts:
        for parse in parse_statement(text):
            assert truths(program_source(parse), "scatter") == expected, f"{text!r} is not {program}"


YELLOW_CIRCLE = Item(0, 70, Shape.CIRCLE, Colour.YELLOW, Size.LARGE)  # in the lower left corner
BLACK_SQUARE = Item(30, 80, Shape.SQUARE, Colour.BLACK, Size.MEDIUM)  # on the floor, touching the circle
BLUE_SQUARE = Item(50, 20, Shape.SQUARE, Colour.BLUE, Size.SMALL)  # in the air
SCENE = Scene.of([YELLOW_CIRCLE, BLACK_SQUARE], [BLUE_SQUARE], [])


@pytest.mark.parametrize(
    ("statement", "truth"),
    [
        ("There are exactly two squares.", True),
        ("there are 3 squares", False),
        ("at least two things touch the floor", True),
        ("A yellow circle sits in a corner.", True),
        ("A small square is in a corner.", False),
        ("The only circle touches a square.", True),
        ("No square is touching another square.", True),
        ("All of the squares are black.", False),
        ("Not every square is black.", True),
        ("Only big items touch the left wall.", True),
        ("There are more squares than circles.", True),
        ("There is exactly 1 more square than circles.", True),
        ("The right box is empty.", True),
        ("The middle box has as many objects as the right one.", False),
        ("There is a box with a circle and a square but no blue items.", True),
        ("Exactly two boxes contain a square.", True),
        ("Each box has a different number of items.", True),
        ("The box with the most items has a circle.", True),
        ("There are two squares, and neither of them touches the right wall.", True),
        ("Either there is a triangle or the middle box has a blue square.", True),
        ("A blue square is above a circle in the same box.", False),
    ],
)
def test_parse_statement__has_the_truth_value_a_person_gives(statement: str, truth: bool):
    parses = parse_statement(statement)
    assert {holds(parse, SCENE) for parse in parses} == {truth}


def test_parse_statement__rejects_other_text():
    assert parse_statement("Blue is a lovely colour.") == []
    assert parse_statement("") == []


def test_parse_statement__finds_both_parses_of_an_ambiguous_statement():
    (outer, inner) = parse_statement("There is a circle touching a square that is not blue.")
    scene = Scene.of(
        [Item(0, 0, Shape.CIRCLE, Colour.BLACK, Size.SMALL), Item(10, 0, Shape.SQUARE, Colour.BLUE, Size.SMALL)], [], []
    )
    assert holds(outer, scene) != holds(inner, scene)


def test_validate_draft__rejects_an_ambiguous_statement():
    statement = "There is a circle touching a square that is not blue."
    for meaning in parse_statement(statement):
        draft = Draft(statement, program_source(meaning), 3)
        assert all(validate_draft(draft, POOLS["scatter"], random.Random(seed)) is None for seed in range(3))


@pytest.mark.parametrize(
    ("statement", "program"),
    [
        ("There are two blue items.", "ge(count(filter_color(all_items, Color.BLUE)), 2)"),  # a bare number is exact
        ("There is a blue item.", "count(filter_color(all_items, Color.BLUE)) == 1"),  # "a" is at least one
        ("There are at most 99 items.", "le(count(all_items), 99)"),  # always true
        ("Blue is a lovely colour.", "exist(filter_color(all_items, Color.BLUE))"),  # it does not parse
    ],
)
def test_validate_draft__rejects_a_program_that_differs_from_the_statement(statement: str, program: str):
    assert validate_draft(Draft(statement, program, 1), POOLS["scatter"], random.Random(0)) is None


def test_holds__depends_on_the_interpretation():
    near = Scene.of([Item(3, 40, Shape.CIRCLE, Colour.BLUE, Size.SMALL)], [], [])
    (meaning,) = parse_statement("A circle touches the left wall.")
    assert not holds(meaning, near, STANDARD)
    assert holds(meaning, near, Interpretation(wall_gap=3))


def test_drafts__come_in_groups_of_one_form():
    sample = list(islice(drafts("scatter", 1, random.Random(5)), 60))
    assert 10 < len({statement_form(draft.statement) for draft in sample}) < 40


def test_drafts__rarely_repeat_a_statement():
    rng = random.Random(3)
    sample = [draft.statement for level in LEVELS for draft in islice(drafts("scatter", level, rng), 40)]
    assert len(set(map(normalised, sample))) > 0.9 * len(sample)


@given(st.integers(0, 10**9))
def test_with_typo__changes_one_word_to_none_of_the_known_words(seed: int):
    statement = "There is a black circle near the wall."
    known = {word.strip(".").lower() for word in statement.split()} | {"back"}
    typed = with_typo(statement, random.Random(seed), known)
    changed = [(old, new) for old, new in zip(statement.split(), typed.split(), strict=True) if old != new]
    assert len(changed) == 1
    ((old, new),) = changed
    assert new.strip(".").lower() not in known
    assert new[0] == old[0]
