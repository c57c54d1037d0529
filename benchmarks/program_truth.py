"""Microseconds per evaluation of a program, compared with plain `eval` over list-based functions.

Each program is evaluated on a trace of scenes as in an episode: every scene is new and differs from the previous one in
one box (Scatter: a new box object with one item more or less; Tower: one of the 121 shared boxes). With LILGYM_DATA the
programs are the official train programs, otherwise a few handwritten ones. Run: python benchmarks/program_truth.py
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import random
from pathlib import Path
from statistics import mean, median
from time import perf_counter
from typing import Any

from lilgym_mp.programs import compile_program
from lilgym_mp.scene import Box, Colour, Item, Scene, Shape, Size

OWN_PROGRAMS = (
    "exist(filter_obj(all_items, lambda x: AND(is_blue(x), is_touching_wall(x, Side.LEFT))))",
    "count(filter_obj(all_boxes, lambda b: count(filter_color(b, Color.BLACK)) >= 2)) == 2",
    "All(all_boxes, lambda b: exist(filter_obj(b, lambda x: is_bottom(x) and exist(get_above(x)))))",
    "exist(filter_obj(combinations(all_boxes, 2), lambda p: get_set_colors(p[0]) == get_set_colors(p[1])))",
)


class Thing:
    """An item of the baseline."""

    def __init__(self, item: Item, box: Any) -> None:
        self.box = box
        self.color, self.shape, self.size = item.colour.name, item.shape.name, item.size.name
        self.left, self.right = item.x, item.x + item.side
        self.top, self.bottom = 100 - item.y, 100 - item.y - item.side


class Container:
    """A box of the baseline."""

    def __init__(self, box: Box) -> None:
        self.things = [Thing(item, self) for item in box.items]

    def __iter__(self) -> Any:
        return iter(self.things)

    def all_items_in_box(self) -> list[Thing]:
        return list(self.things)

    def is_tower(self) -> bool:
        squares = all(x.shape == "SQUARE" for x in self.things)
        return bool(self.things) and squares and len({x.right for x in self.things}) == 1


class Names:
    """Color, Shape, Size and Side of the baseline."""

    def __init__(self, **members: str) -> None:
        self.__dict__.update(members)


def baseline_words() -> dict[str, Any]:
    """The words of the official programs, implemented naively on lists."""

    def walls(x: Thing, margin: int) -> dict[str, bool]:
        return {
            "TOP": x.top >= 100 - margin,
            "BOTTOM": x.bottom <= margin,
            "LEFT": x.left <= margin,
            "RIGHT": x.right >= 100 - margin,
        }

    def wall(margin: int) -> Any:
        def test(x: Thing, side: str = "ANY") -> bool:
            return any(walls(x, margin).values()) if side == "ANY" else walls(x, margin)[side]

        return test

    def corner(margin: int) -> Any:
        return lambda x, side="ANY": sum(walls(x, margin).values()) == 2 and wall(margin)(x, side)

    def distance(x: Thing, y: Thing) -> int:
        return max(x.left - y.right, y.left - x.right, x.bottom - y.top, y.bottom - x.top)

    def near(x: Thing, y: Thing, margin: int) -> bool:
        return x is not y and distance(x, y) <= margin

    def related(test: Any) -> Any:
        def get(x: Any) -> set[Thing]:
            return {y for one in ([x] if isinstance(x, Thing) else x) for y in one.box if test(one, y)}

        return get

    def items(x: Any) -> list[Thing]:
        return [x] if isinstance(x, Thing) else list(x)

    def as_set(x: Any) -> set[Any]:
        return set(x) if isinstance(x, list | set | tuple) else {x}

    def unique(s: Any) -> Any:
        (only,) = s
        return only

    def level(number: int) -> Any:
        return lambda x: x.box.is_tower() and x.bottom == 21 * number

    def same(a: Any, b: Any) -> bool:
        return a == b if type(a) is type(b) else as_set(a) == as_set(b)

    words: dict[str, Any] = {
        "exist": lambda s: len(list(s)) > 0,
        "count": lambda s: len({id(x) for x in s}),
        "unique": unique,
        "filter_obj": lambda s, f: [x for x in s if f(x)],
        "union": lambda a, b: set(a) | set(b),
        "intersect": lambda a, b: set(a) & set(b),
        "contained": lambda a, b: all(x in b for x in a),
        "equal_set": lambda a, b: set(a) == set(b),
        "member_of": lambda x, s: x in s,
        "combinations": lambda s, k: list(itertools.combinations(s, k)),
        "is_top": lambda x: x.top == max(y.top for y in x.box),
        "is_bottom": lambda x: x.top == min(y.top for y in x.box),
        "is_second": level(1),
        "is_third": level(2),
        "is_touching_wall": wall(0),
        "is_closely_touching_wall": wall(4),
        "is_touching_corner": corner(0),
        "is_closely_touching_corner": corner(4),
        "is_closely_touching": lambda x, y: (
            min(map(abs, (x.top - y.bottom, x.bottom - y.top, x.left - y.right, x.right - y.left))) <= 4
        ),
        "get_touching": related(lambda x, y: near(x, y, 1)),
        "get_closely_touching": related(lambda x, y: near(x, y, 4)),
        "get_above": related(lambda x, y: x.top <= y.bottom and (not x.box.is_tower() or near(x, y, 1))),
        "get_below": related(lambda x, y: y.top <= x.bottom and (not x.box.is_tower() or near(x, y, 1))),
        "get_box_all_above": related(lambda x, y: x.top <= y.bottom),
        "get_box_all_below": related(lambda x, y: y.top <= x.bottom),
        "all_same_attribute": lambda s, f: len({f(x) for x in s}) == 1,
        "le": lambda a, b: a <= b,
        "ge": lambda a, b: a >= b,
        "lt": lambda a, b: a < b,
        "gt": lambda a, b: a > b,
        "equal_int": lambda a, b: a == b,
        "equal": same,
        "AND": lambda a, b: a and b,
        "OR": lambda a, b: a or b,
        "NOT": lambda a: not a,
        "All": lambda s, f: len(list(s)) > 0 and all(f(x) is True for x in s),
        "Any": lambda s, f: any(f(x) is True for x in s),
        "Color": Names(YELLOW="YELLOW", BLACK="BLACK", BLUE="BLUE"),
        "Shape": Names(CIRCLE="CIRCLE", SQUARE="SQUARE", TRIANGLE="TRIANGLE"),
        "Size": Names(SMALL="SMALL", MEDIUM="MEDIUM", BIG="LARGE"),
        "Side": Names(TOP="TOP", BOTTOM="BOTTOM", LEFT="LEFT", RIGHT="RIGHT", ANY="ANY"),
    }
    for attribute, values in {
        "color": {"yellow": "YELLOW", "black": "BLACK", "blue": "BLUE"},
        "shape": {"circle": "CIRCLE", "square": "SQUARE", "triangle": "TRIANGLE"},
        "size": {"small": "SMALL", "medium": "MEDIUM", "big": "LARGE"},
    }.items():
        for name, value in values.items():
            words[f"is_{name}"] = lambda x, a=attribute, v=value: getattr(x, a) == v
        words[f"query_{attribute}"] = lambda x, a=attribute: [getattr(y, a) for y in items(x)]
        words[f"get_set_{attribute}s"] = lambda s, a=attribute: {getattr(x, a) for x in s}
        words[f"filter_{attribute}"] = lambda s, v, a=attribute: [x for x in s if getattr(x, a) == v]
        words[f"all_same_{attribute}"] = lambda s, a=attribute: len({getattr(x, a) for x in s}) == 1
        words[f"equal_{attribute}"] = same
    return words


def baseline_scene(scene: Scene) -> dict[str, Any]:
    boxes = [Container(box) for box in scene.boxes]
    return {"all_boxes": boxes, "all_items": [x for box in boxes for x in box]}


def tower_boxes() -> list[Box]:
    stacks = (stack for height in range(5) for stack in itertools.product(Colour, repeat=height))
    return [
        Box(tuple(Item(40, 80 - 21 * level, Shape.SQUARE, colour, Size.MEDIUM) for level, colour in enumerate(stack)))
        for stack in stacks
    ]


def random_item(chance: random.Random) -> Item:
    """A random item, often at a wall or in a corner."""
    size = chance.choice(list(Size))
    free = 100 - size.pixels
    x, y = (chance.choice((0, free, chance.randrange(free))) for _ in range(2))
    return Item(x, y, chance.choice(list(Shape)), chance.choice(list(Colour)), size)


def random_scatter_box(chance: random.Random) -> Box:
    """Up to eight random items, which may overlap."""
    return Box(tuple(random_item(chance) for _ in range(chance.randrange(9))))


def trace(appearance: str, length: int, chance: random.Random, towers: list[Box], recorded: list[Box]) -> list[Scene]:
    """A sequence of scenes in which one box changes at a time."""

    def draw() -> Box:
        if appearance == "tower":
            return chance.choice(towers)
        return Box(chance.choice(recorded).items) if recorded else random_scatter_box(chance)

    def edited(box: Box) -> Box:
        """The box with one item more or less."""
        others = draw().items
        if appearance == "tower":
            return draw()
        if box.items and (len(box.items) >= 8 or not others or chance.random() < 0.5):
            return box.without(chance.randrange(len(box.items)))
        return box.with_item(chance.choice(others)) if others else box.with_item(random_item(chance))

    scene = Scene((draw(), draw(), draw()))
    scenes: list[Scene] = []
    for _ in range(length):
        index = chance.randrange(3)
        scene = scene.with_box(index, edited(scene.boxes[index]))
        scenes.append(scene)
    return scenes


def official(directory: Path | None) -> tuple[list[tuple[str, str]], list[Box]]:
    """The (appearance, program) pairs of the train splits, and boxes of Scatter start scenes."""
    if directory is None:
        return [(appearance, source) for appearance in ("tower", "scatter") for source in OWN_PROGRAMS], []
    pairs: dict[tuple[str, str], None] = {}
    recorded: list[Box] = []
    for path in sorted(directory.glob("*_train.json")):
        appearance = path.name.split("_")[0]
        for record in json.loads(path.read_text(encoding="utf-8")).values():
            pairs[appearance, record["lf"]] = None
            if appearance == "scatter" and "structured_rep" in record and len(recorded) < 3000:
                recorded.extend(Scene.from_json(record["structured_rep"]).boxes)
    return list(pairs), recorded


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=20, help="scenes per program")
    parser.add_argument("--every", type=int, default=1, help="use every n-th program")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--slowest", type=int, default=0, help="number of slowest programs to list")
    given = parser.parse_args()
    data = os.environ.get("LILGYM_DATA")
    pairs, recorded = official(Path(data) if data else None)
    chance, towers, words = random.Random(given.seed), tower_boxes(), baseline_words()
    times: dict[str, list[tuple[float, float, float, str]]] = {"tower": [], "scatter": []}
    for appearance, source in pairs[:: given.every]:
        program = compile_program(source)
        scenes = trace(appearance, given.scenes + 3, chance, towers, recorded)
        for scene in scenes[:3]:
            program(scene)
        scenes = scenes[3:]
        start = perf_counter()
        truths = [program(scene) for scene in scenes]
        fast = perf_counter() - start
        start = perf_counter()
        for scene in scenes[:3]:
            program.evaluate_reference(scene)
        reference = (perf_counter() - start) * len(scenes) / 3
        prepared = [words | baseline_scene(scene) for scene in scenes]
        text = source.strip()
        start = perf_counter()
        expected = [eval(text, names) for names in prepared]
        plain = perf_counter() - start
        assert truths == expected, source
        scale = 1e6 / len(scenes)
        times[appearance].append((fast * scale, reference * scale, plain * scale, source))
    times["all"] = times["tower"] + times["scatter"]
    print("us a truth     programs  mean  median    p99 | reference   eval | eval / mean")
    for name, rows in times.items():
        fasts, references, plains, _ = zip(*rows, strict=True)
        high = sorted(fasts)[int(0.99 * len(fasts))]
        print(
            f"{name:14} {len(rows):8} {mean(fasts):5.2f} {median(fasts):7.2f} {high:6.2f} |"
            f" {mean(references):9.1f} {mean(plains):6.1f} | {mean(plains) / mean(fasts):8.1f}x"
        )
    for fast, _, _, source in sorted(times["all"], reverse=True)[: given.slowest]:
        print(f"{fast:8.1f} {source}")


if __name__ == "__main__":
    main()
