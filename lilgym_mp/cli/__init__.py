"""The command `lilgym-mp`: one module a subcommand, each with `add_parser(subparsers)` and `run(args)`.

A command's module imports what is heavy inside `run`, so that `lilgym-mp --help` stays quick.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module

from lilgym_mp import __version__
from lilgym_mp.cli.errors import CommandError

COMMANDS = ("program",)  # modules of this package, in the order of --help

USAGE_ERROR = 2  # exit code of a mistake in what was asked for
INTERRUPTED = 130  # exit code after Ctrl-C, as shells have it


def main(argv: Sequence[str] | None = None) -> int:
    """Runs a command line (by default this process's); gives the exit code."""
    parser = _parser()
    args = parser.parse_args(argv)
    try:
        return int(args.run(args))
    except (CommandError, ValueError) as fault:
        print(f"lilgym-mp {args.command}: {fault}", file=sys.stderr)
        return USAGE_ERROR
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="lilgym-mp", description="lilGym's environments: play, train, measure.")
    parser.add_argument("--version", action="version", version=f"lilgym-mp {__version__}")
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name in COMMANDS:
        import_module(f"lilgym_mp.cli.{name}").add_parser(subparsers)
    return parser
