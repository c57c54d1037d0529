"""The command `lilgym-mp`, outside the package so that Ctrl-C works while the package is being imported."""

from __future__ import annotations

import os
import signal
import sys
from contextlib import suppress
from types import FrameType
from typing import NoReturn

INTERRUPTED = 130  # the shell convention for Ctrl-C


def main() -> int:
    """Runs the command line of this process and returns the exit code."""
    try:
        if end_on_interrupt():
            from lilgym_mp.cli import main as run
            from lilgym_mp.cli import make_parser

            make_parser()  # imports every subcommand
            signal.signal(signal.SIGINT, _interrupt)
        else:  # the parent process disabled Ctrl-C
            from lilgym_mp.cli import main as run
        return run()
    except KeyboardInterrupt:
        _end()


def end_on_interrupt() -> bool:
    """Lets Ctrl-C end the process at once, unless the parent process disabled it; returns whether it does.

    Some libraries turn a KeyboardInterrupt during their import into other errors.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)
    return signal.getsignal(signal.SIGINT) is _end


def _interrupt(signal_number: int, frame: FrameType | None) -> None:
    """Raises KeyboardInterrupt, or ends the process while something is being imported: some libraries swallow it."""
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            _end()
        frame = frame.f_back
    raise KeyboardInterrupt


def _end(*_: object) -> NoReturn:
    """Ends the process at once."""
    with suppress(OSError):  # stderr is closed
        os.write(2, b"interrupted\n")
    os._exit(INTERRUPTED)


if __name__ == "__main__":
    sys.exit(main())
