"""What runs of language models share: the agent's options, settings stored without secrets, the tasks, and costs."""

from __future__ import annotations

import argparse
import hashlib
import json
import random
import re
from collections.abc import Sequence
from itertools import chain, zip_longest
from pathlib import Path
from typing import Any

from lilgym_mp.cli.options import JSON, RUNS, CommandError
from lilgym_mp.corpus.records import unique_keys
from lilgym_mp.corpus.tasks import TaskSet
from lilgym_mp.evaluation.files import read_json
from lilgym_mp.evaluation.report import percent
from lilgym_mp.scene.grouping import grouped

TEXT_OPTIONS = ("model", "directory", "url", "device")  # never read as JSON: a model may be called 1e3


def default_directory(*words: str) -> Path:
    """The default directory of a run, named by the words that are not empty."""
    return RUNS / re.sub(r"[^\w.-]+", "-", "-".join(filter(None, words)))


def drawn(tasks: TaskSet, count: int | None, seed: int) -> list[str]:
    """The ids of `count` tasks, or of all, in file order: one of each statement, then a second one, and so on.

    With the same seed, fewer tasks are among more.
    """
    if count is None or count >= len(tasks):
        return list(tasks.ids)
    by_statement = grouped((task.statement, task.id) for task in tasks)
    rng = random.Random(f"episodes {seed}")
    groups = [rng.sample(ids, len(ids)) for ids in by_statement.values()]
    rounds = zip_longest(*rng.sample(groups, len(groups)))
    order = [task_id for task_id in chain.from_iterable(rounds) if task_id is not None]
    return sorted(order[:count], key=tasks.index_of)


def read_agent_options(options: Sequence[str]) -> JSON:
    """The parsed --option: values are read as JSON if they are, "none" as null, otherwise as text.

    Raises CommandError, without showing values.
    """
    parsed: JSON = {}
    for number, text in enumerate(options, 1):
        key, sign, value = text.partition("=")
        if not sign or not key.isidentifier():
            shown = repr(text) if text in TEXT_OPTIONS else f"what stands in place {number}"
            raise CommandError(f"--option takes KEY=VALUE, not {shown}")
        if key in parsed:
            raise CommandError(f"--option {key} is given twice; give it once")
        parsed[key] = _value(key, value)
    return parsed


def _value(key: str, text: str) -> Any:
    if key in TEXT_OPTIONS:
        return text
    if text.lower() == "none":
        return None
    try:
        value = json.loads(text, object_pairs_hook=unique_keys)
    except json.JSONDecodeError:
        return text
    except RecursionError:
        raise CommandError(f"--option {key} is nested too deeply") from None
    except ValueError as error:
        raise CommandError(f"--option {key}: {error}") from None
    try:
        json.dumps(value, allow_nan=False)
    except ValueError:
        raise CommandError(f"--option {key} must be finite") from None
    return value


def stored_settings(args: argparse.Namespace, names: Sequence[str], tasks_sha256: str | None) -> JSON:
    """The options of these names, those of the agent, without secrets, and the checksum of the tasks."""
    from lilgym_mp.wrappers.replies import THOUGHTS

    return {
        **{name: getattr(args, name) for name in ("agent", "split", "scene", "retries", "history", "seed", *names)},
        "option": public("", read_agent_options(args.option)),
        "tasks_sha256": tasks_sha256,
        "legal_actions": not args.no_legal_actions,
        "system": not args.no_system,
        "thoughts": list(args.thoughts or THOUGHTS),
    }


def check_settings(out: Path, before: JSON, settings: JSON) -> None:
    """Raises CommandError naming the first setting that differs, with both values."""
    for name in {**settings, **before}:
        if before.get(name) != settings.get(name):
            raise CommandError(f"{out} was played with {name} {before.get(name)!r}, not {settings.get(name)!r}")


def stored(path: Path) -> tuple[JSON, JSON]:
    """The summary of a run, and the settings in it. Raises OSError, ValueError."""
    summary = read_json(path)
    settings = summary.get("settings") if isinstance(summary, dict) else None
    if not isinstance(settings, dict):
        raise ValueError("it has no settings")
    return summary, settings


def public(name: str, value: Any) -> Any:
    """The value as it is stored: secrets within it as digests."""
    from lilgym_mp.contrib.llm.agents import is_secret, without_credentials

    if value is not None and is_secret(name, value):
        return _digest(value)
    if isinstance(value, dict):
        return {key: public(key, each) for key, each in value.items()}
    if isinstance(value, list):
        return [public(name, each) for each in value]
    if isinstance(value, str) and "://" in value and (bare := without_credentials(value)) != value:
        return f"{bare} ({_digest(value)})"
    return value


def _digest(value: object) -> str:
    return f"sha256:{hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()[:12]}"


def success_text(summary: JSON, of: str) -> str:
    """The success of a summary and its interval; `of`: such as "3 of 20"."""
    success, low, high = (percent(summary[name]) for name in ("success", "success_low", "success_high"))
    return f"{success} ({of}; 95 % interval over statements {low} to {high})"


def print_calls(summary: JSON) -> None:
    """The answers and their cost, of `llm.summary.calls`."""
    tokens = ""
    if summary["prompt_tokens"] is not None and summary["completion_tokens"] is not None:
        tokens = f"{summary['prompt_tokens']:,} tokens read, {summary['completion_tokens']:,} written, "
    problems = ", ".join(f"{number} {name}" for name, number in summary["problems"].items() if number)
    print(f"answers      {summary['answers']}, {summary['misunderstood']} of them without a valid action", end="")
    print(f" ({problems})" if problems else "")
    money = "" if summary["cost"] is None else f"{summary['cost']:.4g} at the given prices, "
    retried = f", {summary['failed_calls']} failed calls" if summary["failed_calls"] else ""
    print(f"cost         {tokens}{money}{summary['call_seconds']:.1f} seconds of calls, added up{retried}")
