"""A small corpus and environments on it, for the tests of wrappers."""

import gymnasium as gym
import pytest

from lilgym_mp.corpus import write_corpus
from tests.corpora import BLACK, BLUE, PAIR, ROUND


@pytest.fixture(scope="session")
def corpus(tmp_path_factory):
    path = tmp_path_factory.mktemp("corpus") / "own.jsonl"
    write_corpus(path, "own", "MIT", [BLUE, {**PAIR, "statement": "There are exactly two blocks."}, BLACK, ROUND])
    return path


@pytest.fixture
def make(corpus):
    """`make("TowerScratch", split="dev")`: an environment on the small corpus."""

    def make_env(configuration, **settings):
        return gym.make(f"lilgym_mp/{configuration}-v0", **{"corpus": str(corpus), **settings})

    return make_env
