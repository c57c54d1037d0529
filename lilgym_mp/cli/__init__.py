"""The command `lilgym-mp`, one module per subcommand.

A module's docstring is its help: its first line in the list of commands, the rest in its own. It defines
`add_options(parser)`, and `run(args) -> int` unless each of its actions sets one. Heavy imports are inside `run`, so
that `lilgym-mp --help` is fast and works without torch.
"""

from __future__ import annotations

import io
import os
import signal
import sys
from argparse import Action, ArgumentError, ArgumentParser, Namespace
from collections.abc import Sequence
from contextlib import suppress
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from threading import current_thread, main_thread
from typing import Any, NoReturn

from lilgym_mp import __version__
from lilgym_mp.cli.options import INTERRUPTED, CommandError, add_commands
from lilgym_mp.corpus.extras import install
from lilgym_mp.corpus.notes import printable
from lilgym_mp.scene.choices import load_extensions
from lilgym_mp.submodules import submodule_getter

# Modules of this package, in the order of --help.
COMMANDS = ("play", "train", "evaluate", "report", "experiment", "explain", "solve", "data", "llm", "bench", "serve")
PROGRAM = "lilgym-mp"
FAILED = 1  # exit code: the command was valid but could not be carried out
USAGE_ERROR = 2  # exit code: invalid arguments
EXTRAS = {  # by package
    **dict.fromkeys(("torch", "safetensors"), "train"),
    **dict.fromkeys(("stable_baselines3", "sb3_contrib"), "sb3"),
    **dict.fromkeys(("fastapi", "starlette", "uvicorn", "pydantic", "anyio"), "web"),
    **dict.fromkeys(("jinja2", "matplotlib"), "report"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Runs a command line, by default that of this process, and returns its exit code."""
    if not _open_missing_streams():
        return _print_error(f"{PROGRAM}: standard output is closed; send it to a file or to {os.devnull}", FAILED)
    if argv is None:  # this process is the command
        if current_thread() is main_thread():
            signal.signal(signal.SIGTERM, signal.default_int_handler)
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, io.TextIOWrapper):  # not in notebooks
                stream.reconfigure(errors="backslashreplace")
    name = PROGRAM
    try:
        args = parse_args(sys.argv[1:] if argv is None else argv)
        name = f"{PROGRAM} {args.command}"
        code = int(args.run(args))
        sys.stdout.flush()
        return code
    except (CommandError, ValueError) as error:
        return _print_error(str(error) if name == PROGRAM else f"{name}: {error}")
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package not in EXTRAS:
            raise
        return _print_error(f"{name}: needs {package}: {install(EXTRAS[package])}")
    except BrokenPipeError:  # the reader of our output has closed it, as in `lilgym-mp ... | head`
        _flush_or_discard_output()
        return FAILED
    except OSError as error:
        _flush_or_discard_output()
        subject = "cannot write results" if error.filename is None else error.filename
        return _print_error(f"{name}: {subject}: {error.strerror or error}", FAILED)
    except (KeyboardInterrupt, Exception) as error:
        if not _is_caused_by_interrupt(error):
            raise
        return _print_error("interrupted", INTERRUPTED)


def parse_args(argv: Sequence[str]) -> Namespace:
    """The parsed command line, which also holds the unparsed `argv`."""
    words = argv[:2] if argv and argv[0] in COMMANDS else ()
    return make_parser(*words).parse_args(argv or ["--help"], Namespace(argv=tuple(argv)))


@cache
def make_parser(only: str | None = None, learner: str | None = None) -> ArgumentParser:
    """The parser, with every subcommand; or with one, and of `train` with one learner, to import no more than these."""
    load_extensions()  # so that the choices include what other packages register
    parser = _Parser(prog=PROGRAM, description="Play, train and evaluate in the lilGym environments.")
    parser.add_argument("--version", action="version", version=f"{PROGRAM} {__version__}")
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    names = COMMANDS if only is None else (only,)
    add_commands(subparsers, {name: f"{__name__}.{name}" for name in names}, {"train": [learner]})
    return parser


class _Parser(ArgumentParser):
    """Raises CommandError, which prints as one line, instead of printing the usage.

    An option with several values may be given several times, and keeps each value once; others only once.
    """

    def __init__(self, *args: Any, **settings: Any) -> None:
        super().__init__(*args, **settings)
        self.register("action", None, _Store)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Namespace, list[str]]:
        """Refuses what this parser does not know, whereas argparse leaves it to the command that has this command."""
        parsed, unknown = super().parse_known_args(args, namespace)
        if unknown:
            known = [option for action in self._actions for option in action.option_strings]
            self.error(f"unrecognized arguments: {' '.join(unknown)}{_did_you_mean(unknown[0].split('=')[0], known)}")
        return parsed, unknown

    def _check_value(self, action: Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            choices = [str(choice) for choice in action.choices]
            message = f"invalid choice: {value!r} (choose from {', '.join(choices)})"
            raise ArgumentError(action, message + _did_you_mean(str(value), choices))

    def error(self, message: str) -> NoReturn:
        see = " See" if message.endswith("?") else "; see"
        raise CommandError(f"{self.prog}: {message}{see} {self.prog} --help")


def _did_you_mean(word: str, known: Sequence[str]) -> str:
    """A question about the known word that is closest; empty if none is close."""
    close = get_close_matches(word, known, 1)
    return f"; did you mean {close[0]}?" if close else ""


class _Store(Action):
    def __call__(self, parser: ArgumentParser, namespace: Namespace, values: Any, option: str | None = None) -> None:
        if option is not None:
            given: set[str] = vars(namespace).setdefault("given_options", set())
            if self.nargs in ("+", "*"):
                values = list(dict.fromkeys([*(getattr(namespace, self.dest) if self.dest in given else ()), *values]))
            elif self.dest in given:
                parser.error(f"argument {option}: given more than once")
            given.add(self.dest)
        if isinstance(values, Path):  # shells leave the ~ of --out=~/x
            values = values.expanduser()
        setattr(namespace, self.dest, values)


def _is_caused_by_interrupt(error: BaseException) -> bool:
    """Tells whether this is a KeyboardInterrupt, or an error that a library made of one, as happens during imports."""
    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, KeyboardInterrupt):
        cause = cause.__cause__ or cause.__context__
    return cause is not None


def _open_missing_streams() -> bool:
    """Replaces closed standard streams, as after `>&-`, by the null device; returns whether stdout was open."""
    has_output = sys.stdout is not None
    for stream, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, stream) is None:
            setattr(sys, stream, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115
    return has_output


def _flush_or_discard_output() -> None:
    """Sends output that cannot be written to the null device, so that flushing it at exit does not fail again."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _print_error(message: str, code: int = USAGE_ERROR) -> int:
    with suppress(OSError):  # stderr may be unusable, too
        print(printable(message), file=sys.stderr)
    return code


__getattr__ = submodule_getter(__name__)
