"""Shared fixtures: one thread for torch, and a small corpus."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
import torch

from lilgym_mp.actions import Action, Stop
from lilgym_mp.learning.model_file import load_model
from lilgym_mp.programs.compiler import Program
from lilgym_mp.rules import Dynamics, State, Transition
from lilgym_mp.scene import Scene
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


@pytest.fixture
def counted_stops(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The lengths of the episodes that STOP ends. Reading a truth value outside of such a step fails the test."""
    stops: list[int] = []
    playing = False
    step, truth = Dynamics.step, Program.__call__

    def counted(dynamics: Dynamics, state: State, action: Action) -> Transition:
        nonlocal playing
        playing = isinstance(action, Stop)
        stops.extend([state.steps + 1] * playing)
        transition = step(dynamics, state, action)
        playing = False
        return transition

    def truth_in_play(program: Program, scene: Scene) -> bool:
        assert playing, "a truth value was read outside of a STOP"
        return truth(program, scene)

    monkeypatch.setattr(Dynamics, "step", counted)
    monkeypatch.setattr(Program, "__call__", truth_in_play)
    return stops


def weights(run: Path) -> dict[str, torch.Tensor]:
    return load_model(run / "agent.safetensors")[1]


def equal(one: Path, other: Path) -> bool:
    """Whether the agents of two runs have the same weights."""
    first, second = weights(one), weights(other)
    return first.keys() == second.keys() and all(torch.equal(first[name], second[name]) for name in first)
