"""Evaluation results as Markdown tables, and as JSON with all that is needed to reproduce them."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from shutil import get_terminal_size
from textwrap import fill
from typing import Any

from lilgym_mp.evaluation.episodes import FINAL_OUTCOMES
from lilgym_mp.evaluation.recording_metadata import software
from lilgym_mp.evaluation.runs import Result, SuccessCount
from lilgym_mp.evaluation.terminal import NUMBER
from lilgym_mp.evaluation.terminal import table as aligned

FORMAT = "lilgym_mp-evaluation"
VERSION = 2
FAILURES = [outcome.replace("_", " ") for outcome in FINAL_OUTCOMES if outcome != "success"]
SEEN_LEGEND = (
    " seen, unseen: accuracy and number of episodes with statements that occur, or do not occur, verbatim in the"
    " training tasks."
)


def legend(results: Sequence[Result]) -> str:
    """Explains the columns, and names the policies with a mask of legal actions."""
    masked = dict.fromkeys(result.name for result in results if result.mask)
    seen = SEEN_LEGEND if _has_seen(results) else ""
    return (
        f"accuracy: tasks completed.{seen} STOP is never forced."
        f" With a mask of legal actions: {', '.join(masked) or 'none'}."
    )


def _has_seen(results: Sequence[Result]) -> bool:
    """Tells whether any episode has a statement seen in training."""
    return any(result.summary.seen.episodes for result in results)


def table(results: Sequence[Result]) -> str:
    """Markdown: the accuracy by policy and configuration if there are several, and a table with a row per result."""
    heads, *rows = accuracies(results)
    summary = f"{markdown_table([heads, *rows])}\n\n" if len(heads) > 2 else ""
    seen = ("seen", "unseen") if _has_seen(results) else ()
    heads = ("policy", "configuration", "episodes", "accuracy", *seen, "mean reward", "mean length", *FAILURES)
    return summary + markdown_table([heads, *(_row(result, seen=bool(seen)) for result in results)])


def accuracies(results: Sequence[Result]) -> list[list[str]]:
    """Rows of accuracies by policy and configuration, after a row of heads."""
    found = {(result.name, result.plan.settings.configuration): result.summary.accuracy for result in results}
    names, configurations = (list(dict.fromkeys(column)) for column in zip(*found, strict=True))
    rows = [[name, *(_percent(found.get((name, where))) for where in configurations)] for name in names]
    return [["accuracy", *configurations], *rows]


def terminal_tables(results: Sequence[Result], width: int) -> str:
    """Lays the tables out for a terminal of this many columns: one per configuration, in parts if it is narrow."""
    heads, *rows = accuracies(results)
    parts = [aligned(heads, rows, width)] if len(heads) > 2 else []
    seen = ("seen", "unseen") if _has_seen(results) else ()
    heads = ("policy", "accuracy", *seen, "reward", "length", *FAILURES)
    for configuration in dict.fromkeys(result.plan.settings.configuration for result in results):
        all_rows = [_row(result, seen=bool(seen)) for result in results]
        rows = [(row[0], *row[3:]) for row in all_rows if row[1] == configuration]
        episodes = next(r.summary.all.episodes for r in results if r.plan.settings.configuration == configuration)
        parts += [f"{configuration}, {episodes:,} episode{'s' * (episodes > 1)}", aligned(heads, rows, width)]
    supervision = dict.fromkeys((result.name, result.named.supervision) for result in results)
    notes = [*(f"supervision of {name}: {text}" for name, text in supervision), legend(results)]
    return "\n\n".join([*parts, *(fill(note, width, subsequent_indent="  ") for note in notes)])


def results_markdown(results: Sequence[Result]) -> str:
    """All tables and the legend."""
    return "\n\n".join([table(results), supervision_table(results), legend(results)])


def shown_results(results: Sequence[Result]) -> str:
    """The results laid out for the terminal, or as Markdown if standard output is none."""
    columns = get_terminal_size().columns
    return terminal_tables(results, columns) if sys.stdout.isatty() else results_markdown(results)


def supervision_table(results: Sequence[Result]) -> str:
    """A Markdown table of what each policy learnt from."""
    supervision = dict.fromkeys((result.name, result.named.supervision) for result in results)
    return markdown_table([("policy", "supervision"), *supervision])


def _row(result: Result, *, seen: bool) -> tuple[str, ...]:
    summary = result.summary
    failures = (_percent(fraction) for outcome, fraction in summary.outcomes.items() if outcome != "success")
    return (
        result.name,
        result.plan.settings.configuration,
        str(summary.all.episodes),
        _percent(summary.accuracy),
        *((_percent_of(summary.seen), _percent_of(summary.unseen)) if seen else ()),
        f"{summary.mean_reward:+.2f}",
        f"{summary.mean_length:.1f}",
        *failures,
    )


def _percent(fraction: float | None) -> str:
    return "-" if fraction is None else f"{100 * fraction:.1f} %"


def _percent_of(count: SuccessCount) -> str:
    return f"{_percent(count.accuracy)} of {count.episodes}" if count.episodes else "-"


def markdown_table(rows: Sequence[Sequence[str]]) -> str:
    """An aligned Markdown table; the first row is the header, and columns of numbers are right-aligned."""
    columns: list[list[str]] = []
    for cells in zip(*rows, strict=True):
        width, right = max(map(len, cells)), columns and all(map(NUMBER.fullmatch, cells[1:]))
        rule = "-" * (width + 1) + (":" if right else "-")
        head, *rest = (f" {cell.rjust(width) if right else cell.ljust(width)} " for cell in cells)
        columns.append([head, rule, *rest])
    return "\n".join(f"|{'|'.join(line)}|" for line in zip(*columns, strict=True))


def results_json(results: Sequence[Result], *, with_episodes: bool = False) -> dict[str, Any]:
    """The settings, software versions and tasks of evaluations, and one row per result."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": sys.argv,
        "software": software(),
        "trials": [plan.to_json() for plan in dict.fromkeys(result.plan for result in results)],
        "results": [
            {**result.to_json(), **({"episodes": [one.to_json() for one in result.episodes]} if with_episodes else {})}
            for result in results
        ],
    }
