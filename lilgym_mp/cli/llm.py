"""Evaluate a language model on the tasks of a split.

Plays tasks through text: prompts describe the rules, the scene and the legal actions; actions are parsed from the
answers. Prints every episode's outcome and a summary.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lilgym_mp.evaluation.files import fresh_file, write_json, write_text
from lilgym_mp.evaluation.recording_metadata import RecordingMetadata
from lilgym_mp.evaluation.settings import Settings
from lilgym_mp.options import (
    CommandError,
    add_configuration,
    add_number,
    add_recording,
    add_seed,
    add_settings,
    add_split,
    check_at_least,
    given_settings,
)
from lilgym_mp.terminal import Progress

if TYPE_CHECKING:
    from lilgym_mp.llm import Episode, Player, Summary

TRANSCRIPTS, SUMMARY = "transcripts.jsonl", "summary.json"


def add_options(parser: argparse.ArgumentParser) -> None:
    add_configuration(parser)
    parser.add_argument(
        "--agent", required=True, metavar="NAME", help="random, expert, http, transformers, or your own module:Class"
    )
    parser.add_argument(
        "--option",
        action="extend",
        nargs="+",
        default=[],
        metavar="KEY=VALUE",
        help="arguments of the agent's constructor, such as url=http://localhost:8000/v1 model=NAME",
    )
    add_split(parser, "dev")
    parser.add_argument("--episodes", type=int, metavar="N", help="only the first N tasks (default: all)")
    parser.add_argument(
        "--scene",
        choices=["list", "drawing"],
        default="list",
        help="describe scenes as a list of items or as a character drawing (default: %(default)s)",
    )
    parser.add_argument("--no-legal-actions", action="store_true", help="do not list the legal actions")
    add_number(parser, "--retries", 1, "times to ask again after an answer without a valid action")
    add_number(parser, "--history", 12, "past observations kept in the prompt")
    add_seed(parser, "of the agent")
    parser.add_argument("--out", type=Path, metavar="DIR", help=f"write {TRANSCRIPTS} and {SUMMARY} to DIR")
    parser.add_argument("--force", action="store_true", help="overwrite existing files")
    add_recording(parser, "--record")
    add_settings(parser)


def run(args: argparse.Namespace) -> int:
    from lilgym_mp.llm import Player, make_agent, summarise
    from lilgym_mp.llm.recording import write_recording

    if os.getcwd() not in sys.path:  # for --agent module:Class
        sys.path.append(os.getcwd())
    check_at_least(args, 1, "episodes")
    agent_options = dict(map(_key_and_value, args.option))
    _check_output(args, agent_options)
    player = Player(
        Settings(**given_settings(args)),
        make_agent(args.agent, agent_options),
        split=args.split,
        scene=args.scene,
        legal_actions=not args.no_legal_actions,
        retries=args.retries,
        history=args.history,
    )
    episodes = _play(player, args)
    summary = summarise(episodes)
    _print_summary(summary)
    if args.out is not None:
        names = ("agent", "split", "scene", "retries", "history", "seed")
        options = {
            **{name: getattr(args, name) for name in names},
            "option": list(map(_public, args.option)),
            "legal_actions": player.legal_actions,
        }
        write_json(args.out / SUMMARY, {"settings": {**player.settings.to_json(), **options}, **summary.to_json()})
    if args.record is not None:
        judges = args.judge_decisions
        path = write_recording(
            args.record, player, args.agent, episodes, args.seed, judges=judges, options=agent_options
        )
        RecordingMetadata.now(_public_command(args)).write(path)
        print(f"episodes: {path}")
    return 0


def _play(player: Player, args: argparse.Namespace) -> list[Episode]:
    """Plays the episodes; prints each as it ends, and writes it if --out is given."""
    from lilgym_mp.llm import AgentError

    episodes: list[Episode] = []
    lines: list[str] = []

    def write(lines: list[str]) -> None:
        if args.out is not None:
            write_text(args.out / TRANSCRIPTS, "".join(lines))

    task_ids = player.task_ids()[: args.episodes]
    with Progress(len(task_ids), "episodes", lines=0) as progress:
        for index, task_id in enumerate(task_ids):
            try:
                episode = player.play(task_id, args.seed + index)
            except AgentError as error:
                failed = {"task": task_id, "error": str(error), "messages": player.conversation}
                write([*lines, json.dumps(failed, ensure_ascii=False) + "\n"])
                raise CommandError(f"{task_id}: {error} ({len(episodes)} played before)") from None
            print(f"{task_id}: {episode.outcome}, progression {episode.progression:.2f}, {', '.join(episode.actions)}")
            episodes.append(episode)
            lines.append(json.dumps(episode.to_json(), ensure_ascii=False) + "\n")
            write(lines)
            progress.advance(note=f"{sum(episode.is_success for episode in episodes):,} solved")
    return episodes


def _check_output(args: argparse.Namespace, agent_options: dict[str, Any]) -> None:
    """Raises OutputError if results exist and may not be overwritten, or cannot be written."""
    from lilgym_mp.evaluation.recording import episodes_file
    from lilgym_mp.llm.recording import recording_name

    if args.judge_decisions and args.record is None:
        raise CommandError("--judge-decisions needs --record DIR")
    if args.record is not None:
        settings = Settings(**given_settings(args))
        named = recording_name(args.agent, agent_options)
        fresh_file(episodes_file(args.record, named, settings, args.split, args.seed), force=args.force)
    if args.out is not None:
        for name in (TRANSCRIPTS, SUMMARY):
            fresh_file(args.out / name, force=args.force)


def _key_and_value(text: str) -> tuple[str, Any]:
    """A parsed --option, its value a number if it looks like one."""
    key, sign, value = text.partition("=")
    if not sign or not key.isidentifier():
        raise CommandError(f"--option takes KEY=VALUE, not {text!r}")
    for number in (int, float):
        try:
            return key, number(value)
        except ValueError:
            continue
    return key, value


def _public(option: str) -> str:
    """The --option without what could be a key."""
    from lilgym_mp.llm.http_agent import without_credentials
    from lilgym_mp.llm.recording import RECORDED_OPTIONS

    key, _, value = option.partition("=")
    if key == "url":
        return f"{key}={without_credentials(value)}"
    return option if key in (*RECORDED_OPTIONS, "timeout_seconds", "retries") else f"{key}=..."


def _public_command(args: argparse.Namespace) -> list[str]:
    """The command's arguments, with each --option as `_public` gives it."""
    words: list[str] = []
    for word in args.argv:
        name, _, value = word.partition("=")
        if word in args.option:
            words.append(_public(word))
        elif name.startswith("-") and value in args.option:  # --option=KEY=VALUE
            words.append(f"{name}={_public(value)}")
        else:
            words.append(word)
    return words


def _print_summary(summary: Summary) -> None:
    tokens = ""
    if summary.prompt_tokens is not None and summary.completion_tokens is not None:
        tokens = f"{summary.prompt_tokens:,} tokens read, {summary.completion_tokens:,} written, "
    interval = f"95 % interval {summary.success_low:.1%} to {summary.success_high:.1%}"
    print(f"success      {summary.success:.1%} ({summary.successes} of {summary.episodes}; {interval})")
    print(f"progression  {summary.progression:.3f} ± {summary.progression_deviation:.3f}")
    print(f"reward       {summary.mean_reward:+.2f} in {summary.mean_actions:.1f} actions")
    print(f"answers      {summary.answers}, {summary.misunderstood} of them without a valid action")
    print(f"cost         {tokens}{summary.seconds:.1f} seconds")
