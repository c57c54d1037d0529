"""A tiny corpus with tasks for every configuration and split: quick to load, and learnt in a few dozen steps."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lilgym_mp.corpus import write_corpus
from lilgym_mp.scene import Colour, Item, Scene
from tests.scenes import B, K, Y, scene, square, tower

SPLITS = ("train", "dev", "test")
COLOURS = {Y: "yellow", K: "black", B: "blue"}
COLOURS_OF_SPLIT = {"train": (Y, K), "dev": (Y, B), "test": (B,)}


def write_own_corpus(path: Path) -> Path:
    """Writes the corpus and returns its path. A third of the dev statements occur verbatim in train."""
    entries = [
        entry
        for split in SPLITS
        for appearance, items in (("tower", tower), ("scatter", _corner_squares))
        for entry in [*(_has(split, appearance, colour, items) for colour in COLOURS_OF_SPLIT[split]),
                      _counts(split, appearance, items)]
    ]  # fmt: skip
    write_corpus(path, "own", "MIT", entries)
    return path


def _corner_squares(*colours: Colour) -> list[Item]:
    return [square(25 * index, 0, colour=colour) for index, colour in enumerate(colours)]


def _has(split: str, appearance: str, colour: Colour, items: Any) -> dict[str, Any]:
    name = COLOURS[colour]
    other = next(candidate for candidate in COLOURS if candidate != colour)
    return _entry(
        split,
        appearance,
        f"has-{name}",
        f"There is something {name}.",
        f"exist(filter_color(all_items, Color.{name.upper()}))",
        (scene(items(colour)), scene(items(other), items(other))),
    )


def _counts(split: str, appearance: str, items: Any) -> dict[str, Any]:
    count = 1 + SPLITS.index(split)
    return _entry(
        split,
        appearance,
        "count",
        f"Count them: {count}.",
        f"count(all_items) == {count}",
        (scene(items(*[Y] * count)), scene()),
    )


def _entry(
    split: str, appearance: str, name: str, statement: str, program: str, scenes: Sequence[Scene]
) -> dict[str, Any]:
    """A corpus entry; the statement is true in the first scene and false in the second."""
    entry_id = f"{appearance}-{split}-{name}"
    return {
        "id": entry_id,
        "appearance": appearance,
        "split": split,
        "statement": statement,
        "program": program,
        "starts": [
            {"id": f"{entry_id}-{label}", "label": label, "scene": start.to_json()}
            for label, start in zip((True, False), scenes, strict=True)
        ],
    }
