"""A shortened run of tests/stress/program_truth.py."""

from __future__ import annotations

import pytest

from tests.stress.program_truth import compare


@pytest.mark.parametrize("count", [200, pytest.param(2_000, marks=pytest.mark.long)])
def test_random_programs__have_the_same_truth_in_every_form(count: int) -> None:
    compared, differences = compare(count=count, seed=20)
    assert not differences
    assert compared["with generated code"] > count / 5
    assert min(compared["true"], compared["false"], compared["errors"]) > count / 2
