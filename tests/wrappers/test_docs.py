"""The code in docs/wrappers.md runs with the documented output, and every wrapper is documented."""

from __future__ import annotations

import contextlib
import inspect
import io
import pydoc
import re
import warnings
from pathlib import Path

import pytest

from lilgym_mp import wrappers

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "wrappers.md"
DRAWN = "Statement: "  # the drawn statement depends on the corpus


def test_examples__run_with_the_documented_output(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    pytest.importorskip("pettingzoo", reason="pettingzoo is not installed: it comes with the extra `pettingzoo`")
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```(?:\n\n```text\n(.*?)```)?", DOCUMENT.read_text(), re.DOTALL)
    names = {"__name__": "__main__"}
    checked = 0
    for code, promised in blocks:
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed), warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # from the first import of PettingZoo
            exec(compile(code, str(DOCUMENT), "exec"), names)
        if promised:
            assert without_statement(printed.getvalue()) == without_statement(promised)
            checked += 1
    assert checked == 2


def without_statement(text: str) -> list[str]:
    return [line for line in text.splitlines() if not line.startswith(DRAWN)]


@pytest.mark.parametrize("name", [name for name in wrappers.__all__ if name.endswith("_v0")])
def test_every_factory__is_named_in_its_help(name: str):
    title, _, signature, *_ = pydoc.render_doc(getattr(wrappers, name), renderer=pydoc.plaintext).split("\n")
    assert title.startswith(f"Python Library Documentation: function {name} in module lilgym_mp.wrappers")
    assert signature.startswith(f"{name}(")
    assert inspect.signature(getattr(wrappers, name)).return_annotation in ("Any", "AnyEnv")
