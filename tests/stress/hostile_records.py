"""Recordings with odd values: reports on them, and the web application's pages that show them.

A report must be a page without foreign markup, or one line of error; a response must come in time and be no 5xx.
"""

import contextlib
import copy
import gzip
import io
import json
import random
import tempfile
import time
from collections import Counter
from pathlib import Path

from lilgym_mp.cli import main as run_command
from lilgym_mp.evaluation.files import SUFFIX
from lilgym_mp.evaluation.recording_metadata import METADATA_SUFFIX

EPISODES = 8
SECONDS = 10.0  # for any response, on a busy machine
MARKUP = "<script>alert(1)</script>"
ODD_VALUES = (
    None,
    True,
    -1,
    0,
    10**30,
    1e308,
    float("nan"),
    float("inf"),
    "",
    MARKUP,
    "a\x1b[31m\0b",
    "x" * 20_000,
    [],
    {},
    [[]],
    {"a": {}},
    "\ud800",
    [None],
    "TowerFlipIt",
    "../../etc",
    2**63,
    "=1+1",
    "| a | b |",
    10**400,
    "\u202e",
    "STOP",
    [[[[[]]]]],
    [0] * 1_000,
)


def _places(value):
    """Every container in a JSON value with each of its keys or indices."""
    for key, inner in value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ():
        yield value, key
        yield from _places(inner)


def spoil(value, rng):
    """Replaces or removes a part of the JSON value; returns which."""
    container, key = rng.choice(list(_places(value)))
    odd = rng.choice(ODD_VALUES)
    if rng.random() < 0.9:
        container[key] = odd
    else:
        del container[key]
    return f"{key}: {str(odd)[:60]!r}"


def recorded(directory, configuration="TowerScratch"):
    """The header and some episodes of a recording with decisions, and its metadata."""
    words = ["evaluate", "--policy", "random-legal", "--configuration", configuration, "--record-decisions"]
    _quietly([*words, "--record", str(directory)])
    file = next(directory.rglob(f"*{SUFFIX}"))
    with gzip.open(file, "rt") as lines:
        rows = [json.loads(line) for _, line in zip(range(1 + EPISODES), lines, strict=False)]
    rows[0]["episodes"] = EPISODES
    return rows, json.loads(next(directory.rglob(f"*{METADATA_SUFFIX}")).read_text())


def _quietly(words):
    """The exit code of a command line and what it wrote on stderr."""
    written = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(written):
        return run_command(words), written.getvalue()


def hostile_reports(count, seed):
    """Outcomes of `count` reports, each with one spoilt value, and no faults: raises AssertionError for any."""
    rng, outcomes = random.Random(seed), Counter[str]()
    with tempfile.TemporaryDirectory() as base:
        rows, metadata = recorded(Path(base) / "recorded")
        for index in range(count):
            lines, described = copy.deepcopy((rows, metadata))
            spoil(rng.choice([lines[0], lines[rng.randint(1, EPISODES)], lines, described]), rng)
            case = Path(base) / str(index)
            case.mkdir()
            (case / f"a{METADATA_SUFFIX}").write_text(json.dumps(described))
            (case / f"a{SUFFIX}").write_bytes(gzip.compress(_lines(lines).encode()))
            outcomes[_outcome(case)] += 1
    return outcomes, []


def _lines(rows):
    return "".join(json.dumps(row) + "\n" for row in rows)


def _outcome(case):
    code, errors = _quietly(["report", str(case), "--out", str(case / "out")])
    if code == 0:
        page = (case / "out" / "index.html").read_text()
        assert MARKUP not in page, page[max(0, page.index(MARKUP) - 300) :][:400]
        return "a page"
    assert code == 2, (code, errors)
    assert errors.count("\n") == 1, errors
    assert errors.rstrip("\n").isprintable(), errors
    return "one line"


def hostile_pages(count, seed):
    """Responses by status to what the pages ask for on `count` spoilt recordings, and those that must not happen."""
    from tests.web.web_app import Browser, server

    rng, outcomes, faults = random.Random(seed), Counter[str](), list[str]()
    with tempfile.TemporaryDirectory() as name:
        directory, runs = Path(name), Path(name) / "runs"
        good = [recorded(directory / each, each)[0] for each in ("TowerFlipIt", "ScatterFlipIt")]
        runs.mkdir()
        with server(directory, runs=runs) as app:
            browser = Browser(app)
            for _ in range(count):
                lines = copy.deepcopy(rng.choice(good))
                spoilt = "; ".join(spoil(rng.choice((lines[:1], lines)), rng) for _ in range(rng.choice((1, 1, 2))))
                (runs / f"hostile{SUFFIX}").write_bytes(gzip.compress(_lines(lines).encode()))
                start = time.monotonic()
                for path, response in _responses(browser):
                    outcomes[f"response {response.status_code}"] += 1
                    seconds, start = time.monotonic() - start, time.monotonic()
                    if response.status_code >= 500 or seconds > SECONDS:
                        faults.append(f"{path}: {response.status_code}, {seconds:.1f} s ({spoilt})")
    return outcomes, faults


def _responses(browser):
    """Requests everything that the pages on recordings do."""
    base = "/api/watch/recordings"
    paths = [base, "/api/explore/statements?appearance=tower&split=dev", "/watch"]
    for line in browser.get(base).json()["recordings"]:
        own = f"{base}/{line['id']}"
        paths += [own, f"{own}/episodes", f"{own}/episodes?success=true&text=a"]
        paths += [f"{own}/episodes/{index}" for index in range(4)]
    for path in paths:
        yield path, browser.get(path)
