"""Normalisation and spelling correction of statements."""

import hashlib
from collections import Counter

import pytest

from lilgym_mp.corpus import load_all_tasks
from lilgym_mp.corpus.spelling import NUMBERS, corrections, normalised_words, plain_words, word_lists

WORDS = (
    "there is are a an the box boxes tower with at least one exactly yellow black blue block triangle triangles "
    "square squares circle not touching does do it of different colors color medium sized wall in three"
)
KNOWN = frozenset(WORDS.split())


@pytest.mark.parametrize(
    ("statement", "words"),
    {
        "There is a box.": "there is a box",
        "Three boxes, two Squares!": "3 boxes 2 squares",
        "a medium-sized circle": "a medium sized circle",
        "it isn't touching the wall": "it is not touching the wall",
        "there's a box that doesn\u2019t touch": "there is a box that does not touch",
        "the box's wall": "the box wall",
        "atleast one": "at least 1",
        "thereis abox": "there is a box",
        "a yelow traingle": "a yellow triangle",
        "trianlges of diferent colors": "triangles of different colors",
        "exactely 03 squars": "exactly 3 squares",
        "apparent zebras arent": "apparent zebras are not",
        "": "",
        "ll the boxes are gray.": "all the boxes are gray",
        "T least 2 boxes": "at least 2 boxes",
        "tleast 2 boxes": "at least 2 boxes",
        "we ll t": "we ll t",
    }.items(),
)
def test_normalised_words__are_plain_and_spelt_right_and_the_first_gets_its_lost_letter_back(statement, words):
    assert normalised_words(statement, KNOWN | {"all", "gray", "we"}) == words.split()


def test_normalised_words__a_word_that_could_be_several_is_kept():
    assert normalised_words("blicks", ["blocks", "bricks"]) == ["blicks"]
    assert normalised_words("tirangle", ["triangle", "triangles"]) == ["triangle"], "the one with the same last letter"


def test_normalised_words__known_words_are_never_changed():
    assert normalised_words("tower towel blok", ["tower", "towel", "blok", "block"]) == ["tower", "towel", "blok"]


@pytest.mark.parametrize(
    ("typed", "read"),
    {
        "bloc": "block",
        "hte": "the",
        "squere": "square",
        "riangle": "triangle",
        "colour": "color",
        "blocks": "block",
        "bxo": "box",
        **{word: word for word in ("look", "green", "around", "when", "lock", "blxxk", "on", "last", "black")},
        **{word: word for word in ("inside", "hexagn", "abot", "bix", "own", "nearby")},
    }.items(),
)
def test_normalised_words__corrects_only_to_words_that_are_spelt_right(typed, read):
    mistyped = ("blook", "greey", "blokc", "blocs", "hve", "hexagon", "about")
    known = KNOWN | {*mistyped, "then", "ground", "down", "nearly"}
    known = (known | {"side", "least"}) - {typed}
    assert normalised_words(typed, known) == [read]
    assert corrections(f"A box, {typed.upper()}!", known) == ({typed: read} if typed != read else {})


def test_normalised_words__never_correct_other_words():
    assert not word_lists().others & word_lists().well_spelt
    for word in sorted(word_lists().others):
        assert normalised_words(word, word_lists().well_spelt) == [word]


@pytest.mark.parametrize(
    "written", ["Look, every box is black!", "look, every box is black", '"Look", every box is BLACK.']
)
def test_normalised_words__an_unknown_first_word_before_a_comma_is_left_out(written):
    assert normalised_words(written, KNOWN | {"every"}) == ["every", "box", "is", "black"]
    assert corrections(written, KNOWN | {"every"}) == {"look": ""}
    assert normalised_words("yellow, black", KNOWN) == ["yellow", "black"]


def test_normalised_words__very_long_words_are_kept():
    assert normalised_words("x" * 10_000, KNOWN) == ["x" * 10_000]
    assert len(normalised_words("qzfw yelow " * 5_000, KNOWN)) == 10_000


def test_normalised_words__common_words_never_become_numbers():
    kept = "there on the right often someone alone fine line tow tree for"
    assert normalised_words(kept, KNOWN | {"some", "any", "of", "al"}) == kept.split()
    assert NUMBERS.keys() <= word_lists().well_spelt
    assert normalised_words("thhree fuor twoblocks", KNOWN | {"blocks"}) == ["3", "4", "2", "blocks"]


@pytest.mark.long
def test_corrections__of_the_builtin_corpus_become_numbers_only_where_misspelt():
    statements = {task.statement for tasks in load_all_tasks("builtin") for task in tasks}
    train = {task.statement for tasks in load_all_tasks("builtin", splits=["train"]) for task in tasks}
    counts = Counter(word for statement in train for word in set(plain_words(statement)))
    found = corrections(" ".join(statements), frozenset(word for word, count in counts.items() if count > 1))
    assert found["blcak"] == "black"
    assert {word: found[word] for word in found if found[word] in NUMBERS} == {"fuor": "four", "thhree": "three"}


def test_plain_words__of_the_builtin_statements_are_those_that_shipped_parsers_were_trained_on():
    statements = sorted({task.statement for tasks in load_all_tasks("builtin", starts=["scratch"]) for task in tasks})
    digest = hashlib.sha256("\n".join(" ".join(plain_words(statement)) for statement in statements).encode())
    assert digest.hexdigest()[:16] == "ff7834a37773ef79"
