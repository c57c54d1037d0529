"""Each picture of README and docs has a documented command, is shown on a page, and is not too wide."""

from __future__ import annotations

from fnmatch import fnmatch
from pathlib import Path
from types import ModuleType

import pytest

from tests.scripts import load_script

ROOT = Path(__file__).parent.parent
PICTURES = ROOT / "docs" / "pictures"
SUFFIXES = {".png", ".gif", ".svg"}


@pytest.fixture(scope="module")
def drawing() -> ModuleType:
    pytest.importorskip("pettingzoo")
    return load_script("draw_pictures")


def names() -> set[str]:
    return {path.relative_to(PICTURES).as_posix() for path in PICTURES.rglob("*") if path.suffix in SUFFIXES}


def test_pictures__are_each_made_by_a_documented_command(drawing: ModuleType):
    assert set(drawing.FILES) <= names()
    others = names() - set(drawing.FILES)
    assert [name for name in others if not any(fnmatch(name, pattern) for pattern in drawing.ELSEWHERE)] == []
    assert [pattern for pattern in drawing.ELSEWHERE if not any(fnmatch(name, pattern) for name in others)] == []


def test_pictures__are_each_shown_on_a_page():
    pages = "".join(path.read_text() for path in [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
    assert [name for name in names() if f"pictures/{name}" not in pages] == []


def test_signs__show_the_project_as_it_is(drawing: ModuleType):
    assert (PICTURES / "badges.svg").read_text() == drawing.badges()
    assert (PICTURES / "logo.svg").read_text() == drawing.logo()
