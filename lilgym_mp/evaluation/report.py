"""Evaluation results as tables, and as JSON with all that is needed to reproduce them."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from shutil import get_terminal_size
from textwrap import fill

from lilgym_mp.evaluation.episodes import FINAL_OUTCOMES
from lilgym_mp.evaluation.recording_metadata import software
from lilgym_mp.evaluation.results import Result, SuccessCount, rounded
from lilgym_mp.evaluation.terminal import NUMBER, table
from lilgym_mp.scene.arrays import AnyDict, Strings

FORMAT = "lilgym_mp-evaluation"
VERSION = 2
FAILURES = [outcome.replace("_", " ") for outcome in FINAL_OUTCOMES if outcome != "success"]


def legend(results: Sequence[Result]) -> str:
    """Explains the columns, and names the policies with a mask of legal actions."""
    masked = dict.fromkeys(result.name for result in results if result.mask)
    seen = (
        " seen, unseen: accuracy and number of episodes with statements that occur, or do not occur, verbatim in the"
        " training tasks."
    )
    return (
        f"accuracy: tasks completed.{seen * _has_seen(results)} STOP is never forced."
        f" With a mask of legal actions: {', '.join(masked) or 'none'}."
    )


def _has_seen(results: Sequence[Result]) -> bool:
    """Tells whether any episode has a statement seen in training."""
    return any(result.summary.seen.episodes for result in results)


def results_text(results: Sequence[Result], width: int | None = None) -> str:
    """The accuracy by policy and configuration if there are several of these, and a table for each configuration.

    `width`: of a terminal to which tables are cut, by default that of standard output if it is one.
    """
    parts: list[str] = []
    found = {(result.name, result.plan.settings.configuration): result.summary.accuracy for result in results}
    names, configurations = (list(dict.fromkeys(column)) for column in zip(*found, strict=True))
    if len(configurations) > 1:
        rows = [[name, *(percent(found.get((name, where))) for where in configurations)] for name in names]
        parts.append(table(["accuracy", *configurations], rows, width))
    has_seen = _has_seen(results)
    heads = ("policy", "accuracy", *(("seen", "unseen") if has_seen else ()), "mean reward", "mean length", *FAILURES)
    for configuration in configurations:
        played = [result for result in results if result.plan.settings.configuration == configuration]
        episodes = len(played[0].episodes)
        parts.append(f"{configuration}, {episodes:,} episode{'s' if episodes > 1 else ''}")
        parts.append(table(heads, [_row(result, seen=has_seen) for result in played], width))
    supervision = dict.fromkeys((result.name, result.named.supervision) for result in results)
    notes = [*(f"supervision of {name}: {text}" for name, text in supervision), legend(results)]
    if width is None and sys.stdout.isatty():
        width = get_terminal_size().columns
    if width is not None:
        notes = [fill(note, width, subsequent_indent="  ") for note in notes]
    return "\n\n".join([*parts, "\n".join(notes[:-1]), notes[-1]])


def _row(result: Result, *, seen: bool) -> Strings:
    summary = result.summary
    failures = (percent(fraction) for outcome, fraction in summary.outcomes.items() if outcome != "success")
    return (
        result.name,
        percent(summary.accuracy),
        *((_percent_of(summary.seen), _percent_of(summary.unseen)) if seen else ()),
        f"{summary.mean_reward:+.2f}",
        f"{summary.mean_length:.1f}",
        *failures,
    )


def percent(fraction: float | None) -> str:
    """The fraction as it is printed; "-" for None."""
    return "-" if fraction is None else f"{rounded(100 * fraction, 1)} %"


def _percent_of(count: SuccessCount) -> str:
    return f"{percent(count.accuracy)} of {count.episodes}" if count.episodes else "-"


def markdown_table(rows: Sequence[Sequence[str]]) -> str:
    """An aligned Markdown table; the first row is the header, and columns of numbers are right-aligned."""
    columns: list[list[str]] = []
    for cells in zip(*rows, strict=True):
        width = max(map(len, cells))
        right = columns and all(map(NUMBER.fullmatch, cells[1:]))
        rule = "-" * (width + 1) + (":" if right else "-")
        head, *rest = (f" {cell.rjust(width) if right else cell.ljust(width)} " for cell in cells)
        columns.append([head, rule, *rest])
    return "\n".join(f"|{'|'.join(line)}|" for line in zip(*columns, strict=True))


def results_json(results: Sequence[Result]) -> AnyDict:
    """The settings, software versions and tasks of evaluations, and one row per result."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": sys.argv,
        "software": software(),
        "trials": [plan.to_json() for plan in dict.fromkeys(result.plan for result in results)],
        "results": [result.to_json() for result in results],
    }
