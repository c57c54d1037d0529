"""Figures on prompts for training language models: speed, variety, difficulty, baselines, overlap with corpora.

Run: python benchmarks/prompts.py [--episodes 400] [--corpora builtin lilgym]
"""

from __future__ import annotations

import argparse
import random
import statistics
import time
from collections import Counter
from collections.abc import Iterable
from itertools import islice

import numpy as np

from lilgym_mp.contrib.rlvr import KINDS, Row, expert_reply, rows, score
from lilgym_mp.contrib.rlvr.rows import dynamics_of
from lilgym_mp.corpus import load_all_tasks
from lilgym_mp.corpus.generator import LEVELS, statements
from lilgym_mp.corpus.held_out import SPLITS as HELD_OUT
from lilgym_mp.corpus.held_out import statement_digest
from lilgym_mp.evaluation.terminal import table
from lilgym_mp.scene.actions import STOP, Action, describe
from lilgym_mp.scene.appearances import make_appearance

APPEARANCES = ("tower", "scatter")
CONSTANT_PLANS = 60


def speed(count: int) -> None:
    """CPU time, so that other processes matter less."""
    lines = []
    for appearance in APPEARANCES:
        for kind in KINDS:
            stream = rows(kind, appearance, 3, seed=7)
            next(stream)
            begun = time.process_time()
            found = list(islice(stream, count))
            cold = count / (time.process_time() - begun)
            begun = time.process_time()
            for row in found:
                _ = row.prompt
            warm = count / (time.process_time() - begun)
            replies = [expert_reply(row) for row in found]
            seconds = [_seconds(reply, row) for reply, row in zip(replies, found, strict=True)]
            micro = 1e6 * statistics.median(seconds)
            lines.append((appearance, kind, round(cold), round(warm), round(micro), round(1e6 * max(seconds))))
    print(table(("appearance", "task", "new rows/s", "prompts/s", "score, median us", "at most us"), lines), "\n")


def _seconds(reply: str, row: Row) -> float:
    begun = time.process_time()
    score(reply, row)
    return time.process_time() - begun


def baselines(count: int) -> None:
    lines = []
    for appearance in APPEARANCES:
        for kind in KINDS:
            found = list(islice(rows(kind, appearance, 3, seed=8, split="dev"), count))
            rng = random.Random(0)
            replies = ([expert_reply(row) for row in found], [random_reply(row, rng) for row in found])
            rates = [100 * statistics.mean(map(_reward, each, found)) for each in replies]
            constants = _constant_replies(kind, appearance, found)
            best = max(statistics.mean(_reward(reply, row) for row in found) for reply in constants)
            lines.append((appearance, kind, *rates, 100 * best))
    print(table(("appearance", "task", "expert, %", "random, %", "best constant, %"), lines), "\n")


def _reward(reply: str, row: Row) -> float:
    return score(reply, row).reward


def random_reply(row: Row, rng: random.Random) -> str:
    """A random plan of legal actions, truth value, or program of a statement of the same level."""
    if row.kind in ("truth", "verify"):
        return rng.choice(("true", "false"))
    if row.kind == "program":
        return next(statements(row.appearance, row.level or 1, rng)).program
    dynamics = dynamics_of(row.appearance)
    state, plan = dynamics.start(row.task), list[Action]()
    while len(plan) < dynamics.horizon and STOP not in plan:
        legal = np.flatnonzero(dynamics.legal_mask(state)).tolist()
        plan.append(dynamics.appearance.decode(rng.choice(legal)))
        state = dynamics.step(state, plan[-1]).state
    return "\n".join(map(describe, plan))


def _constant_replies(kind: str, appearance: str, found: Iterable[Row]) -> list[str]:
    """Replies to give to every row: plans of one edit, both truth values, or ten rows' programs."""
    made = make_appearance(appearance)
    match kind:
        case "plan":
            rng = random.Random(0)
            actions = [made.decode(rng.randrange(1, made.action_count)) for _ in range(CONSTANT_PLANS)]
            return [f"{describe(action)}\nSTOP" for action in actions]
        case "truth" | "verify":
            return ["true", "false"]
        case _:
            return [row.task.program for row in islice(found, 10)]


def lengths(count: int) -> None:
    """The shares of shortest plans by length, in percent, and their variety."""
    lines = []
    for appearance in APPEARANCES:
        for level in LEVELS:
            found = list(islice(rows("plan", appearance, level, seed=9), count))
            steps = Counter(min(row.steps or 0, 8) for row in found)
            lines.append((appearance, level, *(round(100 * steps[length] / count) for length in range(2, 9))))
    print(table(("appearance", "level", *map(str, range(2, 8)), "8 to 12"), lines), "\n")


def variety(counts: Iterable[int]) -> None:
    lines = []
    for appearance in APPEARANCES:
        for level in (1, 3, 5):
            stream, found = rows("truth", appearance, level, seed=10), list[Row]()
            for count in counts:
                found += islice(stream, count - len(found))
                statements = len({row.task.statement for row in found})
                lines.append((appearance, level, count, statements, len({row.task.program for row in found})))
    print(table(("appearance", "level", "rows", "statements", "programs"), lines), "\n")


def overlap(corpora: Iterable[str], count: int) -> None:
    own = {
        statement_digest(row.task.statement)
        for appearance in APPEARANCES
        for level in LEVELS
        for row in islice(rows("truth", appearance, level, seed=11), count)
    }
    for corpus in corpora:
        theirs = {
            statement_digest(task.statement) for tasks in load_all_tasks(corpus, splits=HELD_OUT) for task in tasks
        }
        print(f"{len(own & theirs)} of {len(own)} statements are among the {len(theirs)} of dev and test of {corpus}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--episodes", type=int, default=400)
    parser.add_argument("--corpora", nargs="*", default=["builtin"])
    args = parser.parse_args()
    speed(args.episodes)
    baselines(args.episodes)
    lengths(args.episodes)
    variety((args.episodes, 4 * args.episodes, 16 * args.episodes))
    overlap(args.corpora, args.episodes)


if __name__ == "__main__":
    main()
