"""The checks of checks/ in a shortened form; that of the program language is in tests/programs/test_limits.py."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

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


def test_children__heed_an_interrupt_that_the_shell_had_ignored():
    """As under `nohup make test &`."""
    code = """
import signal, subprocess, sys
signal.signal(signal.SIGINT, signal.SIG_IGN)
from tests.conftest import pytest_configure
pytest_configure()
child = "import signal; print(signal.getsignal(signal.SIGINT) is signal.default_int_handler)"
subprocess.run([sys.executable, "-c", child], check=True)
"""
    root = Path(__file__).resolve().parents[1]
    done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True)
    assert done.stdout == "True\n"
