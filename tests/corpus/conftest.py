"""A small test corpus in both file formats."""

import pytest

from lilgym_mp.corpus import write_corpus
from tests.corpora import register_as_official, small_entries, write_released


@pytest.fixture
def entries():
    return small_entries()


@pytest.fixture
def written(tmp_path):
    """A function that writes entries to a corpus file and returns its path."""

    def write(entries, name="own.jsonl"):
        write_corpus(tmp_path / name, "own", "MIT", entries)
        return tmp_path / name

    return write


@pytest.fixture
def released(tmp_path):
    """A directory of files in the released format, with a test split, of our own statements."""
    return write_released(tmp_path / "released")


@pytest.fixture
def small_release(released, monkeypatch):
    """A directory of two files registered as released: one verified by content, one by numbers."""
    register_as_official(released, monkeypatch)
    return released
