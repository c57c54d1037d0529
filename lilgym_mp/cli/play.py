"""`lilgym-mp play`: a person plays in the terminal."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lilgym_mp.cli.options import add_configuration, add_settings, add_split, said_settings
from lilgym_mp.evaluation.files import writable_file
from lilgym_mp.evaluation.settings import CONFIGURATIONS, Settings
from lilgym_mp.terminal import shows_colours

if TYPE_CHECKING:
    from lilgym_mp.cli.session import Session
    from lilgym_mp.envs.single import LilGymEnv


def add_parser(subparsers: Any) -> None:
    parser = subparsers.add_parser(
        "play",
        help="play in the terminal, or by mouse in a window",
        description="Change the picture until the statement has the wanted truth value, then stop. Type help.",
    )
    add_configuration(parser, help=f"one of {', '.join(CONFIGURATIONS)}", nargs="?", default="TowerScratch")
    add_split(parser, "train")
    parser.add_argument("--task", metavar="ID", help="begin with this task (default: one drawn at random)")
    parser.add_argument("--seed", type=int, metavar="N", help="of the tasks drawn (default: another each time)")
    parser.add_argument("--gif", type=Path, metavar="FILE", help="write what was played as an animation")
    parser.add_argument("--window", action="store_true", help="play by mouse in a window (the extra human)")
    add_settings(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from lilgym_mp.cli.session import Session

    if args.gif is not None:
        writable_file(args.gif)
    env = Settings(**said_settings(args)).make(args.split)
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
    """A session that speaks in a window, and what plays it there."""
    from lilgym_mp.cli.play_window import Desk, opened, play
    from lilgym_mp.cli.session import Session

    opened()
    desk = Desk(env.dynamics.appearance)

    def say(text: str) -> None:
        if "\n" not in text:  # a hint or a fault; the picture is shown already
            desk.message = text

    return Session(env, say, coloured=False), lambda session: play(session, desk)


def _converse(session: Session) -> None:
    """Reads commands until the person or the input ends."""
    for line in typed_lines():
        session.answer(line)
        if session.is_over:
            return


def typed_lines() -> Iterator[str]:
    """What is typed, line by line, until the input ends; on a terminal with editing and a history."""
    interactive = sys.stdin.isatty()
    if interactive:
        with suppress(ImportError):  # what gives `input` editing and a history, where the system has it
            import_module("readline")
    while True:
        try:
            yield input("> ") if interactive else _read_line()
        except EOFError:
            print()
            return


def _read_line() -> str:
    """The next line of what is no terminal, shown as if it had been typed. Raises EOFError at the end."""
    print("> ", end="", flush=True)
    line = sys.stdin.readline()
    if not line:
        raise EOFError
    print(line.rstrip("\n"))
    return line
