"""The examples in docs/proposer_verifier.md run with the documented output."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path

import pytest

TEXT = (Path(__file__).parents[3] / "docs" / "proposer_verifier.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```(?:\n\n```text\n(.*?)```)?", TEXT, re.DOTALL)


@pytest.mark.parametrize(("block", "printed"), BLOCKS)
def test_example__runs_with_the_documented_output(block: str, printed: str):
    names: dict[str, object] = {}
    with contextlib.redirect_stdout(io.StringIO()) as output:
        exec(block, names)
    assert output.getvalue() == printed
    for expression, value in re.findall(r"^(\S.*?)  # (.+)$", block, re.MULTILINE):
        assert repr(eval(expression, names)) == value
