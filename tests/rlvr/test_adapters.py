"""Each adapter keeps the contract of its library, where that is installed."""

import os

import pytest

from tests.command_line import python
from tests.scripts import ROOT


@pytest.mark.long
@pytest.mark.parametrize(
    ("folder", "library"),
    [
        ("balrog", "gymnasium"),  # the evaluator is in no registry
        *((name, name) for name in ("openenv", "reasoning_gym", "trl", "verifiers")),
    ],
)
def test_adapter__passes_the_tests_of_its_folder(folder, library):
    pytest.importorskip(library, reason=f"needs the library of integrations/{folder}")
    command = ["-m", "pytest", "-q", "-p", "no:cacheprovider", "-c", os.devnull, "--rootdir", "."]
    path = os.pathsep.join([".", str(ROOT), os.environ.get("PYTHONPATH", "")])
    done = python(*command, cwd=ROOT / "integrations" / folder, env={**os.environ, "PYTHONPATH": path})
    assert done.returncode == 0, done.stdout[-5000:] + done.stderr[-2000:]
