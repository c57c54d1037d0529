"""Samples statements of the builtin corpus with one start scene each, for a blind check of their labels.

Writes DIR/statements.txt (number, statement, a description of the scene), DIR/NUMBER.png (the scene) and, to be hidden
from the judge, DIR/labels.json ({number: {"id", "label"}}).
"""

from __future__ import annotations

import argparse
import json
import random
from pathlib import Path

from PIL import Image

from lilgym_mp.appearances import APPEARANCES
from lilgym_mp.corpus import load_tasks
from lilgym_mp.corpus.records import SPLITS
from lilgym_mp.render import draw
from lilgym_mp.scene import BOX_SIDE, Box, Item, Scene
from lilgym_mp.task import Task

BOX_NAMES = ("left", "middle", "right")
SIZE_WORDS = ("small", "medium", "large")


def describe(scene: Scene) -> str:
    """One line per box, with distances in pixels from its left wall and floor; a box is 100 x 100."""
    lines = (f"  {name} box: {_contents(box)}" for name, box in zip(BOX_NAMES, scene.boxes, strict=True))
    return "\n".join(lines)


def _contents(box: Box) -> str:
    lowest_first = sorted(box.items, key=lambda item: (-item.y - item.side, item.x))
    return "; ".join(map(_item, lowest_first)) or "empty"


def _item(item: Item) -> str:
    right, top = item.x + item.side, BOX_SIDE - item.y
    item_type = f"{SIZE_WORDS[item.size]} {item.colour.name.lower()} {item.shape.name.lower()}"
    return f"{item_type} (x {item.x} to {right}, height {top - item.side} to {top})"


def sample(appearance: str, count: int, rng: random.Random) -> list[Task]:
    """FlipIt tasks from all splits, with `count` different statements."""
    tasks = [task for split in SPLITS for task in load_tasks("builtin", appearance, "flipit", split)]
    by_statement: dict[str, list[Task]] = {}
    for task in tasks:
        by_statement.setdefault(task.statement, []).append(task)
    return [rng.choice(by_statement[statement]) for statement in rng.sample(sorted(by_statement), count)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0, help="(default: %(default)s)")
    parser.add_argument("--number", type=int, default=100, help="number of statements (default: %(default)s)")
    parser.add_argument("--output", type=Path, required=True, metavar="DIR", help="directory to write to")
    args = parser.parse_args()
    rng = random.Random(args.seed)
    share = args.number // len(APPEARANCES)
    tasks = [task for appearance in APPEARANCES for task in sample(appearance, share, rng)]
    rng.shuffle(tasks)
    args.output.mkdir(parents=True, exist_ok=True)
    texts = [f"{n}. {task.statement}\n{describe(task.start)}\n" for n, task in enumerate(tasks, start=1)]
    (args.output / "statements.txt").write_text("\n".join(texts), encoding="utf-8")
    labels = {n: {"id": task.id, "label": not task.target} for n, task in enumerate(tasks, start=1)}
    (args.output / "labels.json").write_text(json.dumps(labels, indent=1) + "\n", encoding="utf-8")
    for n, task in enumerate(tasks, start=1):
        Image.fromarray(draw(task.start)).save(args.output / f"{n}.png")
    print(f"{len(tasks)} statements with scenes in {args.output}")


if __name__ == "__main__":
    main()
