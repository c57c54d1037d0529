"""An appearance that the package does not have, made of the protocol alone: what plays it, and what refuses it."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from lilgym_mp import testing
from lilgym_mp.corpus import load_tasks
from lilgym_mp.corpus.generator import training_pairs
from lilgym_mp.envs import registration
from lilgym_mp.envs.batched import BatchedEnv
from lilgym_mp.envs.rules import make_dynamics
from lilgym_mp.envs.single import LilGymEnv
from lilgym_mp.scene import appearances
from lilgym_mp.solver import Solver
from tests.envs.lamps import NAME, Lamps


@pytest.fixture(autouse=True)
def known(monkeypatch: pytest.MonkeyPatch) -> None:
    """The new appearance is known for the time of the test."""
    monkeypatch.setitem(appearances.APPEARANCES, NAME, lambda grid: Lamps())
    for start in registration.START_TITLES:
        monkeypatch.setitem(registration.CONFIGURATIONS, registration.configuration_name(NAME, start), (NAME, start))


@pytest.fixture
def corpus(tmp_path: Path) -> str:
    """A corpus of the new appearance."""
    lamp = {"x_loc": 40, "y_loc": 40, "type": "circle", "color": "Yellow", "size": 20}
    entries = [
        {
            "id": f"{count}",
            "appearance": NAME,
            "split": split,
            "statement": f"Exactly {word} of the lamps shine.",
            "program": f"count(all_items) == {count}",
            "starts": [{"id": f"{count}-no", "label": False, "scene": [[], [], [lamp] if count == 3 else []]}],
        }
        for count, word, split in ((2, "two", "train"), (3, "three", "train"), (1, "one", "dev"))
    ]
    path = tmp_path / "lamps.jsonl"
    header = {"format": "lilgym_mp-corpus", "version": 1, "name": "lamps", "licence": "MIT"}
    path.write_text("\n".join(json.dumps(line) for line in (header, *entries)) + "\n")
    return str(path)


@pytest.mark.parametrize("start", ["scratch", "flipit"])
def test_third_appearance__keeps_the_contracts_single_and_batched(corpus: str, start: str):
    settings: Any = {"appearance": NAME, "start": start, "corpus": corpus}
    testing.check_env(lambda: LilGymEnv(**settings))
    testing.check_vector_env(partial(BatchedEnv, **settings), lambda: LilGymEnv(**settings), num_envs=16, steps=20)


@pytest.mark.parametrize("protocol", ["veto", "joint"])
def test_third_appearance__works_in_the_two_agent_game(corpus: str, protocol: str):
    pytest.importorskip("pettingzoo", reason="pettingzoo is not installed: it comes with the extra `pettingzoo`")
    from lilgym_mp.envs.proposer_verifier import parallel_env

    game = parallel_env(appearance=NAME, start="scratch", corpus=corpus, protocol=protocol)
    observations, _ = game.reset(options={"task": "2"})
    rewards: dict[str, float] = {}
    while game.agents:
        lit = sum(bool(box.items) for box in game.scene.boxes)
        wanted = {"proposer_0": lit + 1 if lit < 2 else 0, "verifier_0": int(protocol == "veto" or lit == 2)}
        masks = {agent: observation["action_mask"] for agent, observation in observations.items()}
        actions = {agent: want if masks[agent][want] else int(masks[agent].argmax()) for agent, want in wanted.items()}
        observations, rewards, *_ = game.step(actions)
    assert rewards["proposer_0"] > 0


def test_third_appearance__is_refused_by_expert_and_generator():
    with pytest.raises(ValueError, match=r"appearance 'lamps' has no expert; those that have one: scatter, tower"):
        Solver(make_dynamics(Lamps()))
    with pytest.raises(ValueError, match="no generator of statements; those that have one: scatter, tower"):
        next(training_pairs(NAME, 0))
    for start in ("scratch", "flipit"):
        with pytest.raises(ValueError, match=r"'lamps' has no generator of statements"):
            load_tasks("generated:1", NAME, start, "train")


def test_third_appearance__is_unknown_unless_registered(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delitem(appearances.APPEARANCES, NAME)
    with pytest.raises(ValueError, match=r"unknown appearance 'lamps'"):
        LilGymEnv(appearance=NAME)
