"""Write data/builtin.jsonl.gz from data/builtin_source.toml: find start scenes, check everything.

The same source gives the same bytes. Every statement gets two pairs of start scenes that differ by one item and by
the statement's truth value, and one more start scene for each truth value.
"""

from __future__ import annotations

import argparse
import random
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from lilgym_mp.actions import AddItem, RemoveItem
from lilgym_mp.appearances import APPEARANCES
from lilgym_mp.appearances.placement import fits_box, is_free
from lilgym_mp.appearances.scatter import RELEASED_GRID
from lilgym_mp.corpus import check_corpus, write_corpus
from lilgym_mp.programs import compile_program
from lilgym_mp.rules import RULE_SETS
from lilgym_mp.scene import BOX_COUNT, BOX_SIDE, Box, Colour, Item, Scene, Shape, Size

DATA = Path(__file__).resolve().parents[1] / "data"
SOURCE, TARGET = DATA / "builtin_source.toml", DATA / "builtin.jsonl.gz"
NAME, LICENCE = "lilgym_mp builtin corpus", "MIT"
RULES = RULE_SETS["paper"]
EDIT_LIMIT = RULES.horizon - 1  # the last action is STOP
PAIRS = 2
FLIP_LIMIT = 4  # edits by which every start scene can be flipped
TRIES = 4000

Truth = Callable[[Scene], bool]
Looks = tuple[list[Shape], list[Colour], list[Size]]
ALL_LOOKS: Looks = (list(Shape), list(Colour), list(Size))


class Statement(NamedTuple):
    id: str
    appearance: str
    split: str
    statement: str
    program: str


class Maker(NamedTuple):
    """How scenes of one appearance are drawn, changed by one legal item, and played with."""

    scene: Callable[[random.Random], Scene]
    change: Callable[[random.Random, Scene], Scene]
    edits_from_empty: Callable[[random.Random, Truth], int | None]
    edits_to_flip: Callable[[random.Random, Truth, Scene], int | None]


def statements() -> Iterator[Statement]:
    """The source's statements, ids numbered in its order."""
    for appearance, splits in tomllib.loads(SOURCE.read_text(encoding="utf-8")).items():
        for split, entries in splits.items():
            for number, entry in enumerate(entries, start=1):
                yield Statement(f"{appearance}-{split}-{number:03d}", appearance, split, **entry)


def random_tower(rng: random.Random) -> Scene:
    colours = rng.sample(list(Colour), rng.choice((1, 2, 2, 3, 3, 3)))
    tower = APPEARANCES["tower"]
    scene = Scene.empty()
    for box in range(BOX_COUNT):
        for _ in range(rng.choice((0, 1, 1, 2, 2, 3, 3, 4))):
            scene = tower.apply(scene, tower.from_array([1, box, rng.choice(colours)]), RULES.placement).scene
    return scene


def tower_neighbours(scene: Scene) -> list[Scene]:
    tower = APPEARANCES["tower"]
    edits = (tower.apply(scene, tower.decode(index), RULES.placement) for index in range(1, tower.action_count))
    return [edit.scene for edit in edits if edit.invalid is None]


def changed_tower(rng: random.Random, scene: Scene) -> Scene:
    return rng.choice(tower_neighbours(scene))


@cache
def tower_layer(blocks: int) -> tuple[Scene, ...]:
    """Every tower scene of that many blocks."""
    if blocks == 0:
        return (Scene.empty(),)
    grown = (near for scene in tower_layer(blocks - 1) for near in tower_neighbours(scene))
    return tuple(dict.fromkeys(scene for scene in grown if sum(1 for _ in scene.items()) == blocks))


def tower_edits_from_empty(rng: random.Random, truth: Truth) -> int | None:
    """The fewest edits: the fewest blocks of any scene where the statement is true."""
    layers = (blocks for blocks in range(EDIT_LIMIT + 1) if any(truth(scene) for scene in tower_layer(blocks)))
    return next(layers, None)


def tower_edits_to_flip(rng: random.Random, truth: Truth, start: Scene) -> int | None:
    """The fewest edits after which the statement has the other truth value, by breadth-first search."""
    value = truth(start)
    seen = {start}
    layer = [start]
    for edits in range(1, FLIP_LIMIT + 1):
        reached = dict.fromkeys(near for scene in layer for near in tower_neighbours(scene))
        layer = [scene for scene in reached if scene not in seen]
        if any(truth(scene) != value for scene in layer):
            return edits
        seen.update(layer)
    return None


def random_place(rng: random.Random, side: int, others: tuple[Item, ...]) -> tuple[int, int]:
    """A place in a box: anywhere, often against a wall, a corner or another item."""
    last = BOX_SIDE - side
    x, y = rng.randint(0, last), rng.randint(0, last)
    match rng.choice(("free", "free", "wall", "corner", "beside")):
        case "wall":
            return rng.choice(((0, y), (last, y), (x, 0), (x, last)))
        case "corner":
            return rng.choice((0, last)), rng.choice((0, last))
        case "beside" if others:
            other = rng.choice(others)
            slide = rng.randint(-side // 2, other.side // 2)
            return rng.choice(
                (
                    (other.x - side, other.y + slide),
                    (other.x + other.side, other.y + slide),
                    (other.x + slide, other.y - side),
                    (other.x + slide, other.y + other.side),
                )
            )
    return x, y


def random_look(rng: random.Random, looks: Looks) -> tuple[Shape, Colour, Size]:
    shapes, colours, sizes = looks
    return rng.choice(shapes), rng.choice(colours), rng.choice(sizes)


def with_item(rng: random.Random, scene: Scene, box_index: int, looks: Looks) -> Scene:
    """The scene with one more item where it fits, else the scene as it is."""
    shape, colour, size = random_look(rng, looks)
    box = scene.boxes[box_index]
    for _ in range(20):
        x, y = random_place(rng, size.pixels, box.items)
        item = Item(x, y, shape, colour, size)
        if fits_box(item.kind, x, y) and is_free(item.kind, x, y, box.items):
            return scene.with_box(box_index, Box((*box.items, item)))
    return scene


def random_scatter(rng: random.Random) -> Scene:
    counts = (1, 2, 3, 3)
    looks = (
        rng.sample(list(Shape), rng.choice(counts)),
        rng.sample(list(Colour), rng.choice(counts)),
        rng.sample(list(Size), rng.choice(counts)),
    )
    most = rng.choice((1, 2, 4, 6))
    scene = Scene.empty()
    for box_index in range(BOX_COUNT):
        for _ in range(rng.randint(0, most)):
            scene = with_item(rng, scene, box_index, looks)
    return scene


def changed_scatter(rng: random.Random, scene: Scene) -> Scene:
    box_index = rng.randrange(BOX_COUNT)
    box = scene.boxes[box_index]
    if box.items and rng.random() < 0.5:
        return scene.with_box(box_index, box.without(rng.randrange(len(box.items))))
    return with_item(rng, scene, box_index, ALL_LOOKS)


def played_scatter(rng: random.Random, scene: Scene, removal: float) -> Scene:
    """The scene after a random action on the released grid, or the same where that is invalid."""
    column, row = rng.randrange(RELEASED_GRID[0]), rng.randrange(RELEASED_GRID[1])
    if rng.random() < removal:
        return APPEARANCES["scatter"].apply(scene, RemoveItem(column, row), RULES.placement).scene
    look = random_look(rng, ALL_LOOKS)
    return APPEARANCES["scatter"].apply(scene, AddItem(column, row, *look), RULES.placement).scene


def play_until(rng: random.Random, scene: Scene, goal: Truth, limit: int, removal: float) -> int | None:
    """How many random legal edits it took to reach the goal, None when `limit` were not enough."""
    edits = 0
    for _ in range(6 * limit):
        if goal(scene):
            return edits
        after = played_scatter(rng, scene, removal)
        if after is not scene:
            scene, edits = after, edits + 1
        if edits > limit:
            return None
    return None


def fewest_played(rng: random.Random, scene: Scene, goal: Truth, limit: int, removal: float, plays: int) -> int | None:
    """The fewest edits among random plays, at least 40 and at most `plays`: an upper bound of the true minimum."""
    best: int | None = None
    for play in range(plays):
        if best is not None and (best <= 1 or play >= 40):
            break
        found = play_until(rng, scene, goal, limit if best is None else best - 1, removal)
        best = best if found is None else found
    return best


def scatter_edits_from_empty(rng: random.Random, truth: Truth) -> int | None:
    return fewest_played(rng, Scene.empty(), truth, EDIT_LIMIT, removal=0.05, plays=4000)


def scatter_edits_to_flip(rng: random.Random, truth: Truth, start: Scene) -> int | None:
    value = truth(start)
    return fewest_played(rng, start, lambda scene: truth(scene) != value, FLIP_LIMIT, removal=0.5, plays=150)


MAKERS = {
    "tower": Maker(random_tower, changed_tower, tower_edits_from_empty, tower_edits_to_flip),
    "scatter": Maker(random_scatter, changed_scatter, scatter_edits_from_empty, scatter_edits_to_flip),
}


def near_misses(rng: random.Random, maker: Maker, truth: Truth) -> Iterator[tuple[Scene, Scene]]:
    """Pairs (true, false) of scenes with items that differ by one item."""
    for _ in range(TRIES):
        scene = maker.scene(rng)
        for _ in range(8):
            changed = maker.change(rng, scene)
            if any(scene.items()) and any(changed.items()) and truth(changed) != truth(scene):
                yield (scene, changed) if truth(scene) else (changed, scene)
                break
            scene = changed


def plain_starts(rng: random.Random, maker: Maker, truth: Truth, value: bool) -> dict[Scene, int]:
    """Random scenes where the statement has that truth value, and the edits they need to flip, the farthest first."""
    found: dict[Scene, int] = {}
    for _ in range(400):
        scene = maker.scene(rng)
        if len(found) < 5 and any(scene.items()) and truth(scene) == value:
            edits = maker.edits_to_flip(rng, truth, scene)
            if edits is not None:
                found[scene] = edits
    return dict(sorted(found.items(), key=lambda entry: -entry[1]))


def start_scenes(rng: random.Random, maker: Maker, truth: Truth) -> dict[Scene, int]:
    """The entry's start scenes and the edits they need to flip: true and false ones by turns."""
    chosen: dict[Scene, int] = {}
    for pair in near_misses(rng, maker, truth):
        edits = {scene: maker.edits_to_flip(rng, truth, scene) for scene in pair if scene not in chosen}
        if len(edits) == len(pair) and None not in edits.values():
            chosen.update((scene, needed) for scene, needed in edits.items() if needed is not None)
        if len(chosen) == 2 * PAIRS:
            break
    for value in (True, False):
        others = plain_starts(rng, maker, truth, value)
        chosen.update([(scene, edits) for scene, edits in others.items() if scene not in chosen][:1])
    return chosen


class Built(NamedTuple):
    entry: dict[str, Any]
    edits_from_empty: int | None
    edits_to_flip: list[int]  # by start


def build(statement: Statement) -> Built:
    rng = random.Random(f"{statement.appearance} {statement.statement}")
    maker = MAKERS[statement.appearance]
    truth = compile_program(statement.program).evaluate
    scenes = start_scenes(rng, maker, truth)
    starts = [
        {"id": f"{statement.id}-{letter}", "label": truth(scene), "scene": scene.to_json()}
        for letter, scene in zip("abcdefgh", scenes, strict=False)
    ]
    return Built(
        {**statement._asdict(), "starts": starts},
        maker.edits_from_empty(rng, truth),
        list(scenes.values()),
    )


def complaints(built: Built) -> Iterator[str]:
    labels = Counter(start["label"] for start in built.entry["starts"])
    if min(labels[True], labels[False]) < PAIRS:
        yield f"too few start scenes: {dict(labels)}"
    if built.edits_from_empty is None:
        yield f"not true within {EDIT_LIMIT} edits of the empty scene"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=TARGET, help="file to write (default: %(default)s)")
    out = parser.parse_args().out
    results = [build(statement) for statement in statements()]
    faults = [f"{b.entry['id']} {b.entry['statement']!r}: {fault}" for b in results for fault in complaints(b)]
    for appearance in APPEARANCES:
        mine = [b for b in results if b.entry["appearance"] == appearance]
        from_empty = sorted(Counter(b.edits_from_empty for b in mine).items(), key=str)
        to_flip = sorted(Counter(edits for b in mine for edits in b.edits_to_flip).items(), key=str)
        print(f"{appearance}: {len(mine)} statements; edits from the empty scene: {dict(from_empty)}")
        print(f"{appearance}: {sum(len(b.edits_to_flip) for b in mine)} start scenes; edits to flip: {dict(to_flip)}")
    if faults:
        raise SystemExit("\n".join(faults))
    write_corpus(out, NAME, LICENCE, (b.entry for b in results))
    report = check_corpus(out)
    print(report)
    if not report.ok:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
