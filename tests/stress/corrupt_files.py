"""Loads corrupt corpora: every fault must be reported in one printable line."""

import gzip
import json
import random
import tempfile
from collections import Counter
from itertools import cycle, islice
from pathlib import Path

from lilgym_mp.corpus import CorpusError, load_tasks, write_corpus
from tests.corpora import entry
from tests.stress.hostile_records import spoil

SCENE = [[], [{"x_loc": 10, "y_loc": 10, "type": "circle", "color": "Black", "size": 10}], []]
PROGRAM = "exist(filter_color(all_items, Color.BLACK))"
ENTRY = entry("black", "scatter", "train", "Something is black.", PROGRAM, yes=SCENE)
CORRUPTIONS = ("flip", "cut", "repeat", "spoilt", "deep", "gzip", "not text")


def corrupt(good, corruption, rng):
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
            rows = [json.loads(line) for line in good.splitlines()]
            spoil(rows, rng)
            return "".join(json.dumps(row) + "\n" for row in rows).encode()


def corrupt_corpora(count, seed):
    """Loads `count` corrupt corpora; returns the results by corruption, and messages that cannot be printed.

    Errors other than CorpusError are raised.
    """
    rng = random.Random(seed)
    found, faults = Counter[str](), list[str]()
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "own.jsonl"
        write_corpus(path, "own", "MIT", [ENTRY])
        good = path.read_bytes()
        for corruption in islice(cycle(CORRUPTIONS), count):
            path.write_bytes(corrupt(good, corruption, rng))
            try:
                load_tasks(path, "scatter", rng.choice(("scratch", "flipit")), "train")
                found[f"{corruption}: harmless"] += 1
            except CorpusError as error:
                faults += [] if str(error).isprintable() else [f"{corruption}: {str(error)!r}"]
                found[f"{corruption}: reported"] += 1
    return found, faults
