"""The examples in docs/proposer_verifier.md run with the documented output."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path

import pytest

from lilgym_mp.envs.proposer_verifier import PRESETS, PROTOCOLS, SCRIPTED, TERMS, GameSettings

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


@pytest.mark.parametrize("name", PROTOCOLS)
def test_document__has_a_row_for_every_protocol(name: str):
    assert f'\n| `"{name}"` |' in TEXT


@pytest.mark.parametrize("name", [*GameSettings.__dataclass_fields__, *PRESETS, *TERMS, *SCRIPTED])
def test_document__mentions_every_name(name: str):
    assert name in TEXT
