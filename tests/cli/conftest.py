"""A small corpus."""

import pytest

from tests.corpora import write_own_corpus


@pytest.fixture(scope="session")
def own(tmp_path_factory):
    """The path of a small corpus."""
    return str(write_own_corpus(tmp_path_factory.mktemp("corpus") / "own.jsonl"))
