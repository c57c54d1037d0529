"""Shared fixtures: one thread for torch, and a small corpus."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
import torch

from lilgym_mp.learning.common.model_file import load_model
from tests.corpora import write_own_corpus, write_three_statements


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


@pytest.fixture(scope="session")
def three(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The path of a corpus of three statements."""
    return str(write_three_statements(tmp_path_factory.mktemp("three") / "three.jsonl"))


def weights(run: Path) -> dict[str, torch.Tensor]:
    return load_model(run / "agent.safetensors")[1]


def equal(one: Path, other: Path) -> bool:
    """Whether the agents of two runs have the same weights."""
    first, second = weights(one), weights(other)
    return first.keys() == second.keys() and all(torch.equal(first[name], second[name]) for name in first)
