"""A shortened run of tests/stress/program_truth.py."""

from __future__ import annotations

from tests.stress.program_truth import compare


def test_random_programs__have_the_same_truth_in_every_form() -> None:
    compared, differences = compare(count=2_000, seed=20)
    assert not differences
    assert compared["with generated code"] > 400
    assert min(compared["true"], compared["false"], compared["errors"]) > 1_000
