"""A small handwritten corpus in both file formats, for tests that corrupt it."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import pytest

from lilgym_mp.corpus.faults import FaultLog
from lilgym_mp.corpus.official.release import FileFacts, content_digest
from lilgym_mp.corpus.released import ReleasedFile

BLUE_BLOCK = {"x_loc": 40, "y_loc": 80, "type": "square", "color": "#0099ff", "size": 20}
BLACK_BLOCK = {**BLUE_BLOCK, "color": "Black"}
CIRCLE = {"x_loc": 0, "y_loc": 70, "type": "circle", "color": "Yellow", "size": 30}

ENTRIES: list[dict[str, Any]] = [
    {
        "id": "blue",
        "appearance": "tower",
        "split": "train",
        "statement": "Blue is here.",
        "program": "exist(filter_color(all_items, Color.BLUE))",
        "starts": [
            {"id": "blue-yes", "label": True, "scene": [[BLUE_BLOCK], [], []]},
            {"id": "blue-no", "label": False, "scene": [[BLACK_BLOCK], [], []]},
        ],
    },
    {
        "id": "pair",
        "appearance": "tower",
        "split": "train",
        "statement": "Two blocks, it's all.",
        "program": "count(all_items) == 2",
        "starts": [{"id": "pair-no", "label": False, "scene": [[BLUE_BLOCK], [], []]}],
    },
    {
        "id": "round",
        "appearance": "scatter",
        "split": "dev",
        "statement": "Something round.",
        "program": "exist(filter_shape(all_items, Shape.CIRCLE))",
        "starts": [{"id": "round-yes", "label": True, "scene": [[], [CIRCLE], []]}],
    },
]


def small_entries() -> list[dict[str, Any]]:
    """A copy of the entries, which the caller may change."""
    return copy.deepcopy(ENTRIES)


def write_released(directory: Path) -> Path:
    """Writes the Tower test split in the released file format and returns its directory."""
    directory.mkdir()
    blue, pair, _ = ENTRIES
    scratch = {"7": {"sentence": blue["statement"], "lf": blue["program"]}}
    (directory / "tower_scratch_test.json").write_text(json.dumps(scratch))
    flipit = {
        start["id"]: {
            "sentence": entry["statement"],
            "lf": entry["program"],
            "label": str(start["label"]).lower(),
            "structured_rep": start["scene"],
            "identifier": entry["id"],
        }
        for entry in (blue, pair)
        for start in entry["starts"]
    }
    (directory / "tower_flipit_test.json").write_text(json.dumps(flipit))
    return directory


def register_as_official(directory: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, bytes]:
    """Registers `write_released`'s files as official, one by digest and one by counts, and returns their bytes."""
    names = ("tower_scratch_test.json", "tower_flipit_test.json")
    records = ReleasedFile(directory / names[0], "scratch").records(FaultLog(stop_at_first=True))
    facts = {names[0]: FileFacts(1, 1, content_digest(records)), names[1]: FileFacts(3, 3)}
    monkeypatch.setattr("lilgym_mp.corpus.official.release.FILE_FACTS", facts)
    return {name: (directory / name).read_bytes() for name in names}
