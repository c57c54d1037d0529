"""Play in the terminal.

Edit the scene until the statement has the target truth value, then stop. Type help for the commands.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import suppress
from importlib import import_module
from pathlib import Path

from lilgym_mp.corpus.records import SPLITS
from lilgym_mp.evaluation.files import writable_file
from lilgym_mp.evaluation.options import add_configuration, add_settings, given_settings, split_of
from lilgym_mp.evaluation.settings import Settings
from lilgym_mp.evaluation.terminal import shows_colours


def add_options(parser: argparse.ArgumentParser) -> None:
    add_configuration(parser, nargs="?", default="TowerScratch")
    add_task_choice(parser)
    parser.add_argument("--gif", type=Path, metavar="FILE", help="write the session as an animation")
    add_settings(parser)


def add_task_choice(parser: argparse.ArgumentParser) -> None:
    """Options for the first task to play."""
    parser.add_argument("--split", choices=list(SPLITS), help="split of the corpus (default: the task's, else dev)")
    parser.add_argument("--task", metavar="ID", help="begin with this task (default: a random one)")
    parser.add_argument("--seed", type=int, metavar="N", help="random seed (default: not seeded)")


def run(args: argparse.Namespace) -> int:
    from lilgym_mp.cli.session import Session

    if args.gif is not None:
        writable_file(args.gif)
    settings = Settings(**given_settings(args))
    env = settings.make(split_of(settings, args.split, args.task))
    session = Session(env, print, coloured=shows_colours())
    try:
        session.begin(seed=args.seed, task_id=args.task)
        for line in input_lines():
            session.answer(line)
            if session.is_over:
                break
    except KeyboardInterrupt:
        print()
    if args.gif is not None and session.save_film(args.gif):
        print(f"film: {args.gif}")
    print(session.score())
    return 0


def input_lines() -> Iterator[str]:
    """Lines of standard input until it ends; on a terminal with line editing and a history."""
    interactive = sys.stdin.isatty()
    if interactive:
        with suppress(ImportError):  # importing it adds editing and a history to `input`
            import_module("readline")
    while True:
        try:
            yield input("> ") if interactive else _read_line()
        except EOFError:
            print()
            return


def _read_line() -> str:
    """The next line of input that is not a terminal, echoed. Raises EOFError at the end."""
    print("> ", end="", flush=True)
    line = sys.stdin.readline()
    if not line:
        raise EOFError
    print(line.rstrip("\n"))
    return line
