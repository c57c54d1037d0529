"""Statements as token ids."""

import gymnasium as gym
import numpy as np
import pytest

from lilgym_mp.corpus import Vocabulary
from lilgym_mp.wrappers import TokenizedStatement

WORDS = ("are", "blocks", "blue", "exactly", "here", "is", "there", "two")  # of tower's train split, sorted
PAD, UNKNOWN = 0, 1


def token_id(word):
    return 2 + WORDS.index(word)


def test_statement__becomes_token_ids(make):
    env = TokenizedStatement(make("TowerScratch"))
    assert env.observation_space["statement"] == gym.spaces.Box(0, len(WORDS) + 1, (8,), np.int64)
    obs, _ = env.reset(options={"task": "blue"})
    assert obs["statement"].tolist() == [token_id("blue"), token_id("is"), token_id("here")] + [PAD] * 5
    assert obs["statement"].dtype == np.int64


def test_words_not_in_the_train_split__are_unknown(make):
    env = TokenizedStatement(make("TowerScratch", split="dev"))
    obs, _ = env.reset(options={"task": "black"})
    assert obs["statement"][:4].tolist() == [UNKNOWN, token_id("is"), UNKNOWN, UNKNOWN]
    assert env.vocabulary.words == WORDS


def test_longer_statement__is_refused_naming_it_or_truncated_on_request(make):
    with pytest.raises(ValueError, match=r"'There are exactly two blocks\.' has 5 words, but length is 3"):
        TokenizedStatement(make("TowerScratch"), length=3)
    env = TokenizedStatement(make("TowerScratch"), length=3, truncate=True)
    obs, _ = env.reset(options={"task": "pair"})
    assert obs["statement"].tolist() == [token_id("there"), token_id("are"), token_id("exactly")]


@pytest.mark.parametrize("length", [0, 2.5, True])
def test_invalid_length__is_refused(make, length):
    with pytest.raises(ValueError, match="length must be a positive whole number"):
        TokenizedStatement(make("TowerScratch"), length=length)


def test_vocabulary__may_be_an_object_or_a_path(make, tmp_path):
    vocabulary = Vocabulary(("blue",))
    vocabulary.save(tmp_path / "words.json")
    for given in (vocabulary, tmp_path / "words.json", str(tmp_path / "words.json")):
        obs, _ = TokenizedStatement(make("TowerScratch"), given).reset(options={"task": "blue"})
        assert obs["statement"][:3].tolist() == [2, UNKNOWN, UNKNOWN]
