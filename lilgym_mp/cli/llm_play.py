"""Evaluate a language model on the tasks of a split.

Plays tasks through text: prompts describe the rules, the scene and the legal actions; actions are parsed from the
answers. Prints every episode's outcome and a summary; an episode whose calls fail does not end the run.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lilgym_mp.cli import llm_play_game
from lilgym_mp.cli.llm_runs import (
    check_settings,
    default_directory,
    drawn,
    print_calls,
    read_agent_options,
    stored,
    stored_settings,
    success_text,
)
from lilgym_mp.cli.options import (
    JSON,
    RUNS,
    CommandError,
    add_configuration,
    add_flag,
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
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.evaluation.files import (
    fresh_file,
    json_line,
    locked,
    numbered,
    read_lines,
    writable_directory,
    write_json,
    write_lines,
)
from lilgym_mp.evaluation.terminal import Progress

if TYPE_CHECKING:
    from lilgym_mp.contrib.llm import Failure, Player, Transcript

TRANSCRIPTS = "transcripts.jsonl"
SUMMARY = "summary.json"
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
    add_number(parser, "--episodes", None, "only N tasks, drawn over statements (default: all)")
    parser.add_argument(
        "--scene",
        choices=["list", "image", "both"],
        default="list",
        help="show scenes as a list of items, as a picture for vision models, or as both (default: %(default)s)",
    )
    add_flag(parser, "--no-legal-actions", "do not list the legal actions")
    add_flag(parser, "--no-system", "state the rules in the first user message")
    add_thoughts(parser)
    add_number(parser, "--retries", 1, "times to ask again after an answer without a valid action")
    add_number(parser, "--history", 12, "past observations kept in the prompt")
    add_seed(parser, "of the agent")
    purpose = "episodes played at the same time (default: 32 for openai, 8 for transformers; others name theirs, or 1)"
    add_number(parser, "--concurrency", None, purpose)
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
    add_flag(parser, "--resume", "play what is missing or failed in the run of --out")
    add_flag(parser, "--force", "overwrite existing files")
    add_settings(parser)
    llm_play_game.add_options(parser)


def run(args: argparse.Namespace) -> int:
    """Plays episodes with a language model, writes transcripts and prints a summary."""
    from lilgym_mp.contrib.llm import Player, make_agent
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
    tasks = player.settings.tasks(args.split)
    settings = {**player.settings.to_json(), **stored_settings(args, (), tasks.provenance.sha256)}
    chosen = drawn(tasks, args.episodes, args.seed)
    if args.out is None:
        base = default_directory("llm", args.configuration, args.agent, str(agent_options.get("model", "")))
        args.out = base if args.force else _continued(base, settings, chosen, args)
    with locked(writable_directory(args.out)):
        return _play_rest(player, args, chosen, settings, agent_options)


def _play_rest(
    player: Player, args: argparse.Namespace, chosen: Sequence[str], settings: JSON, agent_options: JSON
) -> int:
    """Plays the chosen tasks, except those that a resumed run has; writes and prints the summary."""
    from lilgym_mp.contrib.llm import summarise_transcripts

    done: list[Transcript] = []
    if args.resume:
        before, done = _stored(args.out)
        check_settings(args.out, before, settings)
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


def _continued(base: Path, settings: JSON, chosen: Sequence[str], args: argparse.Namespace) -> Path:
    """The directory: that of the unfinished run with these settings, which is resumed, or the next free one.

    Raises CommandError if the run is finished, or was begun with tasks that were edited since.
    """
    same = {name: value for name, value in settings.items() if name != "tasks_sha256"}
    paths = numbered(base)
    while (path := next(paths)).exists():
        try:
            before, episodes = _stored(path)
        except CommandError:  # another program's directory
            continue
        if any(before.get(name) != value for name, value in same.items()):
            continue
        check_settings(path, before, settings)
        missing = set(chosen) - {episode.task for episode in episodes}
        if not missing and not args.resume:
            raise CommandError(
                f"{path} has this run, all {len(chosen)} episodes; --out DIR plays it again, --force overwrites it"
            )
        print(f"continues    {path}, {len(chosen) - len(missing)} of {len(chosen)} episodes are there")
        args.resume = True
        return path
    return path


def _play(
    player: Player,
    args: argparse.Namespace,
    task_ids: Sequence[str],
    done: list[Transcript],
    settings: Any,
    agent_options: JSON,
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
    write_lines(transcripts, map(asdict, done))
    write_json(args.out / SUMMARY, {"settings": settings})
    with (
        transcripts.open("a", encoding="utf-8") as file,
        Progress(len(task_ids), "episodes", len(task_ids) - len(jobs), prints=False) as bar,
    ):
        for result in play_all(player, jobs, concurrency):
            if isinstance(result, Failure):
                result = replace(result, error=without_secrets(result.error, agent_options))
            file.write(json_line(asdict(result)))
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
    write_lines(transcripts, map(asdict, [*(kept[task] for task in in_order), *failures]))
    return [kept[task] for task in task_ids if task in kept], failures


def _stored(out: Path) -> tuple[JSON, list[Transcript]]:
    """The settings and the episodes in a directory, without those that failed. Raises CommandError."""
    from lilgym_mp.contrib.llm import Transcript

    try:
        _, before = stored(out / SUMMARY)
        episodes = [Transcript.from_json(each) for each in read_lines(out / TRANSCRIPTS) if "error" not in each]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise CommandError(f"{out}: no run to resume ({type(error).__name__}: {error})") from None
    return before, episodes


def _price(text: str) -> float:
    """Raises ValueError for anything but a finite number of at least 0."""
    price = float(text)
    if not (math.isfinite(price) and price >= 0):
        raise ValueError(f"must be a finite number of at least 0, not {text}")
    return price


def _print_summary(summary: JSON) -> None:
    print("success     ", success_text(summary, f"{summary['successes']} of {summary['episodes']}"))
    print(f"progression  {summary['progression']:.3f} ± {summary['progression_deviation']:.3f}")
    print(f"reward       {summary['mean_reward']:+.2f} in {summary['mean_actions']:.1f} actions")
    print(f"outcomes     {', '.join(f'{name} {number}' for name, number in summary['outcomes'].items())}")
    print_calls(summary)
