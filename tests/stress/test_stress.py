"""Shortened runs of tests/stress/; tests/programs/test_limits.py has the one for the program language."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.stress.broken_rules import BREAKS, ROOT, Break, broken, first_failure
from tests.stress.corrections import corrections
from tests.stress.corrupt_files import CORRUPTIONS, corrupt_corpora
from tests.stress.hostile_records import hostile_reports
from tests.stress.interrupts import interrupts
from tests.stress.kills import matrix


def test_corrections__of_the_builtin_corpus_become_numbers_only_where_misspelt() -> None:
    found = corrections("builtin")
    assert found["blcak"] == "black"
    assert {word: correction for word, correction in found.items() if correction.isdigit()} == {
        "fuor": "4",
        "thhree": "3",
    }


@pytest.mark.long
def test_hostile_recordings__never_break_the_pages_that_show_them() -> None:
    pytest.importorskip("fastapi", reason="the web application needs the extra `web`")
    from tests.stress.hostile_recordings import attack

    statuses, faults = attack(8, seed=1)
    assert faults == []
    assert sum(statuses.values()) >= 8 * 3


@pytest.mark.long
@pytest.mark.filterwarnings("default:This process.*is multi-threaded:DeprecationWarning")
def test_kills__are_reported_and_leave_no_process_behind() -> None:
    ends = matrix(count=9, interrupts=1, seed=5)
    assert set(ends) <= {
        "SIGKILL: died",
        "SIGSTOP: hung",
        "Ctrl-C, fork: 1 traceback",
        "Ctrl-C, forkserver: 1 traceback",
        "Ctrl-C, spawn: 1 traceback",
    } | {"Ctrl-C, forkserver: 2 traceback", "Ctrl-C, forkserver: 3 traceback"}
    assert sum(ends.values()) == 12


def test_corrupt_corpora__are_reported_in_printable_text() -> None:
    found = corrupt_corpora(160, seed=1)
    assert sum(found.values()) == 160
    for corruption in CORRUPTIONS:
        if corruption not in ("gzip", "flip", "odd value"):
            assert f"{corruption}: reported" in found


@pytest.mark.long
def test_interrupts__end_commands_without_traceback() -> None:
    assert sum(interrupts(4, seed=1).values()) == 4


@pytest.mark.long
def test_hostile_records__give_a_page_or_one_line() -> None:
    assert sum(hostile_reports(12, seed=1).values()) == 12


@pytest.fixture(scope="module")
def undefined_names(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Ruff's report on the broken files, each named after its index in BREAKS."""
    pytest.importorskip("ruff")
    place = tmp_path_factory.mktemp("broken")
    for index, chosen in enumerate(BREAKS):
        (place / f"{index}.py").write_text((ROOT / chosen.file).read_text().replace(chosen.right, chosen.wrong))
    command = [sys.executable, "-m", "ruff", "check", "--isolated", "--no-cache", "--output-format", "concise"]
    command += ["--select", "E9,F821", "."]
    done = subprocess.run(command, cwd=place, capture_output=True, text=True, check=False)
    assert done.returncode in (0, 1), done.stderr
    return f"\n{done.stdout}"


@pytest.mark.parametrize("chosen", BREAKS, ids=lambda chosen: chosen.rule)
def test_broken_rules__are_each_broken_in_one_place_by_code_without_undefined_names(
    chosen: Break, undefined_names: str
) -> None:
    assert (ROOT / chosen.file).read_text().count(chosen.right) == 1
    assert f"\n{BREAKS.index(chosen)}.py:" not in undefined_names, undefined_names
    assert all((ROOT / tests).exists() for tests in chosen.tests)


def test_broken_rules__are_caught_by_their_test_and_restored(tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    (copy / "rules").mkdir(parents=True)
    (copy / "rules" / "cost.py").write_text("COST = 1\n")
    (copy / "test_cost.py").write_text(
        "from rules.cost import COST\n\ndef test_cost__is_one():\n    assert COST == 1\n"
    )
    chosen = Break("cost", "rules/cost.py", "COST = 1", "COST = 2", ("test_cost.py",))
    with broken(copy, chosen):
        assert first_failure(copy, chosen.tests) == "test_cost.py::test_cost__is_one"
    assert (copy / chosen.file).read_text() == "COST = 1\n"
    with (
        pytest.raises(ValueError, match="cost: 'COST = 3' must occur exactly once"),
        broken(copy, chosen._replace(right="COST = 3")),
    ):
        pass


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
