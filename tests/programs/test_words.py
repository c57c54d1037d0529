"""`@word` rejects functions that are not fully declared, with a one-line reason."""

from typing import Any

import pytest

from lilgym_mp.programs.words import WORDS, ItemsArg, WordError, word


def documented(items: ItemsArg) -> bool:
    """Whether there are items."""
    return bool(items)


def undocumented(items: ItemsArg) -> bool:
    return bool(items)


def without_result(items: ItemsArg):
    """Whether there are items."""
    return bool(items)


def untyped_parameter(items: list[Any]) -> bool:
    """Whether there are items."""
    return bool(items)


def not_annotated(items) -> bool:
    """Whether there are items."""
    return bool(items)


def variadic(*items: ItemsArg) -> bool:
    """Whether there are items."""
    return bool(items)


@pytest.mark.parametrize(
    ("function", "reason"),
    [
        (undocumented, "word undocumented needs a docstring"),
        (without_result, "word without_result needs a return annotation"),
        (untyped_parameter, "argument 'items' of word untyped_parameter must be annotated with one of .*ItemsArg"),
        (not_annotated, "argument 'items' of word not_annotated must be annotated with one of .*ItemsArg"),
        (variadic, r"word variadic cannot take variadic arguments such as \*items"),
    ],
)
def test_word__incomplete_declarations_are_rejected(function, reason):
    with pytest.raises(WordError, match=reason):
        word("sets")(function)
    assert function.__name__ not in WORDS


def test_word__a_name_cannot_be_registered_twice():
    with pytest.raises(WordError, match=r"count is already defined in lilgym_mp\.programs\.functions"):
        word("sets", name="count")(documented)


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"group": "magic"}, "unknown group 'magic'; choose from sets, item tests"),
        (
            {"group": "sets", "depends_on": "world"},
            "unknown depends_on 'world'; choose from attributes, position, item, box, scene",
        ),
    ],
)
def test_word__unknown_options_are_rejected_with_the_choices(options, reason):
    with pytest.raises(WordError, match=reason):
        word(**options)
