"""An appearance that the package does not have, made of the protocol alone: what plays it, and what refuses it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from lilgym_mp import appearances
from lilgym_mp.actions import STOP, Action, ActionError, AddBlock, RemoveBlock, Stop
from lilgym_mp.appearances import Edit, InvalidReason, PlacementRules
from lilgym_mp.arrays import BoolArray
from lilgym_mp.corpus import load_tasks
from lilgym_mp.envs.batched import BatchedEnv
from lilgym_mp.envs.single import LilGymEnv
from lilgym_mp.generator.training_pairs import training_pairs
from lilgym_mp.rules import make_dynamics
from lilgym_mp.scene import Box, Colour, Item, Scene, SceneError, Shape, Size
from lilgym_mp.solver import Solver

NAME = "lamps"
LAMP = Item(40, 40, Shape.CIRCLE, Colour.YELLOW, Size.MEDIUM)
ACTIONS: tuple[Action, ...] = (
    STOP,
    *(AddBlock(box, Colour.YELLOW) for box in range(3)),
    *(RemoveBlock(box) for box in range(3)),
)


class Lamps:
    """Each box has one yellow circle or none."""

    name = NAME
    action_count = len(ACTIONS)
    box_capacity = 1

    def decode(self, index: int) -> Action:
        return ACTIONS[index]

    def encode(self, action: Action) -> int:
        if action not in ACTIONS:
            raise ActionError(f"{action} is not an action of lamps")
        return ACTIONS.index(action)

    def from_array(self, values: Sequence[int]) -> Action:
        return ACTIONS[values[0]]

    def to_array(self, action: Action) -> list[int]:
        return [self.encode(action)]

    def apply(self, scene: Scene, action: Action, rules: PlacementRules) -> Edit:
        assert isinstance(action, AddBlock | RemoveBlock)
        adds, lit = isinstance(action, AddBlock), bool(scene.boxes[action.box].items)
        if adds == lit:
            return Edit(scene, InvalidReason.OVERLAP if adds else InvalidReason.NOTHING_TO_REMOVE)
        return Edit(scene.with_box(action.box, Box((LAMP,) if adds else ())))

    def legal_mask(self, scene: Scene, rules: PlacementRules) -> BoolArray:
        return np.array(
            [isinstance(action, Stop) or self.apply(scene, action, rules).invalid is None for action in ACTIONS]
        )

    def check_scene(self, scene: Scene) -> Scene:
        if any(box.items not in ((), (LAMP,)) for box in scene.boxes):
            raise SceneError("a box of lamps holds one lamp or none")
        return scene


@pytest.fixture(autouse=True)
def corpus(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A corpus of the new appearance, which is known for the time of the test."""
    monkeypatch.setitem(appearances.BUILDERS, NAME, lambda grid: Lamps())
    monkeypatch.setitem(appearances.APPEARANCES, NAME, Lamps())
    lamp = {"x_loc": 40, "y_loc": 40, "type": "circle", "color": "Yellow", "size": 20}
    entries = [
        {
            "id": f"{count}",
            "appearance": NAME,
            "split": "train",
            "statement": f"There are exactly {word} lamps.",
            "program": f"count(all_items) == {count}",
            "starts": [{"id": f"{count}-no", "label": False, "scene": [[], [], [lamp] if count == 3 else []]}],
        }
        for count, word in ((2, "two"), (3, "three"))
    ]
    path = tmp_path / "lamps.jsonl"
    header = {"format": "lilgym_mp-corpus", "version": 1, "name": "lamps", "licence": "MIT"}
    path.write_text("\n".join(json.dumps(line) for line in (header, *entries)) + "\n")
    return str(path)


@pytest.mark.parametrize("start", ["scratch", "flipit"])
def test_third_appearance__gives_equal_results_single_and_batched(corpus: str, start: str):
    single = LilGymEnv(appearance=NAME, start=start, corpus=corpus)
    batch = BatchedEnv(num_envs=16, appearance=NAME, start=start, corpus=corpus)  # so many as are compiled elsewhere
    rng = np.random.default_rng(0)
    observations, _ = batch.reset(seed=7)
    observation, _ = single.reset(seed=7)
    outcomes: list[str] = []
    over = False
    for _ in range(60):
        assert np.array_equal(observation["image"], observations["image"][0])
        assert observation["statement"] == observations["statement"][0]
        masks = batch.action_masks()
        assert np.array_equal(single.action_masks(), masks[0])
        actions = np.array([rng.choice(np.flatnonzero(mask)) for mask in masks])
        observations, rewards, terminated, truncated, _ = batch.step(actions)
        if over:
            observation, _ = single.reset()
            over = False
            continue
        observation, reward, *ends, info = single.step(int(actions[0]))
        assert (reward, *ends) == (rewards[0], terminated[0], truncated[0])
        over = any(ends)
        outcomes += [info["outcome"]] if over else []
    assert "success" in outcomes


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
    with pytest.raises(ValueError, match=r"no expert for appearance 'lamps'; choose from scatter, tower"):
        Solver(make_dynamics(Lamps()))
    with pytest.raises(ValueError, match=r"unknown appearance 'lamps'; choose from scatter, tower"):
        next(training_pairs(NAME, 0))
    for start in ("scratch", "flipit"):
        with pytest.raises(ValueError, match=r"unknown appearance 'lamps'; choose from scatter, tower"):
            load_tasks("generated:1", NAME, start, "train")


def test_third_appearance__is_unknown_unless_registered(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delitem(appearances.BUILDERS, NAME)
    with pytest.raises(ValueError, match=r"unknown appearance 'lamps'"):
        gym.make("lilgym_mp/TowerScratch-v0", appearance=NAME)
