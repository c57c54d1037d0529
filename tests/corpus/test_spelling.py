"""Normalisation and spelling correction of statements."""

from __future__ import annotations

import pytest

from lilgym_mp.corpus.spelling import NEVER_NUMBERS, NUMBERS, normalised_words, plain_words

WORDS = (
    "there is are a an the box boxes tower with at least one exactly yellow black blue block triangle triangles "
    "square squares circle not touching does do it of different colors color medium sized wall in three"
)
KNOWN = frozenset(WORDS.split())


@pytest.mark.parametrize(
    ("statement", "words"),
    [
        ("There is a box.", "there is a box"),
        ("Three boxes, two Squares!", "3 boxes 2 squares"),
        ("a medium-sized circle", "a medium sized circle"),
        ("it isn't touching the wall", "it is not touching the wall"),
        ("there's a box that doesn\u2019t touch", "there is a box that does not touch"),
        ("the box's wall", "the box wall"),
        ("atleast one", "at least 1"),
        ("thereis abox", "there is a box"),
        ("a yelow traingle", "a yellow triangle"),
        ("trianlges of diferrent colours", "triangles of different colors"),
        ("exactely 03 squars", "exactly 3 squares"),
        ("zebra", "zebra"),
        ("", ""),
    ],
)
def test_normalised_words__plain_words(statement: str, words: str) -> None:
    assert normalised_words(statement, KNOWN) == words.split()


def test_normalised_words__ambiguous_corrections_are_not_made() -> None:
    assert normalised_words("bat", ["cat", "bar"]) == ["bat"]
    assert normalised_words("bqr", ["bar", "cqr"]) == ["bar"], "the one with the same first and last letter"


def test_normalised_words__known_words_are_never_changed() -> None:
    assert normalised_words("tower towel", ["tower", "towel"]) == ["tower", "towel"]


def test_normalised_words__corrects_one_edit_in_short_words_and_two_in_long_ones() -> None:
    assert normalised_words("blcok blxxk", KNOWN) == ["block", "blxxk"]
    assert normalised_words("trxangxe", KNOWN) == ["triangle"]


def test_normalised_words__very_long_words_are_kept() -> None:
    assert normalised_words("x" * 10_000, KNOWN) == ["x" * 10_000]
    assert len(normalised_words("qzfw yelow " * 5_000, KNOWN)) == 10_000


@pytest.mark.parametrize(
    ("statement", "words"),
    [
        ("ll the boxes are gray.", "all the boxes are gray"),
        ("T least 2 boxes", "at least 2 boxes"),
        ("tleast 2 boxes", "at least 2 boxes"),
        ("we ll t", "we ll t"),
        ("", ""),
    ],
)
def test_first_word__gets_the_letter_back_that_it_has_lost(statement: str, words: str) -> None:
    known = {"all", "at", "least", "the", "boxes", "are", "gray", "we"}
    assert normalised_words(statement, known) == words.split()


def test_plain_words__repairs_nothing():
    assert plain_words("There are Three blck blocks, isn't it?") == [
        "there",
        "are",
        "3",
        "blck",
        "blocks",
        "is",
        "not",
        "it",
    ]


@pytest.mark.parametrize("known", [frozenset(), KNOWN | {"some", "any", "of", "al"}])
def test_normalised_words__common_words_never_become_numbers(known: frozenset[str]) -> None:
    digits = set(NUMBERS.values())
    for word in sorted(NEVER_NUMBERS):
        assert digits.isdisjoint(normalised_words(word, known)), word
    kept = "there on the right often someone"
    assert normalised_words(kept, frozenset()) == kept.split()
    assert normalised_words("thhree fuor twoblocks", known | {"blocks"}) == ["3", "4", "2", "blocks"]


def test_normalised_words__a_word_between_a_number_and_another_stays() -> None:
    assert normalised_words("tow then", KNOWN | {"top", "than"}) == ["tow", "then"]
