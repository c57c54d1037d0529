"""Tokenisation of statements and vocabularies."""

import numpy as np
import pytest

from lilgym_mp.corpus import Vocabulary, VocabularyError, words
from lilgym_mp.corpus.records import check_text
from lilgym_mp.corpus.statement_arrays import default_length
from lilgym_mp.corpus.tokens import PAD, UNKNOWN

VOCABULARY = Vocabulary(("blue", "two"))


def test_words__keep_only_apostrophes_inside_words():
    found = words("There isn't  a Blue-ish block, 2 'at' most!")
    assert found == ("there", "isn't", "a", "blue", "ish", "block", "2", "at", "most")


def test_words__of_other_scripts_are_whole():
    hindi, persian, composed, decomposed = "नीला घन", "می\u200cخواهم", "carr\u00e9", "carre\u0301"
    assert words(hindi) == ("नीला", "घन")
    assert words(check_text("statement", persian)) == (persian,)
    assert words(composed) == words(decomposed)
    assert default_length(["🟦"]) > 0


def test_vocabulary__words_are_sorted_lower_case_and_distinct():
    vocabulary = Vocabulary.from_statements(["Two blue.", "blue TWO at 3"])
    assert vocabulary.words == ("3", "at", "blue", "two")
    assert len(vocabulary) == 6


def test_encode__pads_or_truncates_at_the_end_and_marks_unknown_words():
    encoded = VOCABULARY.encode("Two green blue", 5)
    assert encoded.tolist() == [3, UNKNOWN, 2, PAD, PAD]
    assert encoded.dtype == np.int64
    assert VOCABULARY.encode("Two green blue", 2).tolist() == [3, UNKNOWN]


def test_invalid_values__are_errors_that_name_them():
    with pytest.raises(VocabularyError, match="length must be at least 1, not 0"):
        VOCABULARY.encode("a", 0)
    with pytest.raises(VocabularyError, match="invalid token id 9; choose from 0 to 3"):
        VOCABULARY.decode([9])
    with pytest.raises(VocabularyError, match="duplicate words: a"):
        Vocabulary(("a", "b", "a"))


def test_decode__inverts_encode():
    assert VOCABULARY.decode(VOCABULARY.encode("two green blue", 6)) == ["two", "?", "blue"]


@pytest.mark.parametrize("words_known", [("blue", "two"), ("blue", "x", "xxxx"), ()])
def test_statement__encodes_to_its_token_ids(words_known):
    vocabulary = Vocabulary(words_known)
    encoded = vocabulary.encode("two green blue x", 6)
    assert vocabulary.encode(vocabulary.statement(encoded), 6).tolist() == encoded.tolist()


def test_load__inverts_save(tmp_path):
    vocabulary = Vocabulary.from_statements(["It's caf\u00e9 blue."])
    vocabulary.save(tmp_path / "words.json")
    assert Vocabulary.load(tmp_path / "words.json") == vocabulary


@pytest.mark.parametrize("text", ["", "[]", '{"format": "other", "version": 1, "words": []}', '{"words": ["a"]}'])
def test_load__invalid_files_are_errors_naming_the_file(tmp_path, text):
    (tmp_path / "words.json").write_text(text)
    with pytest.raises(VocabularyError, match=r"words\.json"):
        Vocabulary.load(tmp_path / "words.json")
