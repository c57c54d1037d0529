"""Declaring words of the program language: what a function lacks is told in one line, and no word comes of it."""

from __future__ import annotations

from typing import Any

import pytest

from lilgym_mp.programs.words import WORDS, Items, WordError, word


def documented(items: Items) -> bool:
    """Whether there are items."""
    return bool(items)


def undocumented(items: Items) -> bool:
    return bool(items)


def without_result(items: Items):
    """Whether there are items."""
    return bool(items)


def of_no_kind(items: list[Any]) -> bool:
    """Whether there are items."""
    return bool(items)


def not_annotated(items) -> bool:
    """Whether there are items."""
    return bool(items)


def of_many(*items: Items) -> bool:
    """Whether there are items."""
    return bool(items)


@pytest.mark.parametrize(
    ("function", "said"),
    [
        (undocumented, "the word undocumented needs a docstring"),
        (without_result, "the word without_result needs an annotation of its result"),
        (of_no_kind, "argument 'items' of the word of_no_kind must be annotated with one of .*Items"),
        (not_annotated, "argument 'items' of the word not_annotated must be annotated with one of .*Items"),
        (of_many, r"the word of_many cannot take any number of arguments, as \*items"),
    ],
)
def test_word__what_a_function_lacks_is_told(function: Any, said: str) -> None:
    with pytest.raises(WordError, match=said):
        word("sets")(function)
    assert function.__name__ not in WORDS


def test_word__a_name_is_taken_once() -> None:
    with pytest.raises(WordError, match=r"there is a word count already, in lilgym_mp\.programs\.functions"):
        word("sets", name="count")(documented)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"group": "magic"}, "unknown group 'magic'; choose from sets, item tests"),
        (
            {"group": "sets", "depends_on": "world"},
            "unknown depends_on 'world'; choose from attributes, position, item, box, scene",
        ),
    ],
)
def test_word__unknown_options_are_refused_with_the_choices(options: dict[str, Any], said: str) -> None:
    with pytest.raises(WordError, match=said):
        word(**options)
