"""The checks of checks/ in a shortened form; that of the program language is in tests/programs/test_limits.py."""

from __future__ import annotations

import pytest

from checks.corrupt_files import MISDEEDS, corrupt_corpora
from checks.kills import matrix


@pytest.mark.filterwarnings("default:This process.*is multi-threaded:DeprecationWarning")
def test_kills__are_told_and_leave_nobody_behind() -> None:
    ends = matrix(count=9, interrupts=1, seed=5)
    assert set(ends) <= {
        "SIGKILL: died",
        "SIGSTOP: hung",
        "Ctrl-C, fork: 1 traceback",
        "Ctrl-C, forkserver: 1 traceback",
        "Ctrl-C, spawn: 1 traceback",
    } | {"Ctrl-C, forkserver: 2 traceback", "Ctrl-C, forkserver: 3 traceback"}
    assert sum(ends.values()) == 12


def test_corrupt_corpora__are_told_in_printable_words() -> None:
    found = corrupt_corpora(160, seed=1)
    assert sum(found.values()) == 160
    for misdeed in MISDEEDS:
        if misdeed not in ("gzip", "flip", "odd value"):
            assert f"{misdeed}: told" in found
