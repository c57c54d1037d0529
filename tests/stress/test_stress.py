"""Shortened runs of tests/stress/; tests/programs/test_limits.py has the one for the program language."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.stress.broken_rules import ROOT, RULES, first_failure, mutants, replaced
from tests.stress.corrupt_files import CORRUPTIONS, corrupt_corpora
from tests.stress.hostile_records import hostile_pages, hostile_reports


@pytest.mark.long
def test_hostile_recordings__never_break_the_pages_that_show_them() -> None:
    pytest.importorskip("fastapi", reason="the web application needs the extra `web`")
    statuses, faults = hostile_pages(8, seed=1)
    assert faults == []
    assert sum(statuses.values()) >= 8 * 3


def test_corrupt_corpora__are_reported_in_printable_text() -> None:
    found, faults = corrupt_corpora(160, seed=1)
    assert faults == []
    assert sum(found.values()) == 160
    for corruption in CORRUPTIONS:
        if corruption not in ("gzip", "flip", "odd value"):
            assert f"{corruption}: reported" in found


@pytest.mark.long
def test_hostile_records__give_a_page_or_one_line() -> None:
    assert sum(hostile_reports(12, seed=1)[0].values()) == 12


def test_broken_rules__name_functions_with_something_to_break_and_tests() -> None:
    for rule, tests in RULES.items():
        file, _, name = rule.partition(":")
        assert any(mutants((ROOT / file).read_text(), name)), rule
        assert all((ROOT / test).exists() for test in tests), rule


def test_broken_rules__are_caught_by_their_test_and_restored(tmp_path: Path) -> None:
    source = "class Rule:\n    def holds(self, x):\n        return not x and x + 2 > 1\n"
    (tmp_path / "rule.py").write_text(source)
    test = "from rule import Rule\n\ndef test_rule():\n    assert Rule().holds(0)\n    assert not Rule().holds(-1)\n"
    (tmp_path / "test_rule.py").write_text(test)
    changes = dict(mutants(source, "Rule.holds"))
    assert {change.partition(" -> ")[2] for change in changes} == {
        *("+x", "not x or x + 2 > 1", "x + 2 >= 1", "x - 2", "3", "2"),
    }
    with replaced(tmp_path / "rule.py", changes["line 3: not x -> +x"]):
        assert first_failure(tmp_path, ("test_rule.py",)) == "test_rule.py::test_rule"
    assert (tmp_path / "rule.py").read_text() == source
    assert first_failure(tmp_path, ("test_rule.py",)) is None


def test_children__handle_interrupts_even_if_the_shell_ignored_them():
    """As under `nohup make test &`."""
    code = """
import signal, subprocess, sys
signal.signal(signal.SIGINT, signal.SIG_IGN)
from tests.conftest import pytest_configure
pytest_configure()
child = "import signal; print(signal.getsignal(signal.SIGINT) is signal.default_int_handler)"
subprocess.run([sys.executable, "-c", child], check=True)
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "True\n"
