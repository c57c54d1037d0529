"""Evaluate a language model on the tasks of a split.

Plays tasks through text: prompts describe the rules, the scene and the legal actions; actions are parsed from the
answers. Prints every episode's outcome and a summary; an episode whose calls fail does not end the run.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lilgym_mp.cli.options import (
    RUNS,
    CommandError,
    add_configuration,
    add_number,
    add_seed,
    add_settings,
    add_split,
    add_thoughts,
    check_at_least,
    given_settings,
)
from lilgym_mp.corpus.notes import printable
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.evaluation.files import first_free_path, fresh_file, write_json, write_text
from lilgym_mp.evaluation.terminal import Progress

if TYPE_CHECKING:
    from lilgym_mp.contrib.llm import Episode, Failure, Player

TRANSCRIPTS = "transcripts.jsonl"
SUMMARY = "summary.json"
# Options of an agent's constructor that the summary shows. Others are left out, as they could be keys.
PUBLIC_OPTIONS = (
    *("model", "directory", "temperature", "top_p", "seed", "reasoning_effort", "timeout", "retries"),
    *("max_tokens", "max_completion_tokens", "max_new_tokens"),
)
HOPELESS = 3  # failed episodes, or as many as are played at the same time, after which a run without others ends


def add_options(parser: argparse.ArgumentParser) -> None:
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
    parser.add_argument("--episodes", type=int, metavar="N", help="only the first N tasks (default: all)")
    parser.add_argument(
        "--scene",
        choices=["list", "image", "both"],
        default="list",
        help="show scenes as a list of items, as a picture for models that see, or as both (default: %(default)s)",
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
        type=float,
        nargs=2,
        metavar=("READ", "WRITTEN"),
        help="of a million tokens, for the cost of the run",
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help=f"write {TRANSCRIPTS} and {SUMMARY} to DIR (default: {RUNS}/llm-CONFIGURATION-AGENT-MODEL)",
    )
    parser.add_argument("--resume", action="store_true", help="play what is missing or failed in the run of --out")
    parser.add_argument("--force", action="store_true", help="overwrite existing files")
    add_settings(parser)


def run(args: argparse.Namespace) -> int:
    from lilgym_mp.contrib.llm import Player, make_agent, summarise
    from lilgym_mp.wrappers.replies import THOUGHTS

    if os.getcwd() not in sys.path:  # for --agent module:Class
        sys.path.append(os.getcwd())
    check_at_least(args, 1, "episodes", "concurrency")
    agent_options = dict(map(_key_and_value, args.option))
    agent = make_agent(args.agent, agent_options)
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
    args.out = args.out or first_free_path(RUNS / name)
    settings = _settings(player, args)
    done = _episodes_to_resume(args.out, settings) if args.resume else []
    for name in (TRANSCRIPTS, SUMMARY):
        fresh_file(args.out / name, force=args.force or args.resume)
    episodes, failures = _play(player, args, done, settings)
    summary = summarise(episodes, len(failures), args.prices and tuple(args.prices))
    _print_summary(summary)
    write_json(args.out / SUMMARY, {"settings": settings, **summary})
    print(f"results      {args.out}")
    if failures:
        print(f"failed       {len(failures)} episodes, not in the rates; --out {args.out} --resume plays them")
    return 0


def _settings(player: Player, args: argparse.Namespace) -> dict[str, Any]:
    """The settings that determine the episodes."""
    names = ("agent", "split", "scene", "retries", "history", "seed")
    return {
        **player.settings.to_json(),
        **{name: getattr(args, name) for name in names},
        "option": sorted(map(_public, args.option)),
        "legal_actions": player.legal_actions,
        "system": player.system,
        "thoughts": list(player.thoughts),
    }


def _play(
    player: Player, args: argparse.Namespace, done: list[Episode], settings: Any
) -> tuple[list[Episode], list[Failure]]:
    """Plays the episodes that are not done; prints each and adds it to the transcripts as it ends.

    Returns all episodes, in the order of tasks, and those that failed. Raises CommandError if nothing but failures
    comes back at the beginning.
    """
    from lilgym_mp.contrib.llm import Failure, play_all

    task_ids = player.task_ids()[: args.episodes]
    kept = {episode.task: episode for episode in done}
    jobs = [(task, args.seed + index) for index, task in enumerate(task_ids) if task not in kept]
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
    episodes = [kept.pop(task) for task in task_ids if task in kept]
    _write_transcripts(transcripts, [*episodes, *kept.values(), *failures])
    return episodes, failures


def _write_transcripts(path: Path, results: Sequence[Episode | Failure]) -> None:
    write_text(path, "".join(json.dumps(asdict(each), ensure_ascii=False) + "\n" for each in results))


def _episodes_to_resume(out: Path, settings: dict[str, Any]) -> list[Episode]:
    """Raises CommandError naming what is missing or differs."""
    from lilgym_mp.contrib.llm import Episode

    try:
        before = json.loads((out / SUMMARY).read_text(encoding="utf-8"))["settings"]
        *lines, _ = (out / TRANSCRIPTS).read_text(encoding="utf-8").split("\n")  # the last may be cut
        records = [json.loads(line) for line in lines if line]
        episodes = [Episode.from_json(record) for record in records if "error" not in record]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise CommandError(f"{out}: no run to resume ({type(error).__name__}: {error})") from None
    for name, value in settings.items():
        if before.get(name) != value:
            raise CommandError(f"{out} was played with {name} {before.get(name)!r}, not {value!r}")
    return episodes


def _key_and_value(text: str) -> tuple[str, Any]:
    """A parsed --option; its value is read as JSON if it is, "none" as null, otherwise as text."""
    key, sign, value = text.partition("=")
    if not sign or not key.isidentifier():
        raise CommandError(f"--option takes KEY=VALUE, not {text!r}")
    try:
        return key, None if value.lower() == "none" else json.loads(value)
    except (ValueError, RecursionError):
        return key, value


def _public(option: str) -> str:
    """The --option without what could be a key."""
    from lilgym_mp.contrib.llm.openai_agent import without_credentials

    key, _, value = option.partition("=")
    if key == "url":
        return f"{key}={without_credentials(value)}"
    return option if key in PUBLIC_OPTIONS else f"{key}=..."


def _print_summary(summary: dict[str, Any]) -> None:
    tokens = ""
    if summary["prompt_tokens"] is not None and summary["completion_tokens"] is not None:
        tokens = f"{summary['prompt_tokens']:,} tokens read, {summary['completion_tokens']:,} written, "
    interval = f"95 % interval {summary['success_low']:.1%} to {summary['success_high']:.1%}"
    print(f"success      {summary['success']:.1%} ({summary['successes']} of {summary['episodes']}; {interval})")
    print(f"progression  {summary['progression']:.3f} ± {summary['progression_deviation']:.3f}")
    print(f"reward       {summary['mean_reward']:+.2f} in {summary['mean_actions']:.1f} actions")
    print(f"answers      {summary['answers']}, {summary['misunderstood']} of them without a valid action")
    money = "" if summary["cost"] is None else f"{summary['cost']:.4g} at the given prices, "
    retried = f", {summary['failed_calls']} failed calls" if summary["failed_calls"] else ""
    print(f"cost         {tokens}{money}{summary['seconds']:.1f} seconds{retried}")
