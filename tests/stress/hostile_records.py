"""Reports of recordings and training runs with odd values: a page without foreign markup, or one line of error.

Run: python -m tests.stress.hostile_records --count 200
"""

from __future__ import annotations

import argparse
import contextlib
import gzip
import io
import json
import random
import re
import shutil
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from lilgym_mp.cli import main as run_command
from lilgym_mp.evaluation.episodes import SUFFIX
from lilgym_mp.evaluation.recording_metadata import METADATA_SUFFIX

EPISODES = 8
MARKUP = "<script>alert(1)</script>"
ODD_VALUES: tuple[Any, ...] = (
    None, True, -1, 0, 10**30, 1e308, float("nan"), float("inf"), "", MARKUP, "a\x1b[31m\0b", "x" * 20_000, [], {},
    [[]], {"a": {}}, "\ud800", [None], "TowerFlipIt", "../../etc", 2**63, "=1+1", "| a | b |",
    10**400, "\u202e", "STOP", [[[[[]]]]], [0] * 1_000,
)  # fmt: skip
PROGRESS = [{"steps": steps, "accuracy": 0.5, "seconds": 1.0, "loss": 2.0} for steps in (100, 200)]
RUN = {"learner": "ppo", "environment": {"configuration": "TowerScratch"}, "recipe": {"seed": 0}}


def _places(value: Any) -> Iterator[tuple[Any, Any]]:
    """Every container in a JSON value with each of its keys or indices."""
    for key, inner in value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ():
        yield value, key
        yield from _places(inner)


def spoil(value: Any, rng: random.Random) -> str:
    """Replaces or removes a part of the JSON value; returns which."""
    container, key = rng.choice(list(_places(value)))
    odd = rng.choice(ODD_VALUES)
    if rng.random() < 0.9:
        container[key] = odd
    else:
        del container[key]
    return f"{key}: {str(odd)[:60]!r}"


def recorded(directory: Path) -> tuple[list[Any], Any]:
    """The header and some episodes of a recording, and its metadata."""
    words = "evaluate --policy random-legal --configuration TowerScratch --record-decisions --record"
    _quietly([*words.split(), str(directory)])
    file = next(directory.rglob(f"*{SUFFIX}"))
    with gzip.open(file, "rt", encoding="utf-8") as lines:
        rows = [json.loads(line) for _, line in zip(range(1 + EPISODES), lines, strict=False)]
    rows[0]["episodes"] = EPISODES
    return rows, json.loads(next(directory.rglob(f"*{METADATA_SUFFIX}")).read_text(encoding="utf-8"))


def _quietly(words: list[str]) -> tuple[int, str]:
    """The exit code of a command line and what it wrote on stderr."""
    written = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(written):
        return run_command(words), written.getvalue()


def hostile_reports(count: int, seed: int) -> Counter[str]:
    """Outcomes of `count` reports, each with one spoilt value. Raises AssertionError for any other outcome."""
    rng, outcomes = random.Random(seed), Counter[str]()
    with tempfile.TemporaryDirectory() as base:
        rows, metadata = recorded(Path(base) / "recorded")
        for _ in range(count):
            parts = json.loads(json.dumps({"rows": rows, "metadata": metadata, "progress": PROGRESS, "run": RUN}))
            spoil(rng.choice([parts["rows"][0], parts["rows"][rng.randint(1, EPISODES)], parts, *parts.values()]), rng)
            case = Path(base) / "case"
            shutil.rmtree(case, ignore_errors=True)
            with contextlib.suppress(KeyError, TypeError):
                _write(case, parts)
            outcomes[_outcome(case)] += 1
    return outcomes


def _write(case: Path, parts: Any) -> None:
    run = case / "run"
    run.mkdir(parents=True)
    files: dict[Path, Callable[[], str]] = {
        case / f"a{METADATA_SUFFIX}": lambda: json.dumps(parts["metadata"]),
        run / "run.json": lambda: json.dumps({"identity": parts["run"]}),
        run / "progress.jsonl": lambda: _lines(parts["progress"]),
        run / "evaluations.jsonl": lambda: _lines(parts["progress"]),
    }
    (case / f"a{SUFFIX}").write_bytes(gzip.compress(_lines(parts["rows"]).encode()))
    for path, text in files.items():
        path.write_text(text(), encoding="utf-8")


def _lines(rows: Any) -> str:
    return "".join(json.dumps(row) + "\n" for row in rows)


def _outcome(case: Path) -> str:
    code, errors = _quietly(["report", str(case), "--out", str(case / "out"), "--document", str(case / "page.md")])
    if code == 0:
        pages = [(case / "out" / "index.html").read_text(encoding="utf-8"), (case / "page.md").read_text("utf-8")]
        for page in pages:
            page = re.sub(r"\n```\n.*?\n```\n", "", page, flags=re.S)  # Markdown's code blocks show markup as it is
            assert MARKUP not in page, page[max(0, page.index(MARKUP) - 300) :][:400]
        return "a page"
    assert code == 2, (code, errors)
    assert errors.count("\n") == 1, errors
    assert errors.rstrip("\n").isprintable(), errors
    return "one line"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    print(dict(hostile_reports(args.count, args.seed)))


if __name__ == "__main__":
    main()
