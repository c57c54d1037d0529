"""What docs/solver.md and the expert's docstring show is what happens."""

from __future__ import annotations

import doctest
from pathlib import Path

from lilgym_mp.solver import expert

DOCUMENT = Path(__file__).parents[2] / "docs" / "solver.md"


def test_document__shows_what_happens():
    failures, tried = doctest.testfile(str(DOCUMENT), module_relative=False)
    assert (failures, tried > 10) == (0, True)


def test_docstrings__show_what_happens():
    failures, tried = doctest.testmod(expert)
    assert (failures, tried > 3) == (0, True)
