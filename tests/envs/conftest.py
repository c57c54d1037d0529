"""A corpus of two statements whose episodes can be followed by hand."""

import pytest

from lilgym_mp.corpus import write_corpus
from tests.corpora import BLUE, ROUND


@pytest.fixture(scope="session")
def own_corpus(tmp_path_factory):
    """Tower: "Blue is here." (starts blue-yes, blue-no). Scatter: "Something round." (starts round-yes, round-no)."""
    path = tmp_path_factory.mktemp("corpus") / "own.jsonl"
    write_corpus(path, "own", "MIT", [BLUE, ROUND])
    return path
