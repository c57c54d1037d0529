"""Corrupt corpora and run directories: every fault is told in one printable line, and nothing else comes of it.

Run: python -m checks.corrupt_files --count 500
"""

from __future__ import annotations

import argparse
import contextlib
import gzip
import io
import json
import random
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

from lilgym_mp.cli import main as run_command
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
ODD: tuple[Any, ...] = (
    None, True, 0, -1, 10**30, 1.5, float("nan"), "", " ", "\x1b[31m", "a" * 10_000, [], [[]], {}, {"a": 1}, "\ud800",
)  # fmt: skip
MISDEEDS = ("flip", "cut", "repeat", "odd value", "lost key", "deep", "gzip", "no text")


def corpus_bytes() -> bytes:
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "good.jsonl"
        write_corpus(path, "own", "MIT", [ENTRY])
        return path.read_bytes()


def corrupted(good: bytes, misdeed: str, chance: random.Random) -> bytes:
    """The bytes of a corpus file with one thing wrong with them, or several."""
    place = chance.randrange(len(good))
    match misdeed:
        case "flip":
            return good[:place] + bytes([chance.randrange(256)]) + good[place + 1 :]
        case "cut":
            return good[:place]
        case "repeat":
            return good + good[place:]
        case "gzip":
            packed = bytearray(gzip.compress(good))
            packed[chance.randrange(len(packed))] ^= 1 << chance.randrange(8)
            return bytes(packed)
        case "deep":
            return good.replace(b'"statement"', b'"statement": ' + b"[" * 100_000 + b', "x"')
        case "no text":
            return bytes(chance.randrange(256) for _ in range(200))
        case _:
            header, line = good.decode().splitlines()
            record = json.loads(line)
            holders = [record, record["starts"][0], record["starts"][0]["scene"][1][0], json.loads(header)]
            holder = chance.choice(holders)
            key = chance.choice(list(holder))
            if misdeed == "lost key":
                del holder[key]
            else:
                holder[key] = chance.choice(ODD)
            return "\n".join((json.dumps(holders[3]), json.dumps(record), "")).encode()


def corrupt_corpora(count: int, seed: int) -> dict[str, int]:
    """Loads `count` corrupt corpora; how often each misdeed was found out. Raises what is not CorpusError."""
    chance, good = random.Random(seed), corpus_bytes()
    found: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as directory:
        for number in range(count):
            misdeed = MISDEEDS[number % len(MISDEEDS)]
            path = Path(directory) / f"{number}.jsonl"
            path.write_bytes(corrupted(good, misdeed, chance))
            try:
                load_tasks(path, "scatter", chance.choice(("scratch", "flipit")), "train")
                found[f"{misdeed}: harmless"] += 1
            except CorpusError as error:
                if not str(error).isprintable():
                    raise AssertionError(f"{misdeed}: {str(error)!r}") from None
                found[f"{misdeed}: told"] += 1
            path.unlink()
    return dict(found)


def said_by(words: list[str]) -> tuple[int, str]:
    """The exit code of a command and what it wrote to the error stream."""
    errors = io.StringIO()
    with contextlib.redirect_stderr(errors), contextlib.redirect_stdout(io.StringIO()):
        code = run_command(words)
    return code, errors.getvalue()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=500, help="corrupt corpora")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    for what, count in sorted(corrupt_corpora(arguments.count, arguments.seed).items()):
        print(f"{count:5} {what}")


if __name__ == "__main__":
    main()
