"""Loads corrupt corpora: every fault must be reported in one printable line.

Run: python -m tests.stress.corrupt_files --count 500
"""

from __future__ import annotations

import argparse
import gzip
import json
import random
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

from lilgym_mp.corpus import CorpusError, load_tasks, write_corpus

SCENE = [[], [{"x_loc": 10, "y_loc": 10, "type": "circle", "color": "Black", "size": 10}], []]
ENTRY: dict[str, Any] = {
    "id": "black",
    "appearance": "scatter",
    "split": "train",
    "statement": "Something is black.",
    "program": "exist(filter_color(all_items, Color.BLACK))",
    "starts": [{"id": "black-1", "label": True, "scene": SCENE}],
}
ODD_VALUES: tuple[Any, ...] = (
    None, True, 0, -1, 10**30, 1.5, float("nan"), "", " ", "\x1b[31m", "a" * 10_000, [], [[]], {}, {"a": 1}, "\ud800",
)  # fmt: skip
CORRUPTIONS = ("flip", "cut", "repeat", "odd value", "lost key", "deep", "gzip", "not text")


def corpus_bytes() -> bytes:
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "good.jsonl"
        write_corpus(path, "own", "MIT", [ENTRY])
        return path.read_bytes()


def corrupt(good: bytes, corruption: str, rng: random.Random) -> bytes:
    """The bytes of a corpus file after a corruption."""
    place = rng.randrange(len(good))
    match corruption:
        case "flip":
            return good[:place] + bytes([rng.randrange(256)]) + good[place + 1 :]
        case "cut":
            return good[:place]
        case "repeat":
            return good + good[place:]
        case "gzip":
            packed = bytearray(gzip.compress(good))
            packed[rng.randrange(len(packed))] ^= 1 << rng.randrange(8)
            return bytes(packed)
        case "deep":
            return good.replace(b'"statement"', b'"statement": ' + b"[" * 100_000 + b', "x"')
        case "not text":
            return bytes(rng.randrange(256) for _ in range(200))
        case _:
            header, line = good.decode().splitlines()
            record = json.loads(line)
            holders = [record, record["starts"][0], record["starts"][0]["scene"][1][0], json.loads(header)]
            holder = rng.choice(holders)
            key = rng.choice(list(holder))
            if corruption == "lost key":
                del holder[key]
            else:
                holder[key] = rng.choice(ODD_VALUES)
            return "\n".join((json.dumps(holders[3]), json.dumps(record), "")).encode()


def corrupt_corpora(count: int, seed: int) -> dict[str, int]:
    """Loads `count` corrupt corpora and counts the results by corruption; errors other than CorpusError are raised."""
    rng, good = random.Random(seed), corpus_bytes()
    found: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as directory:
        for index in range(count):
            corruption = CORRUPTIONS[index % len(CORRUPTIONS)]
            path = Path(directory) / f"{index}.jsonl"
            path.write_bytes(corrupt(good, corruption, rng))
            try:
                load_tasks(path, "scatter", rng.choice(("scratch", "flipit")), "train")
                found[f"{corruption}: harmless"] += 1
            except CorpusError as error:
                if not str(error).isprintable():
                    raise AssertionError(f"{corruption}: {str(error)!r}") from None
                found[f"{corruption}: reported"] += 1
            path.unlink()
    return dict(found)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=500, help="number of corrupt corpora")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    for result, count in sorted(corrupt_corpora(args.count, args.seed).items()):
        print(f"{count:5} {result}")


if __name__ == "__main__":
    main()
