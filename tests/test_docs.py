"""The Python in the documents runs."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
DOCUMENTS = (
    "README.md",
    *(f"docs/{name}.md" for name in ("fidelity", "perception", "augmentation", "vectorised", "language_models")),
)


@pytest.mark.filterwarnings("default:This process.*is multi-threaded:DeprecationWarning")
@pytest.mark.parametrize("name", DOCUMENTS)
def test_code_blocks__run_one_after_another(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    texts = re.findall(r"```python\n(.*?)```", (ROOT / name).read_text(), re.DOTALL)
    assert texts
    monkeypatch.chdir(tmp_path)
    names = {"__name__": "__main__"}
    for number, text in enumerate(texts, start=1):
        exec(compile(text, f"{name}, block {number}", "exec"), names)


def test_links_between_documents__lead_somewhere() -> None:
    broken = [
        f"{path.name}: {target}"
        for path in [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", path.read_text())
        if not (path.parent / target).exists()
    ]
    assert not broken


def test_tests_named_in_the_fidelity_table__exist() -> None:
    named = re.findall(r"`(test_[a-z_]+__[a-z_]+[a-z])`", (ROOT / "docs/fidelity.md").read_text())
    sources = "".join(path.read_text() for path in (ROOT / "tests").rglob("test_*.py"))
    assert named
    assert [name for name in named if f"def {name}(" not in sources] == []
