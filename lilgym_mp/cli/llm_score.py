"""Score a language model's replies to prompts.

Scores replies exactly, and prints the success rate over all prompts and the outcomes. A prompt without
a reply counts as a failure, and a line that is repeated counts once. With several samples of each prompt, told apart
by "sample" or their texts, rates are means over prompts, and pass@k is the chance that one of k samples is right.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from math import comb
from pathlib import Path
from typing import TYPE_CHECKING

from lilgym_mp.cli.llm_runs import success_text
from lilgym_mp.cli.options import JSON, CommandError, add_out, add_thoughts, check_out
from lilgym_mp.corpus.records import parse_object, read_text
from lilgym_mp.evaluation.files import write_json
from lilgym_mp.evaluation.report import percent
from lilgym_mp.scene.grouping import grouped

if TYPE_CHECKING:
    from lilgym_mp.contrib.rlvr import Row

MISSING = "missing"  # the outcome of a prompt without a reply


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `lilgym-mp llm score`."""
    parser.add_argument("prompts", type=Path, metavar="FILE", help="written by lilgym-mp llm prompts")
    parser.add_argument(
        "--answers",
        type=Path,
        required=True,
        metavar="REPLIES",
        help='JSON lines {"id": ..., "reply": ...}, with "sample": N if a prompt has several, and "finish_reason"',
    )
    add_thoughts(parser)
    add_out(parser, "write the summary and every score with its reason")


def run(args: argparse.Namespace) -> int:
    """Scores replies to prompts written by `lilgym-mp llm prompts`, and prints a summary."""
    from lilgym_mp.contrib.rlvr import score
    from lilgym_mp.wrappers.replies import THOUGHTS

    check_out(args)
    rows = _rows(args.prompts)
    scores: list[JSON] = []
    for row, record in _replies(args.answers, args.prompts, rows):
        found = score(
            record["reply"], row, thoughts=args.thoughts or THOUGHTS, finish_reason=record.get("finish_reason")
        )
        sample = {"sample": record["sample"]} if "sample" in record else {}
        scores.append(
            {"id": row.id, **sample, "reward": found.reward, "outcome": found.outcome, "details": found.details}
        )
    for name in rows.keys() - {each["id"] for each in scores}:
        scores.append({"id": name, "reward": 0.0, "outcome": MISSING, "details": {"reason": "there is no reply"}})
    summary = summarised(scores, {name: row.task.statement for name, row in rows.items()})
    count = summary["prompts"]
    print("success  ", success_text(summary, f"{summary['success'] * count:.4g} of {count}"))
    for name, rate in summary["pass"].items():
        print(f"{name:<9} {percent(rate)}")
    print(f"outcomes  {', '.join(f'{name} {number}' for name, number in summary['outcomes'].items())}")
    for reason, number in list(summary["reasons"].items())[:3]:
        print(f"          {number} x {reason}")
    if args.out is not None:
        write_json(args.out, {**summary, "scores": scores})
    return 0


def summarised(scores: Sequence[JSON], statements: Mapping[str, str]) -> JSON:
    """Means over prompts, each of which has one score or more; pass@k up to the least number of samples.

    `statements`: by the prompts' ids; they are resampled for the interval.
    """
    from lilgym_mp.contrib.llm import success_interval

    by_prompt = grouped((each["id"], each["outcome"]) for each in scores)
    count = len(by_prompt)
    answered = [outcomes for outcomes in by_prompt.values() if outcomes[0] != MISSING]
    right = [(len(outcomes), outcomes.count("success")) for outcomes in answered]
    least = min(total for total, _ in right)
    ks = sorted({k for k in (1, 2, 4, 8, 16, 32, 64, 128, least) if k <= least}) if least > 1 else []
    successes = sum(good / total for total, good in right)
    low, high = success_interval(
        [(statements[name], outcomes.count("success") / len(outcomes)) for name, outcomes in by_prompt.items()]
    )
    reasons = Counter(each["details"]["reason"] for each in scores if "reason" in each["details"])
    return {
        "prompts": count,
        "replies": sum(map(len, answered)),
        "rows_without_reply": count - len(answered),
        "success": successes / count,
        "success_low": low,
        "success_high": high,
        "pass": {
            f"pass@{k}": sum(1 - comb(total - good, k) / comb(total, k) for total, good in right) / count for k in ks
        },
        "outcomes": dict(sorted(Counter(each["outcome"] for each in scores).items())),
        "reasons": dict(reasons.most_common()),
    }


def _rows(path: Path) -> dict[str, Row]:
    """The rows by id. Raises CommandError."""
    from lilgym_mp.contrib.rlvr import Row, RowError

    rows: dict[str, Row] = {}
    for place, record in _records(path):
        try:
            row = Row.from_json(record)
        except RowError as error:
            raise CommandError(f"{place}: {error}") from None
        if rows.setdefault(row.id, row) != row:
            raise CommandError(f"{place}: another row has the id {row.id!r:.80}")
    return rows


def _replies(path: Path, prompts: Path, rows: Mapping[str, Row]) -> Iterator[tuple[Row, JSON]]:
    """The rows with their replies, without repetitions. Raises CommandError."""
    known: dict[str, tuple[str, str]] = {}  # place and reply, as JSON, of each
    for place, record in _records(path):
        if not {"id", "reply"} <= record.keys():
            raise CommandError(f'{place}: a reply must be an object with "id" and "reply"')
        row = rows.get(record["id"]) if isinstance(record["id"], str) else None
        if row is None:
            raise CommandError(f"{place}: {prompts} has no row {record['id']!r:.80}")
        kind = "sample" if "sample" in record else "reply"  # what tells replies to a row apart
        said = json.dumps([record["reply"], record.get("finish_reason")])  # NaN is not equal to itself
        first, text = known.setdefault(json.dumps([row.id, kind, record[kind]]), (place, said))
        if text != said:
            raise CommandError(
                f"{place}: another reply to {row.id!r:.80} as sample {record.get('sample')!r:.80}: {first}"
            )
        if first == place:
            yield row, record


def _records(path: Path) -> Iterator[tuple[str, JSON]]:
    """The JSON object on each non-empty line, with its place. Raises CommandError."""
    for number, line in enumerate(read_text(path)[0].split("\n"), 1):
        if line.strip():
            try:
                yield f"{path}, line {number}", parse_object("a line", line)
            except ValueError as error:
                raise CommandError(f"{path}, line {number}: {error!s:.200}") from None
