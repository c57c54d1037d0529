"""Evaluate a language model on the tasks of a split.

Plays tasks through text: prompts describe the rules, the scene and the legal actions; actions are parsed from the
answers. Prints every episode's outcome and a summary; an episode whose calls fail does not end the run.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import os
import random
import re
import sys
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from itertools import chain, zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lilgym_mp.cli import llm_play_game
from lilgym_mp.cli.options import (
    RUNS,
    CommandError,
    add_configuration,
    add_number,
    add_seed,
    add_settings,
    add_split,
    add_thoughts,
    argument_type,
    check_at_least,
    given_settings,
)
from lilgym_mp.corpus.notes import printable
from lilgym_mp.corpus.records import unique_keys
from lilgym_mp.corpus.tasks import TaskSet
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.evaluation.files import first_free_path, fresh_file, write_json, write_text
from lilgym_mp.evaluation.terminal import Progress

if TYPE_CHECKING:
    from lilgym_mp.contrib.llm import Failure, Player, Transcript

TRANSCRIPTS, SUMMARY = "transcripts.jsonl", "summary.json"
TEXT_OPTIONS = ("model", "directory", "url", "device")  # never read as JSON: a model may be called 1e3
HOPELESS = 3  # failed episodes, or as many as are played at the same time, after which a run without others ends


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `lilgym-mp llm play`."""
    add_configuration(parser)
    parser.add_argument(
        "--agent", required=True, metavar="NAME", help="openai, transformers, expert, or your own module:Class"
    )
    parser.add_argument(
        "--option",
        action="extend",
        nargs="+",
        default=[],
        metavar="KEY=VALUE",
        help="arguments of the agent's constructor, such as url=http://localhost:8000/v1 model=NAME; for openai also"
        " fields of requests, in JSON, such as top_p=0.9 max_completion_tokens=4096 temperature=null",
    )
    add_split(parser, "dev")
    parser.add_argument("--episodes", type=int, metavar="N", help="only N tasks, drawn over statements (default: all)")
    parser.add_argument(
        "--scene",
        choices=["list", "image", "both"],
        default="list",
        help="show scenes as a list of items, as a picture for vision models, or as both (default: %(default)s)",
    )
    parser.add_argument("--no-legal-actions", action="store_true", help="do not list the legal actions")
    parser.add_argument("--no-system", action="store_true", help="state the rules in the first user message")
    add_thoughts(parser)
    add_number(parser, "--retries", 1, "times to ask again after an answer without a valid action")
    add_number(parser, "--history", 12, "past observations kept in the prompt")
    add_seed(parser, "of the agent")
    parser.add_argument(
        "--concurrency",
        type=int,
        metavar="N",
        help="episodes played at the same time (default: 32 for openai, 8 for transformers; others name theirs, or 1)",
    )
    parser.add_argument(
        "--prices",
        type=argument_type(_price),
        nargs=2,
        metavar=("READ", "WRITTEN"),
        help="of a million tokens, for the cost of the run",
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help=f"write {TRANSCRIPTS} and {SUMMARY} to DIR (default: {RUNS}/llm-CONFIGURATION-AGENT-MODEL; an unfinished"
        " run there with the same settings is continued)",
    )
    parser.add_argument("--resume", action="store_true", help="play what is missing or failed in the run of --out")
    parser.add_argument("--force", action="store_true", help="overwrite existing files")
    add_settings(parser)
    llm_play_game.add_options(parser)


def run(args: argparse.Namespace) -> int:
    """Plays episodes with a language model, writes transcripts and prints a summary."""
    from lilgym_mp.contrib.llm import Player, make_agent, summarise_transcripts
    from lilgym_mp.wrappers.replies import THOUGHTS

    if os.getcwd() not in sys.path:  # for --agent module:Class
        sys.path.append(os.getcwd())
    check_at_least(args, 1, "episodes", "concurrency")
    agent_options = read_agent_options(args.option)
    agent = make_agent(args.agent, agent_options)
    if llm_play_game.is_asked(args):
        return llm_play_game.run(args, agent, agent_options)
    player = Player(
        EnvConfig(**given_settings(args)),
        agent,
        split=args.split,
        scene=args.scene,
        legal_actions=not args.no_legal_actions,
        retries=args.retries,
        history=args.history,
        thoughts=args.thoughts or THOUGHTS,
        system=not args.no_system,
    )
    words = ["llm", args.configuration, args.agent, str(agent_options.get("model", ""))]
    name = re.sub(r"[^\w.-]+", "-", "-".join(filter(None, words)))
    settings = _settings(player, args, agent_options)
    chosen = drawn(player.settings.tasks(args.split), args.episodes, args.seed)
    if args.out is None:
        args.out = RUNS / name if args.force else _default_directory(RUNS / name, settings, chosen, args)
    done = _episodes_to_resume(args.out, settings) if args.resume else []
    for name in (TRANSCRIPTS, SUMMARY):
        fresh_file(args.out / name, force=args.force or args.resume)
    episodes, failures = _play(player, args, chosen, done, settings, agent_options)
    summary = summarise_transcripts(episodes, len(failures), args.prices and tuple(args.prices))
    _print_summary(summary)
    write_json(args.out / SUMMARY, {"settings": settings, **summary})
    print(f"results      {args.out}")
    if failures:
        print(f"failed       {len(failures)} episodes, not in the rates; --out {args.out} --resume plays them")
    return 0


def drawn(tasks: TaskSet, count: int | None, seed: int) -> list[str]:
    """The ids of `count` tasks, or of all, in file order: one of each statement, then a second one, and so on.

    With the same seed, fewer tasks are among more.
    """
    if count is None or count >= len(tasks):
        return list(tasks.ids)
    by_statement: defaultdict[str, list[str]] = defaultdict(list)
    for task in tasks:
        by_statement[task.statement].append(task.id)
    rng = random.Random(f"episodes {seed}")
    groups = [rng.sample(ids, len(ids)) for ids in by_statement.values()]
    rounds = zip_longest(*rng.sample(groups, len(groups)))
    order = [task_id for task_id in chain.from_iterable(rounds) if task_id is not None]
    return sorted(order[:count], key=tasks.index_of)


def _default_directory(
    base: Path, settings: Mapping[str, Any], chosen: Sequence[str], args: argparse.Namespace
) -> Path:
    """The directory below RUNS: that of the unfinished run with these settings, which is resumed, or the next free one.

    Raises CommandError if the run is finished, or was begun with tasks that were edited since.
    """
    end = first_free_path(base)
    number, path = 1, base
    while path != end:
        try:
            before, episodes = _stored(path)
        except CommandError:
            before, episodes = {}, []  # another program's directory
        same = {name: value for name, value in settings.items() if name != "tasks_sha256"}
        if before and {name: before.get(name) for name in same} == same:
            check_settings(path, before, settings)
            missing = set(chosen) - {episode.task for episode in episodes}
            if not missing and not args.resume:
                raise CommandError(
                    f"{path} has this run, all {len(chosen)} episodes; --out DIR plays it again, --force overwrites it"
                )
            print(f"continues    {path}, {len(chosen) - len(missing)} of {len(chosen)} episodes are there")
            args.resume = True
            return path
        number += 1
        path = base.with_name(f"{base.name}-{number}")
    return end


def _settings(player: Player, args: argparse.Namespace, agent_options: Mapping[str, Any]) -> dict[str, Any]:
    """The settings that determine the episodes, in clear but for secrets, and the checksum of the tasks."""
    names = ("agent", "split", "scene", "retries", "history", "seed")
    return {
        **player.settings.to_json(),
        **{name: getattr(args, name) for name in names},
        "option": {name: public(name, value) for name, value in sorted(agent_options.items())},
        "tasks_sha256": player.settings.tasks(args.split).provenance.sha256,
        "legal_actions": player.legal_actions,
        "system": player.system,
        "thoughts": list(player.thoughts),
    }


def _play(
    player: Player,
    args: argparse.Namespace,
    task_ids: Sequence[str],
    done: list[Transcript],
    settings: Any,
    agent_options: Mapping[str, Any],
) -> tuple[list[Transcript], list[Failure]]:
    """Plays the episodes that are not done; prints each and adds it to the transcripts as it ends.

    Returns all episodes, in the order of tasks, and those that failed. Raises CommandError if nothing but failures
    comes back at the beginning.
    """
    from lilgym_mp.contrib.llm import Failure, play_all
    from lilgym_mp.contrib.llm.agents import without_secrets

    index_of = player.settings.tasks(args.split).index_of
    kept = {episode.task: episode for episode in done}
    jobs = [(task, args.seed + index_of(task)) for task in task_ids if task not in kept]
    most = getattr(player.agent, "concurrency", None)
    if most is None and (args.concurrency or 1) > 1:
        raise CommandError(f"--concurrency {args.concurrency}: the agent {args.agent} answers one prompt at a time")
    concurrency = args.concurrency or most or 1
    failures: list[Failure] = []
    transcripts = args.out / TRANSCRIPTS
    _write_transcripts(transcripts, done)
    write_json(args.out / SUMMARY, {"settings": settings})
    with (
        transcripts.open("a", encoding="utf-8") as file,
        Progress(len(task_ids), "episodes", len(task_ids) - len(jobs), prints=False) as bar,
    ):
        for result in play_all(player, jobs, concurrency):
            if isinstance(result, Failure):
                result = replace(result, error=without_secrets(result.error, agent_options))
            file.write(json.dumps(asdict(result), ensure_ascii=False) + "\n")
            file.flush()
            if isinstance(result, Failure):
                failures.append(result)
                print(printable(f"{result.task}: failed: {result.error}").replace("\n", " "))
                if len(kept) == 0 and len(failures) >= min(max(HOPELESS, concurrency), len(jobs)):
                    raise CommandError(f"{result.task}: {result.error} (all of {len(failures)} episodes failed)")
            else:
                kept[result.task] = result
                progression = f"progression {result.progression:.2f}"
                print(f"{result.task}: {result.outcome}, {progression}, {', '.join(result.actions)}")
            bar.advance(note=f"{sum(episode.is_success for episode in kept.values()):,} solved")
    in_order = sorted(kept, key=index_of)
    _write_transcripts(transcripts, [*(kept[task] for task in in_order), *failures])
    return [kept[task] for task in task_ids if task in kept], failures


def _write_transcripts(path: Path, results: Sequence[Transcript | Failure]) -> None:
    write_text(path, "".join(json.dumps(asdict(each), ensure_ascii=False) + "\n" for each in results))


def _episodes_to_resume(out: Path, settings: Mapping[str, Any]) -> list[Transcript]:
    """Raises CommandError naming what is missing or differs."""
    before, episodes = _stored(out)
    check_settings(out, before, settings)
    return episodes


def check_settings(out: Path, before: Mapping[str, Any], settings: Mapping[str, Any]) -> None:
    """Raises CommandError naming the first setting that differs, with both values."""
    for name, value in settings.items():
        if before.get(name) != value:
            raise CommandError(f"{out} was played with {name} {before.get(name)!r}, not {value!r}")


def _stored(out: Path) -> tuple[dict[str, Any], list[Transcript]]:
    """The settings and the episodes in a directory, without those that failed. Raises CommandError."""
    from lilgym_mp.contrib.llm import Transcript

    try:
        before = json.loads((out / SUMMARY).read_text(encoding="utf-8"))["settings"]
        *lines, _ = (out / TRANSCRIPTS).read_text(encoding="utf-8").split("\n")  # the last may be cut
        records = [json.loads(line) for line in lines if line]
        episodes = [Transcript.from_json(record) for record in records if "error" not in record]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise CommandError(f"{out}: no run to resume ({type(error).__name__}: {error})") from None
    return before, episodes


def read_agent_options(options: Sequence[str]) -> dict[str, Any]:
    """The parsed --option: values are read as JSON if they are, "none" as null, otherwise as text.

    Raises CommandError, without showing values.
    """
    parsed: dict[str, Any] = {}
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


def _price(text: str) -> float:
    """Raises ValueError for anything but a finite number of at least 0."""
    price = float(text)
    if not (math.isfinite(price) and price >= 0):
        raise ValueError(f"must be a finite number of at least 0, not {text}")
    return price


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


def _print_summary(summary: dict[str, Any]) -> None:
    interval = f"95 % interval over statements {summary['success_low']:.1%} to {summary['success_high']:.1%}"
    print(f"success      {summary['success']:.1%} ({summary['successes']} of {summary['episodes']}; {interval})")
    print(f"progression  {summary['progression']:.3f} ± {summary['progression_deviation']:.3f}")
    print(f"reward       {summary['mean_reward']:+.2f} in {summary['mean_actions']:.1f} actions")
    print(f"outcomes     {', '.join(f'{name} {number}' for name, number in summary['outcomes'].items())}")
    print_calls(summary)


def print_calls(summary: Mapping[str, Any]) -> None:
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
