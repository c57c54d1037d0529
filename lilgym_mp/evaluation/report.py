"""Results for people, as a table, and for machines, as JSON that says how to get them again."""

from __future__ import annotations

import platform
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from lilgym_mp.evaluation.comparison import Result, task_counts
from lilgym_mp.evaluation.metrics import ENDS, Share

FORMAT = "lilgym_mp-evaluation"
VERSION = 2
DISTRIBUTIONS = ("lilgym-mp", "numpy", "gymnasium", "pillow", "torch", "stable-baselines3", "sb3-contrib")
LEGEND = (
    "accuracy: tasks completed. seen, unseen: accuracy on statements that stand, or do not stand, word for word among"
    " the training tasks, of how many episodes. No mask and no stop forcing unless a policy's name says so."
)


def table(results: Sequence[Result]) -> str:
    """A row a policy and configuration, in Markdown, aligned."""
    heads = ("policy", "configuration", "episodes", "accuracy", "seen", "unseen", "mean reward", "mean length")
    return aligned([(*heads, *_failures()), *(_row(result) for result in results)])


def supervision_table(results: Sequence[Result]) -> str:
    """What each policy learnt from."""
    learnt = dict.fromkeys((result.name, result.named.supervision) for result in results)
    return aligned([("policy", "supervision"), *learnt])


def _failures() -> list[str]:
    return [end.replace("_", " ") for end in ENDS if end != "success"]


def _row(result: Result) -> tuple[str, ...]:
    summary = result.summary
    shares = (_percent(share) for end, share in summary.outcomes.items() if end != "success")
    return (
        result.name,
        result.plan.settings.configuration,
        str(summary.all.episodes),
        _percent(summary.accuracy),
        _of(summary.seen),
        _of(summary.unseen),
        f"{summary.mean_reward:+.2f}",
        f"{summary.mean_length:.1f}",
        *shares,
    )


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.1f} %"


def _of(share: Share) -> str:
    return f"{_percent(share.accuracy)} of {share.episodes}" if share.episodes else "-"


def aligned(rows: Sequence[Sequence[str]]) -> str:
    """Rows of equal length as a Markdown table, the first as its head; all but the first column to the right."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = [
        "| " + " | ".join(_justified(cell, width, first=n == 0) for n, (cell, width) in enumerate(cells)) + " |"
        for cells in (list(zip(row, widths, strict=True)) for row in rows)
    ]
    rule = (
        "|" + "|".join("-" * (width + 2) if n == 0 else "-" * (width + 1) + ":" for n, width in enumerate(widths)) + "|"
    )
    return "\n".join([lines[0], rule, *lines[1:]])


def _justified(cell: str, width: int, *, first: bool) -> str:
    return cell.ljust(width) if first else cell.rjust(width)


def results_json(results: Sequence[Result], *, with_episodes: bool = False) -> dict[str, Any]:
    """Everything about evaluations: what was asked for, with what, and the results, a row each."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": sys.argv,
        "software": software(),
        "trials": [
            {**plan.to_json(), "tasks": task_counts(plan)} for plan in dict.fromkeys(result.plan for result in results)
        ],
        "results": [
            {**result.to_json(), "episodes": result.episodes_json()} if with_episodes else result.to_json()
            for result in results
        ],
    }


def software() -> dict[str, str]:
    """Versions of Python, the machine's system, and what of our requirements is installed."""
    found = {"python": platform.python_version(), "system": platform.platform()}
    for name in DISTRIBUTIONS:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found
