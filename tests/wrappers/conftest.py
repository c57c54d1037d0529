"""A small corpus and environments on it, for the tests of wrappers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest

from lilgym_mp.corpus import write_corpus

BLUE_BLOCK = {"x_loc": 40, "y_loc": 80, "type": "square", "color": "#0099ff", "size": 20}
BLACK_BLOCK = {**BLUE_BLOCK, "color": "Black"}
CIRCLE = {"x_loc": 0, "y_loc": 70, "type": "circle", "color": "Yellow", "size": 30}
TRIANGLE = {"x_loc": 60, "y_loc": 5, "type": "triangle", "color": "#0099ff", "size": 10}

ENTRIES: list[dict[str, Any]] = [
    {
        "id": "blue",
        "appearance": "tower",
        "split": "train",
        "statement": "Blue is here.",
        "program": "exist(filter_color(all_items, Color.BLUE))",
        "starts": [
            {"id": "blue-yes", "label": True, "scene": [[BLACK_BLOCK], [BLUE_BLOCK], []]},
            {"id": "blue-no", "label": False, "scene": [[BLACK_BLOCK], [], []]},
        ],
    },
    {
        "id": "pair",
        "appearance": "tower",
        "split": "train",
        "statement": "There are exactly two blocks.",
        "program": "count(all_items) == 2",
        "starts": [{"id": "pair-no", "label": False, "scene": [[BLUE_BLOCK], [], []]}],
    },
    {
        "id": "black",
        "appearance": "tower",
        "split": "dev",
        "statement": "Black is seen somewhere.",
        "program": "exist(filter_color(all_items, Color.BLACK))",
        "starts": [{"id": "black-yes", "label": True, "scene": [[], [], [BLACK_BLOCK]]}],
    },
    {
        "id": "round",
        "appearance": "scatter",
        "split": "train",
        "statement": "Something round.",
        "program": "exist(filter_shape(all_items, Shape.CIRCLE))",
        "starts": [
            {"id": "round-yes", "label": True, "scene": [[], [CIRCLE, TRIANGLE], []]},
            {"id": "round-no", "label": False, "scene": [[TRIANGLE], [], []]},
        ],
    },
]


@pytest.fixture(scope="session")
def corpus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("corpus") / "own.jsonl"
    write_corpus(path, "own", "MIT", ENTRIES)
    return path


@pytest.fixture
def make(corpus: Path) -> Callable[..., gym.Env[Any, Any]]:
    """`make("TowerScratch", split="dev")`: an environment on the small corpus."""

    def make_env(configuration: str, **settings: Any) -> gym.Env[Any, Any]:
        return gym.make(f"lilgym_mp/{configuration}-v0", **{"corpus": str(corpus), **settings})

    return make_env
