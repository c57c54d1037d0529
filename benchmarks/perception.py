"""Accuracy and speed of reading scenes from their images.

For the start scenes of a corpus and for random legal play from them: scenes read back as they were (sets of items by
box), scenes read as others that draw alike, and pictures refused.
Times are CPU seconds of this process, compared with those of drawing the same scenes; nothing is cached.
Run: python benchmarks/perception.py [--corpus lilgym] [--scenes 10000] [--size half|native]
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from time import process_time

import numpy as np

from lilgym_mp.corpus import load_all_tasks
from lilgym_mp.envs.rules import RULE_SETS
from lilgym_mp.perception import PerceptionError, read_scene
from lilgym_mp.scene import Item, Scene
from lilgym_mp.scene.appearances import APPEARANCES, Appearance, make_appearance
from lilgym_mp.scene.render import draw
from lilgym_mp.scene.render.drawing import SHRINKS

EDITS = 12  # per episode


def starts(corpus: str, appearance: str) -> list[Scene]:
    """The distinct start scenes of every available split."""
    sets = load_all_tasks(corpus, [appearance], ["flipit"])
    return list(dict.fromkeys(task.start for tasks in sets for task in tasks))


def played(appearance: Appearance, rules: str, begin: list[Scene], count: int) -> Iterator[Scene]:
    """`count` scenes of random legal edits; every other episode starts with the empty scene."""
    rng = np.random.default_rng(0)
    placement = RULE_SETS[rules].placement
    for step in range(count):
        if step % EDITS == 0:
            scene = Scene.empty() if step // EDITS % 2 else begin[int(rng.integers(len(begin)))]
        legal = np.flatnonzero(appearance.legal_mask(scene, placement)[1:]) + 1
        scene = appearance.apply(scene, appearance.decode(int(rng.choice(legal))), placement).scene
        yield scene


def as_sets(scene: Scene) -> list[list[Item]]:
    return [sorted(box.items) for box in scene.boxes]


def report(name: str, scenes: Iterable[Scene], appearance: str, size: str) -> None:
    drawing = reading = 0.0
    total = equal = refused = 0
    for scene in scenes:
        before = process_time()
        image = draw(scene, size)
        between = process_time()
        try:
            read = read_scene(image, appearance)
        except PerceptionError:
            read = None
        reading += process_time() - between
        drawing += between - before
        total += 1
        refused += read is None
        equal += read is not None and as_sets(read) == as_sets(scene)
        assert read is None or np.array_equal(draw(read, size), image)
    print(
        f"{appearance:8}{name:16}{total:6} scenes  {equal:6} read as they were  {total - equal - refused:4} as others"
        f"  {refused:4} refused"
        f"  {reading / total * 1e6:6.0f} us, drawing {drawing / total * 1e6:.0f} us"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--corpus", default="builtin")
    parser.add_argument("--scenes", type=int, default=10_000, help="scenes of random play per rule set")
    parser.add_argument("--size", choices=sorted(SHRINKS), default="half")
    given = parser.parse_args()
    for name, appearance in ((name, make_appearance(name)) for name in APPEARANCES):
        begin = starts(given.corpus, name)
        read_scene(draw(begin[0], given.size), name)  # fills the tables
        report("starts", begin, name, given.size)
        for rules in RULE_SETS:
            report(f"play, {rules}", played(appearance, rules, begin, given.scenes), name, given.size)


if __name__ == "__main__":
    main()
