"""Hostile replies to rows of every kind: none raises, and none takes more than 50 ms of CPU time to score."""

import random
import time
from collections import Counter
from itertools import cycle, islice

from lilgym_mp.contrib.rlvr import KINDS, Conversation, expert_reply, rows, score
from tests.stress.program_language import ATTACKS

MAX_SECONDS = 0.05
MEGABYTE = 1_000_000
PIECES = (
    *("ADD(LEFT, BLUE)", "STOP", "add left blue", "remove", "ADD(", "ADD((((", "true", "false", "<think>", "</think>"),
    *("<answer>", "</answer>", "\\boxed{", "Action:", "Answer: ", "1. "),
    *("\x00", "\x1b[31m", "\ud800", "\u202e", "９", "²"),
    *("\n", "\r\n", " ", "\t", ",", "->"),
    *("{", "}", "[" * 40, "lambda x: ", "exist(all_items)", "9" * 5_000, "-", "`", "*" * 30, "é", "\u2028", "not "),
    *("import os; os.abort()", "__import__('os')", "eval(", "while True: pass", "print(1)", "{{7*7}}", "'; DROP TABLE"),
)
VALUES = (None, 3, 0.5, True, b"STOP", [], ["STOP"], {"action": "STOP"}, object(), float("nan"))


def hostile_replies(rng, example):
    """Endless: values of other types, long repetitions, programs as bombs, random pieces, a right form broken."""
    yield from VALUES
    for piece in PIECES:
        yield piece * (MEGABYTE // len(piece))
        yield piece * (20_000 // len(piece))
        yield (piece + "\n") * (19_000 // (len(piece) + 1))
        yield "<answer>" + piece * (5_000 // len(piece))
    yield from ATTACKS.values()
    yield from (f"{source}\n" * 3 for source in ATTACKS.values())
    while True:
        match rng.randrange(3):
            case 0:
                yield "".join(rng.choices(PIECES, k=rng.randrange(1, 200)))
            case 1:
                cut = rng.randrange(len(example) + 1)
                yield example[:cut] + rng.choice(PIECES) * rng.randrange(1, 50) + example[cut:]
            case _:
                yield "".join(map(chr, rng.choices(range(0x110000), k=rng.randrange(1, 500))))


def examined(count, seed, most_seconds=MAX_SECONDS):
    """Scores `count` replies; returns how many had each outcome, and which took longer."""
    rng = random.Random(seed)
    sources = [
        (row, hostile_replies(rng, expert_reply(row)))
        for kind in KINDS
        for appearance in ("tower", "scatter")
        for row in islice(rows(kind, appearance, 5, seed=seed), 1)
    ]
    outcomes, slow = Counter[str](), list[str]()
    for row, replies in islice(cycle(sources), count):
        reply = next(replies)
        outcome, seconds = _timed(reply, row)
        for _ in range(3):  # on a busy machine, a measurement can be too high
            if seconds > most_seconds:
                seconds = min(seconds, _timed(reply, row)[1])
        if seconds > most_seconds:
            slow.append(f"{seconds:.3f} s for a {row.kind} of {row.appearance}: {str(reply)[:80]!r}")
        outcomes[outcome] += 1
    return outcomes, slow


def _timed(reply, row):
    """The outcome of a reply, and the CPU seconds it took."""
    begun = time.process_time()
    if row.kind == "plan":
        Conversation(row).step(reply)
    return score(reply, row).outcome, time.process_time() - begun
