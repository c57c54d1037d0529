"""Measurements as Markdown tables, also inserted into a document, and as JSON."""

from __future__ import annotations

import platform
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from lilgym_mp.benchmark.measuring import EFFORTS, Bench, Measurement
from lilgym_mp.envs.workers import usable_cores
from lilgym_mp.evaluation.recording_metadata import cpu_model
from lilgym_mp.evaluation.report import fold_long_blocks, markdown_table, software

FORMAT, VERSION = "lilgym_mp-benchmark", 1
BEGIN, END = "<!-- written by lilgym-mp bench: begin -->", "<!-- written by lilgym-mp bench: end -->"
LEGEND = (
    "Steps per second: median, minimum and maximum over the rounds. A step is one action (AEC: one agent's turn);"
    " resets are timed but do not count as steps. of copying: speed relative to copying as many environments' images"
    " (median of the ratios in each round); only cases that copy no images can exceed 1."
)


class DocumentError(ValueError):
    """A document has no marks for the tables."""


def report_text(bench: Bench) -> str:
    """Everything as Markdown: conditions, then the tables of each configuration."""
    parts = [conditions(bench), *bench.notes]
    parts.append(LEGEND)
    for name in bench.configurations:
        mine = [measurement for measurement in bench.results if measurement.configuration == name]
        parts.append(
            f"### {name}\n\n"
            + _rates_table(bench, [measurement for measurement in mine if not measurement.case.is_part])
        )
        if found := [measurement for measurement in mine if measurement.case.is_part]:
            parts.append(_parts_table(found))
    return "\n\n".join(parts)


def conditions(bench: Bench) -> str:
    """Date, machine, load and command of the measurements."""
    begin, end = bench.load_averages
    command = "lilgym-mp bench" + " --quick" * (bench.effort == EFFORTS["quick"])
    texts = [
        f"Measured {datetime.now(UTC):%Y-%m-%d %H:%M} UTC on {cpu_model()}, {usable_cores()} cores,"
        f" Python {platform.python_version()}; load average {begin:.1f} at the beginning and {end:.1f} at the end;"
        f" `{command}`, {bench.effort.repeats} rounds.",
    ]
    if bench.is_interrupted:
        texts.append("**Interrupted: not everything was measured.**")
    return " ".join(texts)


def _rates_table(bench: Bench, measured: Sequence[Measurement]) -> str:
    rows = [
        (
            measurement.case.name,
            str(measurement.case.num_envs),
            _figure(measurement.median),
            _figure(min(measurement.rates)),
            _figure(max(measurement.rates)),
            "-" if (ratio := bench.ratio_to_copying(measurement)) is None else _figure(ratio),
        )
        for measurement in measured
    ]
    return markdown_table([("steps per second", "envs", "median", "lowest", "highest", "of copying"), *rows])


def _parts_table(measured: Sequence[Measurement]) -> str:
    rows = [
        (
            measurement.case.name,
            str(measurement.case.num_envs),
            _figure(1e6 / measurement.median),
            _figure(1e6 / max(measurement.rates)),
            _figure(1e6 / min(measurement.rates)),
        )
        for measurement in measured
    ]
    return markdown_table([("microseconds for one environment", "envs", "median", "lowest", "highest"), *rows])


def _figure(value: float) -> str:
    """Rounded to three significant digits, with thousands separators."""
    digits = 2 if value < 10 else 1 if value < 100 else 0
    rounded = float(f"{value:.3g}")
    return f"{rounded:,.{digits}f}"


def report_json(bench: Bench) -> dict[str, Any]:
    """All rounds of all cases, and what is needed to reproduce them."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": sys.argv,
        "software": software(),
        "processor": cpu_model(),
        "cores": usable_cores(),
        "load_averages": list(bench.load_averages),
        "effort": bench.effort._asdict(),
        "is_interrupted": bench.is_interrupted,
        "notes": bench.notes,
        "results": [_measurement_json(bench, measurement) for measurement in bench.results],
    }


def _measurement_json(bench: Bench, measurement: Measurement) -> dict[str, Any]:
    case = measurement.case
    return {
        "configuration": measurement.configuration,
        "group": case.group,
        "name": case.name,
        "num_envs": case.num_envs,
        "unit": "calls/s" if case.is_part else "steps/s",
        "median": measurement.median,
        "rates": measurement.rates,
        "of_copying": bench.ratio_to_copying(measurement),
    }


def insert_tables(document: str, text: str) -> str:
    """The document with the text between the marks replaced. Raises DocumentError if it has no marks."""
    before, begin, rest = document.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise DocumentError(f"no marks for the tables: it needs two lines, {BEGIN} and {END}")
    return f"{before}{BEGIN}\n\n{fold_long_blocks(text)}\n\n{END}{after}"
