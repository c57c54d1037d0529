"""The command `lilgym-mp`. It stands outside of the package so that Ctrl-C is heeded while that is imported."""

from __future__ import annotations

import os
import signal
import sys
from contextlib import suppress
from typing import NoReturn

INTERRUPTED = 130  # exit code after Ctrl-C, as shells have it


def main() -> int:
    """Runs this process's command line; gives the exit code."""
    try:
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            # Libraries turn a KeyboardInterrupt amid their import into other errors.
            signal.signal(signal.SIGINT, _end)
            from lilgym_mp.cli import main as run
            from lilgym_mp.cli import make_parser

            make_parser()  # which imports every subcommand
            signal.signal(signal.SIGINT, signal.default_int_handler)
        else:  # whoever started this process has Ctrl-C ignored
            from lilgym_mp.cli import main as run
        return run()
    except KeyboardInterrupt:
        _end()


def _end(*_: object) -> NoReturn:
    """Ends the process at once: nothing has begun that would have to be put in order."""
    with suppress(OSError):  # nobody is there to be told
        os.write(2, b"interrupted\n")
    os._exit(INTERRUPTED)


if __name__ == "__main__":
    sys.exit(main())
