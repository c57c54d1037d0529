"""Measurements as tables for people, as JSON for programs, and as a part of a document."""

from __future__ import annotations

import platform
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from lilgym_mp.benchmark.goals import goal_results
from lilgym_mp.benchmark.measuring import EFFORTS, Bench, Measurement
from lilgym_mp.envs.workers import usable_cores
from lilgym_mp.evaluation.report import markdown_table, software

FORMAT, VERSION = "lilgym_mp-benchmark", 1
BEGIN, END = "<!-- written by lilgym-mp bench: begin -->", "<!-- written by lilgym-mp bench: end -->"
LEGEND = (
    "Steps per second: the median of the rounds, the lowest and the highest. A step is one action (AEC: one agent's"
    " turn); resets are timed and are no steps. of copying: against copying the images of as many environments, the"
    " median of the rounds' ratios; above 1 is possible only where nothing is copied."
)


class DocumentError(ValueError):
    """A document without the place for the tables."""


def report_text(bench: Bench) -> str:
    """Everything as Markdown: what was asked, then a table for each configuration."""
    parts = [circumstances(bench), *bench.notes]
    if rows := _goal_rows(bench):
        parts.append("### Figures asked for\n\nEach is the worst of the configurations that it is about.\n\n" + rows)
    parts.append(LEGEND)
    for name in bench.configurations:
        mine = [one for one in bench.results if one.configuration == name]
        parts.append(f"### {name}\n\n" + _rates_table(bench, [one for one in mine if not one.subject.is_part]))
        if found := [one for one in mine if one.subject.is_part]:
            parts.append(_parts_table(found))
    return "\n\n".join(parts)


def circumstances(bench: Bench) -> str:
    """When, where and under which load."""
    begin, end = bench.load_averages
    command = "lilgym-mp bench" + " --quick" * (bench.effort == EFFORTS["quick"])
    texts = [
        f"Measured {datetime.now(UTC):%Y-%m-%d %H:%M} UTC on {_processor()}, {usable_cores()} cores,"
        f" Python {platform.python_version()}; load average {begin:.1f} at the beginning and {end:.1f} at the end;"
        f" `{command}`, {bench.effort.repeats} rounds.",
    ]
    if bench.is_interrupted:
        texts.append("**Interrupted: not everything was measured.**")
    return " ".join(texts)


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _goal_rows(bench: Bench) -> str:
    rows = [
        (goal.what, goal.unit, _figure(goal.must), "-" if goal.aim is None else _figure(goal.aim), _figure(value), says)
        for goal, value, says in (
            (goal_result.goal, goal_result.value, goal_result.says) for goal_result in goal_results(bench)
        )
    ]
    return markdown_table([("figure", "unit", "must", "aim", "measured", ""), *rows]) if rows else ""


def _rates_table(bench: Bench, measured: Sequence[Measurement]) -> str:
    rows = [
        (
            one.subject.name,
            str(one.subject.num_envs),
            _figure(one.median),
            _figure(min(one.rates)),
            _figure(max(one.rates)),
            "-" if (ratio := bench.of_copying(one)) is None else _figure(ratio),
        )
        for one in measured
    ]
    return markdown_table([("steps per second", "envs", "median", "lowest", "highest", "of copying"), *rows])


def _parts_table(measured: Sequence[Measurement]) -> str:
    rows = [
        (
            one.subject.name,
            str(one.subject.num_envs),
            _figure(1e6 / one.median),
            _figure(1e6 / max(one.rates)),
            _figure(1e6 / min(one.rates)),
        )
        for one in measured
    ]
    return markdown_table([("microseconds for one environment", "envs", "median", "lowest", "highest"), *rows])


def _figure(value: float) -> str:
    """Three digits that count, with commas."""
    digits = 2 if value < 10 else 1 if value < 100 else 0
    rounded = float(f"{value:.3g}")
    return f"{rounded:,.{digits}f}"


def report_json(bench: Bench) -> dict[str, Any]:
    """All rounds of all subjects, and how to get them again."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": sys.argv,
        "software": software(),
        "processor": _processor(),
        "cores": usable_cores(),
        "load_averages": list(bench.load_averages),
        "effort": bench.effort._asdict(),
        "is_interrupted": bench.is_interrupted,
        "notes": bench.notes,
        "goals": [
            {"what": goal.what, "unit": goal.unit, "must": goal.must, "aim": goal.aim, "measured": value, "says": says}
            for goal, value, says in (
                (goal_result.goal, goal_result.value, goal_result.says) for goal_result in goal_results(bench)
            )
        ],
        "results": [_measurement_json(bench, one) for one in bench.results],
    }


def _measurement_json(bench: Bench, one: Measurement) -> dict[str, Any]:
    subject = one.subject
    return {
        "configuration": one.configuration,
        "group": subject.group,
        "name": subject.name,
        "num_envs": subject.num_envs,
        "unit": "calls/s" if subject.is_part else "steps/s",
        "median": one.median,
        "rates": one.rates,
        "of_copying": bench.of_copying(one),
    }


def in_document(document: str, text: str) -> str:
    """The document with `text` in place of what stood between the marks. Raises DocumentError without the marks."""
    before, begin, rest = document.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise DocumentError(f"no place for the tables: two lines are needed, {BEGIN} and {END}")
    return f"{before}{BEGIN}\n\n{text}\n\n{END}{after}"
