"""Of words that other packages register, nothing is taken for granted but what they declare."""

from __future__ import annotations

import pytest

from lilgym_mp.programs import compile_program
from lilgym_mp.programs.canonical import canonical_form
from lilgym_mp.programs.printing import source_of
from lilgym_mp.programs.values import Color
from lilgym_mp.programs.words import WORDS, IntArg, ItemArg, register_word
from lilgym_mp.scene import BOX_SIDE
from lilgym_mp.solver import Solver
from lilgym_mp.solver.program_features import program_features
from tests.scenes import B, scene, tower
from tests.solver.tasks import check_optimal_actions, mdp, task


@pytest.fixture(autouse=True)
def other_words():
    known = dict(WORDS)

    @register_word("item tests", depends_on="position")
    def is_high(x: ItemArg) -> bool:  # pyright: ignore[reportUnusedFunction]
        """Whether `x` lies in the upper half of its box."""
        return x.bottom >= BOX_SIDE // 2

    @register_word("comparison")
    def is_wider(x: ItemArg, y: ItemArg) -> bool:  # pyright: ignore[reportUnusedFunction]
        """Whether `x` is wider than `y`."""
        return x.right - x.left > y.right - y.left

    @register_word("item tests", depends_on="box")
    def only(x: ItemArg) -> bool:  # pyright: ignore[reportUnusedFunction]
        """Whether `x` is alone in its box."""
        return len(x.box) == 1

    @register_word("attributes", depends_on="box")
    def color_beneath(x: ItemArg) -> bool:  # pyright: ignore[reportUnusedFunction]
        """Whether an item below `x` is black."""
        return any(y.color is Color.BLACK for y in x.box.members if y.top <= x.bottom)

    @register_word("comparison", operator="<=")
    def at_most(a: IntArg, b: IntArg) -> bool:  # pyright: ignore[reportUnusedFunction]
        """Whether a <= b."""
        return a <= b

    yield
    WORDS.clear()
    WORDS.update(known)


@pytest.mark.parametrize("condition", ["is_high(x)", "is_high(x) and not is_close_to_wall(x)"])
def test_solver__finds_all_first_actions(condition):
    dynamics = mdp("scatter")
    state = dynamics.start(task(f"exist(filter_obj(all_items, lambda x: {condition}))"))
    assert check_optimal_actions(dynamics, state, 1) == 1


def test_solver__solves_a_task_about_a_relation():
    pair = "exist(filter_obj(all_items, lambda x: exist(filter_obj(all_items, lambda y: is_wider(x, y)))))"
    assert Solver(mdp("scatter")).solve(task(pair)).steps == 3


def test_word__may_be_called_like_a_function_of_the_generated_code():
    program = compile_program("exist(filter_obj(all_items, only))")
    for shown in (scene(tower(B), tower(B, B)), scene(tower(B, B)), scene()):
        assert program.evaluate(shown) == program.evaluate_reference(shown)


def test_program_features__a_name_does_not_make_a_word_one_about_an_attribute():
    tree = compile_program("exist(filter_obj(all_items, lambda x: color_beneath(x)))").tree
    assert [word.name for word in program_features(tree).relations] == ["color_beneath"]


def test_operator__of_a_word_is_used_in_canonical_forms_and_by_generated_code():
    program = compile_program("at_most(count(all_items), 2)")
    assert source_of(canonical_form(program.tree)) == "count(all_items) <= 2"
    assert program.has_generated_code
    assert [program.evaluate(shown) for shown in (scene(tower(B, B)), scene(tower(B, B, B)))] == [True, False]


def test_canonical_form__leaves_what_may_fail():
    program = "OR(exist(all_items), Any(all_items, lambda x: is_wider(x, x)))"
    assert source_of(canonical_form(compile_program(program).tree)) == program
