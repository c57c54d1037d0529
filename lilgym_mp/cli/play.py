"""Play in the terminal, or by mouse in a window.

Edit the scene until the statement has the target truth value, then stop. Type help for the commands.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from lilgym_mp.corpus.records import SPLITS
from lilgym_mp.evaluation.files import writable_file
from lilgym_mp.evaluation.settings import Settings
from lilgym_mp.options import add_configuration, add_settings, given_settings, split_of
from lilgym_mp.terminal import shows_colours

if TYPE_CHECKING:
    from lilgym_mp.cli.session import Session
    from lilgym_mp.envs.single import LilGymEnv


def add_options(parser: argparse.ArgumentParser) -> None:
    add_configuration(parser, nargs="?", default="TowerScratch")
    add_task_choice(parser)
    parser.add_argument("--gif", type=Path, metavar="FILE", help="write the session as an animation")
    parser.add_argument("--window", action="store_true", help="play by mouse in a window (needs the extra human)")
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
    session, converse = _windowed(env) if args.window else (Session(env, print, coloured=shows_colours()), _converse)
    try:
        session.begin(seed=args.seed, task_id=args.task)
        converse(session)
    except KeyboardInterrupt:
        print()
    if args.gif is not None and session.save_film(args.gif):
        print(f"film: {args.gif}")
    print(session.score())
    return 0


def _windowed(env: LilGymEnv) -> tuple[Session, Callable[[Session], None]]:
    """A session that shows its messages in a window, and the function that plays it there."""
    from lilgym_mp.cli.play_window import ControlPanel, play
    from lilgym_mp.cli.session import Session

    panel = ControlPanel(env.dynamics.appearance)

    def say(text: str) -> None:
        if "\n" not in text:  # a hint or an error; the window shows the picture itself
            panel.message = text

    return Session(env, say, coloured=False), lambda session: play(session, panel)


def _converse(session: Session) -> None:
    """Reads commands until the person quits or the input ends."""
    for line in input_lines():
        session.answer(line)
        if session.is_over:
            return


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
