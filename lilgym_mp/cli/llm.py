"""`lilgym-mp llm`: a language model, or any agent that reads and writes, on the tasks of a split."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lilgym_mp.cli.errors import CommandError
from lilgym_mp.cli.options import add_configuration, add_settings, add_split, said_settings
from lilgym_mp.evaluation.circumstances import Circumstances
from lilgym_mp.evaluation.files import writable_directory, write_json, write_text
from lilgym_mp.evaluation.settings import Settings
from lilgym_mp.terminal import Progress

if TYPE_CHECKING:
    from lilgym_mp.llm import Episode, Player, Summary

TRANSCRIPTS, SUMMARY = "transcripts.jsonl", "summary.json"


def add_parser(subparsers: Any) -> None:
    parser = subparsers.add_parser(
        "llm",
        help="a language model on the tasks of a split",
        description="Plays tasks through text: the scene, the rules and the legal actions are told, answers are read "
        "back. Without --out only the summary is shown.",
    )
    add_configuration(parser)
    parser.add_argument(
        "--agent", required=True, metavar="NAME", help="random, expert, http, transformers, or module:Class of yours"
    )
    parser.add_argument(
        "--option",
        nargs="+",
        default=[],
        metavar="KEY=VALUE",
        help="what the agent is made with, such as url=http://localhost:8000/v1 model=NAME",
    )
    add_split(parser, "dev")
    parser.add_argument("--episodes", type=int, metavar="N", help="only the first N tasks (default: all)")
    parser.add_argument("--scene", choices=["list", "drawing"], default="list", help="how scenes are told")
    parser.add_argument("--no-legal-actions", action="store_true", help="do not list the legal actions")
    parser.add_argument("--retries", type=int, default=1, metavar="N", help="questions more after an unclear answer")
    parser.add_argument("--history", type=int, default=12, metavar="N", help="past observations that are kept in view")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of agents that draw (default: 0)")
    parser.add_argument("--out", type=Path, metavar="DIRECTORY", help=f"writes {TRANSCRIPTS} and {SUMMARY} there")
    parser.add_argument("--force", action="store_true", help="overwrite what --out holds")
    parser.add_argument(
        "--record", type=Path, metavar="DIR", help="also write the episodes there, with every answer, for /watch"
    )
    parser.add_argument(
        "--judge-decisions",
        action="store_true",
        help="with --record: ask the expert in each step whether the action taken begins a shortest solution "
        "(slow in Scatter)",
    )
    add_settings(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from lilgym_mp.llm import Player, make_agent, summarise

    if args.episodes is not None and args.episodes < 1:
        raise CommandError(f"--episodes must be at least 1, not {args.episodes}")
    _check_free(args)
    player = Player(
        Settings(**said_settings(args)),
        make_agent(args.agent, dict(map(_pair, args.option))),
        split=args.split,
        scene=args.scene,
        legal_actions=not args.no_legal_actions,
        retries=args.retries,
        history=args.history,
    )
    episodes = _played(player, args)
    summary = summarise(episodes)
    print(*_shown(summary), sep="\n")
    if args.out is not None:
        write_json(args.out / SUMMARY, {"settings": _settings(args, player), **summary.to_json()})
    if args.record is not None:
        _record(player, args, episodes)
    return 0


def _played(player: Player, args: argparse.Namespace) -> list[Episode]:
    """The episodes, each printed, and written if --out says where, as it ends."""
    episodes: list[Episode] = []
    lines: list[str] = []
    task_ids = player.task_ids()[: args.episodes]
    with Progress(len(task_ids), "episodes", lines=0) as progress:
        for number, task_id in enumerate(task_ids):
            episode = player.play(task_id, args.seed + number)
            print(f"{task_id}: {episode.outcome}, progression {episode.progression:.2f}, {', '.join(episode.actions)}")
            episodes.append(episode)
            lines.append(json.dumps(episode.to_json(), ensure_ascii=False) + "\n")
            if args.out is not None:
                write_text(args.out / TRANSCRIPTS, "".join(lines))
            progress.advance(note=f"{sum(episode.is_success for episode in episodes):,} solved")
    return episodes


def _record(player: Player, args: argparse.Namespace, episodes: list[Episode]) -> None:
    from lilgym_mp.llm.recording import write_recording

    path = write_recording(args.record, player, args.agent, episodes, args.seed, judges=args.judge_decisions)
    Circumstances.now(args.words).write(path)
    print(f"episodes: {path}")


def _check_free(args: argparse.Namespace) -> None:
    """Raises CommandError where results are already, unless they may be overwritten."""
    from lilgym_mp.evaluation.recording import episodes_file
    from lilgym_mp.llm.recording import recording_name

    if args.judge_decisions and args.record is None:
        raise CommandError("--judge-decisions goes with --record DIR, where decisions are kept")
    if args.record is not None:
        settings = Settings(**said_settings(args))
        place = writable_directory(args.record)
        path = episodes_file(place, recording_name(args.agent), settings, args.split, args.seed)
        if path.exists() and not args.force:
            raise CommandError(f"{path} exists; --force overwrites it")
    if args.out is None:
        return
    writable_directory(args.out)
    there = [name for name in (TRANSCRIPTS, SUMMARY) if (args.out / name).exists()]
    if there and not args.force:
        raise CommandError(f"{args.out / there[0]} exists; --force overwrites it")


def _pair(text: str) -> tuple[str, Any]:
    """A keyword and its value, a number where it looks like one."""
    key, sign, value = text.partition("=")
    if not sign or not key.isidentifier():
        raise CommandError(f"--option takes KEY=VALUE, not {text!r}")
    for kind in (int, float):
        try:
            return key, kind(value)
        except ValueError:
            continue
    return key, value


def _settings(args: argparse.Namespace, player: Player) -> dict[str, Any]:
    said = {name: getattr(args, name) for name in ("agent", "option", "split", "scene", "retries", "history", "seed")}
    return {**player.settings.to_json(), **said, "legal_actions": player.legal_actions}


def _shown(summary: Summary) -> list[str]:
    tokens = (
        f"{summary.prompt_tokens:,} tokens read, {summary.completion_tokens:,} written, "
        if summary.prompt_tokens is not None and summary.completion_tokens is not None
        else ""
    )
    return [
        f"success      {summary.success:.1%} ({summary.successes} of {summary.episodes};"
        f" 95 % interval {summary.success_low:.1%} to {summary.success_high:.1%})",
        f"progression  {summary.progression:.3f} +- {summary.progression_deviation:.3f}",
        f"reward       {summary.mean_reward:+.2f} in {summary.mean_actions:.1f} actions",
        f"answers      {summary.answers}, {summary.misunderstood} of which decided for no action",
        f"cost         {tokens}{summary.seconds:.1f} seconds",
    ]
