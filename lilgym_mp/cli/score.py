"""Score a language model's replies to prompts.

Scores replies exactly, and prints the success rate, the mean reward and the outcomes.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from lilgym_mp.evaluation.files import writable_file, write_json
from lilgym_mp.options import CommandError


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("prompts", type=Path, metavar="FILE", help="written by lilgym-mp prompts")
    parser.add_argument(
        "--answers", type=Path, required=True, metavar="REPLIES", help='JSON lines {"id": ..., "reply": ...}'
    )
    parser.add_argument("--reward", default="success", metavar="NAME", help="success (default), progress or return")
    parser.add_argument("--json", type=Path, metavar="OUT", help="write the summary and every score")


def run(args: argparse.Namespace) -> int:
    from lilgym_mp.llm import wilson_interval
    from lilgym_mp.rlvr import Row, RowError, score

    if args.json is not None:
        writable_file(args.json)
    rows: dict[str, Row] = {}
    for place, record in _records(args.prompts):
        try:
            row = Row.from_json(record)
        except RowError as error:
            raise CommandError(f"{place}: {error}") from None
        rows[row.id] = row
    scores: list[dict[str, Any]] = []
    for place, record in _records(args.answers):
        if not isinstance(record, dict) or not {"id", "reply"} <= record.keys():
            raise CommandError(f'{place}: a reply must be an object with "id" and "reply"')
        row = rows.get(record["id"]) if isinstance(record["id"], str) else None
        if row is None:
            raise CommandError(f"{place}: {args.prompts} has no row {record['id']!r:.80}")
        found = score(record["reply"], row, args.reward)
        scores.append({"id": row.id, "reward": found.reward, "outcome": found.outcome, "details": found.details})
    if not scores:
        raise CommandError(f"{args.answers}: there are no replies")
    outcomes = Counter(each["outcome"] for each in scores)
    successes, count = outcomes["success"], len(scores)
    low, high = wilson_interval(successes, count)
    summary = {
        "replies": count,
        "rows_without_reply": len(rows.keys() - {each["id"] for each in scores}),
        "success": successes / count,
        "success_low": low,
        "success_high": high,
        "mean_reward": sum(each["reward"] for each in scores) / count,
        "outcomes": dict(sorted(outcomes.items())),
    }
    print(f"success   {successes / count:.1%} ({successes} of {count}; 95 % interval {low:.1%} to {high:.1%})")
    print(f"reward    {summary['mean_reward']:+.3f} ({args.reward})")
    print(f"outcomes  {', '.join(f'{name} {number}' for name, number in sorted(outcomes.items()))}")
    if summary["rows_without_reply"]:
        print(f"missing   {summary['rows_without_reply']} prompts have no reply")
    if args.json is not None:
        write_json(args.json, {"reward": args.reward, **summary, "scores": scores})
    return 0


def _records(path: Path) -> Iterator[tuple[str, Any]]:
    """The JSON value of each non-empty line, with its place. Raises CommandError."""
    try:
        with path.open("rb") as file:
            for number, line in enumerate(file, 1):
                if line.strip():
                    yield f"{path}, line {number}", json.loads(line)
    except OSError as error:
        raise CommandError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (ValueError, RecursionError) as error:
        raise CommandError(f"{path}: not JSON lines: {error!s:.200}") from None
