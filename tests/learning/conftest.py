"""Shared fixtures: one thread for torch, and a small corpus."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch

from tests.corpora import write_own_corpus


@pytest.fixture(autouse=True)
def _single_thread() -> Iterator[None]:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture(scope="session")
def own(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The path of a small corpus."""
    return str(write_own_corpus(tmp_path_factory.mktemp("corpus") / "own.jsonl"))
