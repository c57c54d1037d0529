"""The quickstart lines of README and site are complete, and README's commands run (test_docs runs its code)."""

from __future__ import annotations

import io
import shlex
import tomllib
from pathlib import Path

import pytest

from lilgym_mp.cli import main
from tests.stress.quickstart import NO_EXTRA, README, TUTORIALS, quickstarts

EXTRAS = tomllib.loads((README.parent / "pyproject.toml").read_text())["project"]["optional-dependencies"]


def test_quickstarts__cover_readme_and_every_tutorial():
    found = list(quickstarts(full=True))
    pages = {path.name for path in TUTORIALS.glob("*.md")} | {"README.md"}
    assert {quick.document for quick in found} == pages
    assert {quick.extra for quick in found} <= {NO_EXTRA, *EXTRAS}
    assert all(quick.lines for quick in found)


def test_quickstarts__contain_every_line_of_readme():
    text = README.read_text()
    shown = [quick.lines for quick in quickstarts(full=True) if quick.document == "README.md"]
    lines = {line for lines in shown for line in lines}
    assert len([line for line in lines if line.kind == "python"]) == text.count("```python")
    assert len([line for line in lines if line.kind == "command"]) == text.count("$ lilgym-mp ")


def test_quickstarts__shorten_training_unless_full():
    (full,) = [quick for quick in quickstarts(full=True) if (quick.document, quick.extra) == ("README.md", "train")]
    (short,) = [quick for quick in quickstarts(full=False) if (quick.document, quick.extra) == ("README.md", "train")]
    assert any("--minutes 10" in line.code for line in full.lines)
    assert not any("--minutes 10" in line.code or "lilgym " in line.code for line in short.lines)


@pytest.mark.long
@pytest.mark.filterwarnings("default")
def test_readme_commands__run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    pytest.importorskip("torch", reason="needs the extra train")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("LILGYM_DATA", raising=False)
    (quick,) = [quick for quick in quickstarts(full=False) if (quick.document, quick.extra) == ("README.md", "train")]
    commands = [line.code for line in quick.lines if line.kind == "command"]
    assert len(commands) > 3
    for command in commands:
        monkeypatch.setattr("sys.stdin", io.StringIO("stop\nquit\n"))
        assert main(shlex.split(command)) == 0, command
