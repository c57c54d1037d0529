"""Commands of tests, written as one types them."""

from __future__ import annotations

import shlex

from lilgym_mp.cli import main


def lilgym(command: str, *more: object) -> int:
    """Runs `lilgym-mp` in this process with the words of `command`, then `more`; returns the exit code."""
    return main([*shlex.split(command), *map(str, more)])
