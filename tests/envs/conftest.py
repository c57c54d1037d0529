"""A corpus of two statements whose episodes can be followed by hand."""

from __future__ import annotations

from pathlib import Path

import pytest

from lilgym_mp.corpus import write_corpus
from tests.scenes import LARGE, SMALL, B, K, circle, scene, tower, triangle


@pytest.fixture(scope="session")
def own_corpus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Tower: "Blue is here." (starts blue-yes, blue-no). Scatter: "Something round." (starts round-yes, round-no)."""
    blue = {
        "id": "blue",
        "appearance": "tower",
        "split": "train",
        "statement": "Blue is here.",
        "program": "exist(filter_color(all_items, Color.BLUE))",
        "starts": [
            {"id": "blue-yes", "label": True, "scene": scene(tower(K), tower(B)).to_json()},
            {"id": "blue-no", "label": False, "scene": scene(tower(K)).to_json()},
        ],
    }
    round_things = {
        "id": "round",
        "appearance": "scatter",
        "split": "train",
        "statement": "Something round.",
        "program": "exist(filter_shape(all_items, Shape.CIRCLE))",
        "starts": [
            {"id": "round-yes", "label": True, "scene": scene([], [circle(0, 70, LARGE)]).to_json()},
            {"id": "round-no", "label": False, "scene": scene([triangle(0, 0, SMALL, B)]).to_json()},
        ],
    }
    path = tmp_path_factory.mktemp("corpus") / "own.jsonl"
    write_corpus(path, "own", "MIT", [blue, round_things])
    return path
