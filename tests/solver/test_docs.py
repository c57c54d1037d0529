"""The examples in docs/solver.md and in the expert's docstring."""

from __future__ import annotations

import doctest
from pathlib import Path

from lilgym_mp.solver import expert

DOCUMENT = Path(__file__).parents[2] / "docs" / "solver.md"


def test_document__has_correct_examples():
    failures, tried = doctest.testfile(str(DOCUMENT), module_relative=False)
    assert (failures, tried > 10) == (0, True)


def test_docstring__has_correct_examples():
    failures, tried = doctest.testmod(expert)
    assert (failures, tried > 3) == (0, True)
