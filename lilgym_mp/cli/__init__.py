"""The command `lilgym-mp`: one module a subcommand, each with `add_parser(subparsers)` and `run(args) -> int`.

`add_parser` sets the default `run` of its parser. A command's module imports what is heavy inside `run`, so that
`lilgym-mp --help` stays quick and works without torch.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from importlib import import_module
from typing import NoReturn

from lilgym_mp import __version__
from lilgym_mp.cli.errors import CommandError
from lilgym_mp.extras import install
from lilgym_mp.terminal import printable
from lilgym_mp_command import INTERRUPTED

# In the order of --help; each is a module of this package.
COMMANDS = (
    *("demo", "play", "play-game", "train", "evaluate", "report", "experiment"),
    *("explain", "solve", "demos", "data", "program", "llm", "bench", "serve"),
)

PROGRAM = "lilgym-mp"
FAILED = 1  # exit code of what the machine refused
USAGE_ERROR = 2  # exit code of a mistake in what was asked for
TRAINING_PACKAGES = ("torch", "stable_baselines3", "sb3_contrib", "safetensors")


class _Parser(argparse.ArgumentParser):
    """Tells of a mistake in one line."""

    def error(self, message: str) -> NoReturn:
        raise CommandError(f"{self.prog}: {message}; see {self.prog} --help")


def main(argv: Sequence[str] | None = None) -> int:
    """Runs a command line (by default this process's); gives the exit code."""
    _open_missing_streams()
    name = PROGRAM
    try:
        words = sys.argv[1:] if argv is None else list(argv)
        args = parsed(words)
        name = f"{PROGRAM} {args.command}"
        return _with_output(name, int(args.run(args)))
    except (CommandError, ValueError) as error:
        return _refused(str(error) if name == PROGRAM else f"{name}: {error}")
    except ModuleNotFoundError as error:
        if error.name not in TRAINING_PACKAGES:
            raise
        return _refused(f"{name}: needs {error.name}: {install('sb3')}")
    except BrokenPipeError:  # whoever read our output has gone, as in `lilgym-mp ... | head`
        _forget_output()
        return FAILED
    except OSError as error:
        _with_output(name, FAILED)
        place = "cannot write results" if error.filename is None else error.filename
        return _refused(f"{name}: {place}: {error.strerror or error}", FAILED)
    except KeyboardInterrupt:
        return _interrupted()
    except Exception as error:
        if not _is_of_interrupt(error):
            raise
        return _interrupted()


def _is_of_interrupt(error: BaseException) -> bool:
    """Whether a library made another error of a KeyboardInterrupt, as amid an import."""
    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, KeyboardInterrupt):
        cause = cause.__cause__ or cause.__context__
    return cause is not None


def _interrupted() -> int:
    return _refused("interrupted", INTERRUPTED)


def _open_missing_streams() -> None:
    """Puts what takes and gives nothing where standard streams are closed, as after `>&-`."""
    for stream, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, stream) is None:
            setattr(sys, stream, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115


def _with_output(name: str, code: int) -> int:
    """`code`, once all output is written; FAILED, and a word about it, where it cannot be."""
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        _forget_output()
        return _refused(f"{name}: cannot write results: {error.strerror or error}", FAILED)
    return code


def _forget_output() -> None:
    """Lets what is left to write go nowhere, where it would fail once more at the end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _refused(reason: str, code: int = USAGE_ERROR) -> int:
    with suppress(OSError):  # nobody is there to be told
        print(printable(reason), file=sys.stderr)
    return code


def parsed(words: Sequence[str]) -> argparse.Namespace:
    """What a command line asks for; `words` of it are the words themselves."""
    return make_parser().parse_args(words, argparse.Namespace(words=tuple(words)))


@cache
def make_parser() -> argparse.ArgumentParser:
    """The parser of command lines, with every subcommand."""
    parser = _Parser(prog=PROGRAM, description="lilGym's environments: play, train, measure.")
    parser.add_argument("--version", action="version", version=f"{PROGRAM} {__version__}")
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name in COMMANDS:
        import_module(f"{__name__}.{name.replace('-', '_')}").add_parser(subparsers)
    return parser
