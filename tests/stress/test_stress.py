"""Shortened runs of tests/stress/; tests/programs/test_limits.py has the one for the program language."""

import pytest
from gymnasium.vector import AutoresetMode

from tests.stress import program_truth, wrapper_stacks
from tests.stress.broken_rules import ROOT, RULES, mutants
from tests.stress.corrupt_files import CORRUPTIONS, corrupt_corpora
from tests.stress.hostile_records import hostile_pages, hostile_reports


@pytest.mark.long
def test_hostile_recordings__never_break_the_pages_that_show_them():
    pytest.importorskip("fastapi")
    statuses, faults = hostile_pages(4, seed=1)
    assert faults == []
    assert sum(statuses.values()) >= 4 * 3


def test_corrupt_corpora__are_reported_in_printable_text():
    found, faults = corrupt_corpora(80, seed=1)
    assert faults == []
    assert sum(found.values()) == 80
    for corruption in CORRUPTIONS:
        if corruption not in ("gzip", "flip"):
            assert f"{corruption}: reported" in found


@pytest.mark.long
def test_hostile_records__give_a_page_or_one_line(monkeypatch):
    def save(figure, path, kind):
        if kind == "pdf":
            figure.draw_without_rendering()  # lays out all texts; writing the files would take most of the time
        path.write_bytes(b"")

    monkeypatch.setattr("lilgym_mp.contrib.report.writing.save", save)
    assert sum(hostile_reports(4, seed=1)[0].values()) == 4


def test_broken_rules__name_functions_with_something_to_break_and_tests():
    for rule, tests in RULES.items():
        file, _, name = rule.partition(":")
        assert any(mutants((ROOT / file).read_text(), name)), rule
        assert all((ROOT / test).exists() for test in tests), rule


@pytest.mark.parametrize("count", [120, pytest.param(1_000, marks=pytest.mark.long)])
def test_random_programs__have_the_same_truth_in_every_form(count):
    compared, differences = program_truth.compare(count=count, seed=20)
    assert not differences
    assert compared["with generated code"] > count / 5
    assert min(compared["true"], compared["false"], compared["errors"]) > count / 2


@pytest.mark.long
def test_random_wrapper_stacks__play_alike_on_single_batched_and_worker_environments():
    compared, found = wrapper_stacks.compare(count=12, seed=4)
    assert not found
    assert compared["played"] >= 6
    assert compared["also by workers"]


@pytest.mark.long
def test_entries_of_steps__are_absent_from_infos_where_every_environment_only_resets():
    stack = [("stop_forcing", {"mode": "replace"}), ("channels_first", {})]
    for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP):
        assert not list(wrapper_stacks.differences("ScatterScratch", stack, mode, workers=False))
