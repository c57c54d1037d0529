"""Serves recordings with hostile records: wrong types, extreme numbers, markup, deep nesting.

    python -m tests.stress.hostile_recordings [--count 400] [--seed 0]

Every response must come in time and be no 5xx. `hostile_records` does the same for reports.
"""

from __future__ import annotations

import argparse
import copy
import gzip
import json
import logging
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Any

from lilgym_mp.evaluation import Settings
from lilgym_mp.evaluation.comparison import EvaluationPlan, play, training_statements
from lilgym_mp.evaluation.episodes import SUFFIX
from lilgym_mp.evaluation.policies import built_in_policy
from lilgym_mp.evaluation.recording import Recorder
from tests.corpora import write_thin_corpus
from tests.stress.hostile_records import spoil
from tests.web.web_app import Browser, server

SECONDS = 10.0  # for any response, on a busy machine


def example_recordings(directory: Path) -> list[list[Any]]:
    """The lines of a recording of each appearance, with decisions."""
    corpus = str(write_thin_corpus(directory / "thin.jsonl", 2))
    found = []
    for configuration in ("TowerFlipIt", "ScatterFlipIt"):
        plan = EvaluationPlan(Settings(configuration, corpus=corpus), "dev", record_decisions=True)
        seen = training_statements(plan.settings)
        recorder = Recorder(plan.settings, plan.split, seen, judges_decisions=configuration.startswith("Tower"))
        path = recorder.write(directory / configuration, play(built_in_policy("random-legal"), plan, seen))
        found.append([json.loads(line) for line in gzip.decompress(path.read_bytes()).splitlines()])
    return found


def responses(browser: Browser) -> Iterator[tuple[str, Any]]:
    """What the pages on recordings ask for."""
    base = "/api/watch/recordings"
    paths = [base, "/api/explore/statements?appearance=tower&split=dev", "/watch"]
    for line in browser.get(base).json()["recordings"]:
        own = f"{base}/{line['id']}"
        paths += [own, f"{own}/episodes", f"{own}/episodes?success=true&text=a"]
        paths += [f"{own}/episodes/{index}" for index in range(4)]
    for path in paths:
        yield path, browser.get(path)


def attack(count: int, seed: int) -> tuple[Counter[str], list[str]]:
    """Counts of outcomes, and what must not happen."""
    random = Random(seed)
    ends: Counter[str] = Counter()
    faults: list[str] = []
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        good = example_recordings(directory)
        runs = directory / "runs"
        runs.mkdir()
        file = runs / f"hostile{SUFFIX}"
        with server(directory, runs=runs) as app:
            browser = Browser(app)
            for _ in range(count):
                lines = copy.deepcopy(random.choice(good))
                what = "; ".join(
                    spoil(random.choice((lines[:1], lines)), random) for _ in range(random.choice((1, 1, 2)))
                )
                file.write_bytes(gzip.compress("".join(json.dumps(line) + "\n" for line in lines).encode()))
                try:
                    start = time.monotonic()
                    for path, response in responses(browser):
                        ends[f"response {response.status_code}"] += 1
                        if response.status_code >= 500:
                            faults.append(f"{path}: {response.status_code} ({what})")
                        if time.monotonic() - start > SECONDS:
                            faults.append(f"{path}: {time.monotonic() - start:.1f} s ({what})")
                        start = time.monotonic()
                except Exception as fault:
                    faults.append(f"{type(fault).__name__}: {fault!s:.200} ({what})")
    return ends, faults


def main() -> int:
    logging.disable()
    parser = argparse.ArgumentParser(description="Serves hostile recordings.")
    parser.add_argument("--count", type=int, default=400)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    ends, faults = attack(args.count, args.seed)
    print(dict(sorted(ends.items())))
    print(*faults[:40], sep="\n")
    print(f"{args.count} hostile recordings, {len(faults)} faults")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
