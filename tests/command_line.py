"""Commands of tests, written as one types them."""

import io
import shlex
import subprocess
import sys

from lilgym_mp.cli import USAGE_ERROR, main


class Terminal(io.StringIO):
    """A stream that claims to be a terminal."""

    def isatty(self):
        return True


def terminal_as_stderr(monkeypatch):
    """A terminal as the standard error stream."""
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr("sys.stderr", Terminal())
    return sys.stderr


def python(*arguments, **settings):
    """What a new process of Python printed, and how it ended; `settings`: of `subprocess.run`."""
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=False, **settings)


def lilgym(command, *more):
    """Runs `lilgym-mp` in this process with the words of `command`, then `more`; returns the exit code."""
    return main([*shlex.split(command), *map(str, more)])


def succeeds(command, *more):
    """Runs a command that must succeed."""
    assert lilgym(command, *more) == 0


def output_of(capsys, command, *more):
    """What a command that must succeed prints."""
    succeeds(command, *more)
    return capsys.readouterr().out


def error_of(capsys, command, *more):
    """What a command that must be refused as wrongly used prints on the standard error stream."""
    assert lilgym(command, *more) == USAGE_ERROR
    return capsys.readouterr().err
