"""The command `lilgym-mp`: one module a subcommand, each with `add_parser(subparsers)` and `run(args) -> int`.

`add_parser` sets the default `run` of its parser. A command's module imports what is heavy inside `run`, so that
`lilgym-mp --help` stays quick and works without torch.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import NoReturn

from lilgym_mp import __version__
from lilgym_mp.cli.errors import CommandError

# Modules of this package, in the order of --help.
COMMANDS = ("demo", "play", "train", "evaluate", "solve", "demos", "data", "program", "bench")

PROGRAM = "lilgym-mp"
USAGE_ERROR = 2  # exit code of a mistake in what was asked for
INTERRUPTED = 130  # exit code after Ctrl-C, as shells have it
TRAINING_PACKAGES = ("torch", "stable_baselines3", "sb3_contrib", "tensorboard", "tqdm")


class _Parser(argparse.ArgumentParser):
    """Tells of a mistake in one line."""

    def error(self, message: str) -> NoReturn:
        raise CommandError(f"{self.prog}: {message}; see {self.prog} --help")


def main(argv: Sequence[str] | None = None) -> int:
    """Runs a command line (by default this process's); gives the exit code."""
    try:
        args = _parser().parse_args(argv)
    except CommandError as fault:
        return _refused(str(fault))
    try:
        return int(args.run(args))
    except (CommandError, ValueError) as fault:
        return _refused(f"{PROGRAM} {args.command}: {fault}")
    except ModuleNotFoundError as fault:
        if fault.name not in TRAINING_PACKAGES:
            raise
        return _refused(f'{PROGRAM} {args.command}: needs {fault.name}: pip install "lilgym-mp[sb3]"')
    except BrokenPipeError:  # whoever read our output has gone, as in `lilgym-mp ... | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED


def _refused(reason: str) -> int:
    print(reason, file=sys.stderr)
    return USAGE_ERROR


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog=PROGRAM, description="lilGym's environments: play, train, measure.")
    parser.add_argument("--version", action="version", version=f"{PROGRAM} {__version__}")
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name in COMMANDS:
        import_module(f"{__name__}.{name}").add_parser(subparsers)
    return parser
