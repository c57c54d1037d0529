"""Statements are compared with their programs as far as the grammar can read them."""

from __future__ import annotations

import random

import pytest

from lilgym_mp.generator import ScenePool
from lilgym_mp.generator.meanings.validation import disagreement

SCENES = ScenePool.sample("tower", random.Random(0), 8).scenes


@pytest.mark.parametrize(
    ("statement", "program", "says"),
    [
        ("There is a blue block.", "exist(filter_obj(all_items, is_blue))", None),
        (
            "There is a blue block.",
            "exist(filter_obj(all_items, lambda x: is_blue(x) and is_top(x)))",
            "says less than",
        ),
        ("There are exactly two blue blocks.", "count(filter_obj(all_items, is_blue)) > 1", "says more than"),
        ("Blueness abounds.", "count(filter_obj(all_items, is_blue)) > 3", None),
    ],
)
def test_disagreement__says_whether_the_statement_says_more_or_less(
    statement: str, program: str, says: str | None
) -> None:
    found = disagreement(statement, program, SCENES)
    assert (found or "").startswith(says or "")
    assert (found is None) == (says is None)
