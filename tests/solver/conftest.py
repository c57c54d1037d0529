"""A small corpus, so that solving a whole split is fast."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from lilgym_mp.corpus import write_corpus
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from tests.scenes import LARGE, SMALL, B, K, Y, circle, scene, square, tower, triangle

TOWERS = (scene(), scene(tower(B), tower(K, Y), tower(B, B, K)), scene(tower(Y), tower(Y), tower(Y)))
SCATTERED = (
    scene(),
    scene([circle(0, 0, LARGE, B), square(40, 40, colour=K)], [triangle(5, 60, SMALL, Y)], [square(80, 80, colour=B)]),
    scene([circle(0, 70, LARGE, Y)], [circle(33, 33, colour=B), circle(70, 0, LARGE, B)], [triangle(50, 50, LARGE, K)]),
)
STATEMENTS = (
    ("tower", "A blue block is there.", "exist(filter_color(all_items, Color.BLUE))", TOWERS),
    ("tower", "Two towers have two blocks.", "count(filter_obj(all_boxes, lambda b: count(b) == 2)) == 2", TOWERS),
    ("tower", "Each tower has black on top.", "count(filter_obj(all_items, lambda x: is_top(x) and is_black(x))) == 3",
     TOWERS),
    ("scatter", "Three circles are blue.", "count(filter_obj(all_items, lambda x: is_blue(x) and is_circle(x))) == 3",
     SCATTERED),
    ("scatter", "A small thing lies in a corner.",
     "exist(filter_obj(all_items, lambda x: is_small(x) and is_touching_corner(x)))", SCATTERED),
    ("scatter", "Black is below yellow.",
     "exist(filter_obj(all_items, lambda x: is_yellow(x) and exist(filter_color(get_below(x), Color.BLACK))))",
     SCATTERED),
)  # fmt: skip


def entry(index: int, split: str, appearance: str, statement: str, program: str, starts: tuple[Scene, ...]) -> Any:
    name = f"{split}-{index}"
    flips = [
        {"id": f"{name}-{position}", "label": Task("", "", program, True, start).truth(start), "scene": start.to_json()}
        for position, start in enumerate(starts)
    ]
    return {
        "id": name,
        "appearance": appearance,
        "split": split,
        "statement": statement,
        "program": program,
        "starts": flips,
    }


@pytest.fixture(scope="session")
def corpus(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The path of the corpus: for each appearance three statements with three starts each, in train and in dev."""
    path: Path = tmp_path_factory.mktemp("corpus") / "own.jsonl"
    entries = [entry(index, split, *fields) for split in ("train", "dev") for index, fields in enumerate(STATEMENTS)]
    write_corpus(path, "own", "MIT", entries)
    return str(path)
