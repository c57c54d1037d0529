"""Learning in tests: small, and on one thread, for the processors of a test machine are busy."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch

from tests.own_corpus import write_own_corpus


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture(scope="session")
def own(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The path of a small corpus of our own."""
    return str(write_own_corpus(tmp_path_factory.mktemp("corpus") / "own.jsonl"))
