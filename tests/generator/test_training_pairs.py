"""Endless statement-program pairs: lilgym_mp.corpus.generator.pairs."""

import hashlib
import random
import re
from functools import cache
from itertools import islice

import pytest

from lilgym_mp.corpus.generator import LEVELS, level_of, statements, training_pairs
from lilgym_mp.corpus.generator.noise import with_noise
from lilgym_mp.corpus.generator.writer import phrase_book
from lilgym_mp.corpus.scene_walks import ScenePool
from lilgym_mp.programs import compile_program
from lilgym_mp.scene import Scene
from lilgym_mp.scene.grouping import grouped
from tests.scenes import B, scene, tower

DIGESTS = {
    "tower": "366ce960182f0117ba3bc8519948a4ce309fe49025bfeb5337c5966425c0be1f",
    "scatter": "5d99669d6cc4912792b4b9907594dd96b6c7d55d247cfa1c7ec167f5058c55cf",
}


def pairs(appearance, number, seed=3, *, noise=False):
    return list(islice(training_pairs(appearance, seed, noise=noise, bound_share=0), number))


@cache
def scenes(appearance, number):
    rng = random.Random(7)
    return rng.sample(ScenePool.sample(appearance, rng, 60).scenes, number)


@pytest.mark.parametrize(("appearance", "digest"), DIGESTS.items())
@pytest.mark.long
def test_training_pairs__stay_the_same(appearance, digest):
    found = repr([tuple(pair) for pair in islice(training_pairs(appearance, 0), 6_000)])
    assert hashlib.sha256(found.encode()).hexdigest() == digest, "trained parsers depend on the stream of pairs"


@pytest.mark.long
def test_training_pairs__about_towers_need_towers():
    found = {pair.statement: pair.program for pair in pairs("tower", 4_000)}

    def programs(wording):
        return [program for text, program in found.items() if re.match(wording, text)]

    for wording in ("not all .* the same ", "(all|the) three .* the same "):
        assert len(programs(wording)) > 2
        for program in map(compile_program, programs(wording)):
            assert not program(scene(tower(B)))
            assert not program(Scene.empty())
    assert {program.count("is_tower()") > 1 for program in programs("the tower with the (fewest|least) ")} == {True}


def test_conditions__have_probabilities(appearance):
    assert sum(phrase_book(appearance).conditions.values()) < 1 + 1e-9


@pytest.mark.long
def test_training_pairs__every_program_evaluates_on_every_scene(appearance):
    pool = [Scene.empty(), *scenes(appearance, 6)]
    for pair in pairs(appearance, 250):
        program = compile_program(pair.program)
        for shown in pool:
            assert program.evaluate(shown) in (True, False), pair


def test_training_pairs__are_mostly_neither_always_true_nor_always_false(appearance):
    pool = scenes(appearance, 60)
    sample = pairs(appearance, 150)
    varied = sum(len({compile_program(pair.program)(scene) for scene in pool}) == 2 for pair in sample)
    assert varied > 0.55 * len(sample)


def test_training_pairs__equal_statements_have_equivalent_programs(appearance):
    pool = scenes(appearance, 60)
    for statement, programs in grouped(pairs(appearance, 1_500, seed=8)).items():
        found = set(programs)
        if len(found) == 1:
            continue
        truths = {tuple(compile_program(program)(scene) for scene in pool) for program in found}
        assert len(truths) == 1, statement


@pytest.mark.long
def test_training_pairs__bare_numbers_are_sometimes_lower_bounds():
    assert not any(program.startswith("ge(") for program in programs_of_bare_numbers(0))
    assert {program.startswith("ge(") for program in programs_of_bare_numbers(1)} == {True, False}


def programs_of_bare_numbers(share):
    pairs = islice(training_pairs("tower", 8, noise=False, bound_share=share), 4_000)
    return [program for text, program in pairs if re.fullmatch(r"there are (\w+) (black|blue|yellow) blocks", text)]


def test_with_noise__adds_no_second_full_stop():
    noisy = {with_noise("Three boxes are empty.", random.Random(seed)) for seed in range(200)}
    assert any(text[:1].islower() for text in noisy)
    assert max(text.count(".") for text in noisy) == 1


@pytest.mark.parametrize("level", LEVELS)
def test_statements__are_of_the_level_and_typed_without_noise(appearance, level):
    for statement, program in islice(statements(appearance, level, random.Random(2)), 60):
        assert level_of(program) == level
        assert re.fullmatch(r"[A-Z0-9][^.]*(\. also [^.]*)?\.", statement), statement
        assert "atleast" not in statement


def test_level_of__grows_with_size_and_needs_words():
    levels = {
        "exist(filter_color(all_items, Color.BLUE))": 1,
        "exist(filter_obj(all_items, is_top))": 2,
        "exist(filter_obj(all_items, lambda x: exist(get_touching(x))))": 3,
        "all_same_attribute(all_boxes, lambda b: count(b.all_items_in_box()))": 4,
        " and ".join(["exist(all_items)"] * 20): 5,
        " and ".join(["exist(all_items)"] * 30): None,
    }
    assert {program: level_of(program) for program in levels} == levels


@pytest.mark.long
def test_statements__leave_out_the_wording_that_people_read_in_two_ways(appearance):
    found = [
        pair.statement for level in (2, 3) for pair in islice(statements(appearance, level, random.Random(5)), 400)
    ]
    assert not [text for text in found if re.match(r"(One|1) (out )?of", text)]
    assert any(text.startswith(("At least one of the", "Exactly one of the", "Only one of the")) for text in found)


def test_statements__unknown_arguments_are_refused():
    with pytest.raises(ValueError, match="6; choose from 1, 2, 3, 4, 5"):
        next(statements("tower", 6, random.Random(0)))
    with pytest.raises(ValueError, match="'mosaic'; choose from scatter, tower"):
        next(statements("mosaic", 1, random.Random(0)))
