"""The code in the documents runs and prints the output they show."""

from __future__ import annotations

import io
import re
import shlex
from importlib import import_module
from pathlib import Path
from pkgutil import resolve_name

import pytest

from lilgym_mp.cli import main, parse_args
from tests.documents import run_document

ROOT = Path(__file__).parent.parent
DOCUMENTS = (
    "README.md",
    *(f"docs/{name}.md" for name in ("fidelity", "perception", "vectorised", "stable_baselines3")),
    *(f"docs/{name}.md" for name in ("corpus", "training", "api/index")),
)


@pytest.mark.filterwarnings("default:This process.*is multi-threaded:DeprecationWarning")
@pytest.mark.parametrize("name", [pytest.param(DOCUMENTS[0], marks=pytest.mark.long), *DOCUMENTS[1:]])
def test_code_blocks__run_one_after_another(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    texts = re.findall(r"```python\n(.*?)```", (ROOT / name).read_text(), re.DOTALL)
    assert texts
    monkeypatch.chdir(tmp_path)
    namespace = {"__name__": "__main__"}
    for number, text in enumerate(texts, start=1):
        exec(compile(text, f"{name}, block {number}", "exec"), namespace)


README_SHORTER = {  # long-running parts of README's commands, and their replacements in tests
    "parse-and-plan": "parse-and-plan --updates 2",
    "--configuration TowerFlipIt": "--configuration TowerScratch",
    "--steps 1500000": "--steps 256 --envs 2 --same-statement 1 --rollout 256 --batch-size 128",
}


@pytest.mark.long
@pytest.mark.filterwarnings("default")
def test_readme__commands_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("torch", "matplotlib", "jinja2"):
        pytest.importorskip(module)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("LILGYM_DATA", raising=False)
    commands = re.findall(
        r"^ {4}\$ \S*?lilgym-mp ([^\n]*?)(?:  +#[^\n]*)?$", (ROOT / "README.md").read_text(), re.MULTILINE
    )
    assert len(commands) > 3
    for command in commands:
        for long, short in README_SHORTER.items():
            command = command.replace(long, short)
        monkeypatch.setattr("sys.stdin", io.StringIO("stop\nquit\n"))
        assert main(shlex.split(command)) == 0, command


TOLD_AS_TUTORIALS = ("questions", "troubleshooting", "own_statements", "language_models")
NEEDS = {"troubleshooting.md": ("stable_baselines3", "pettingzoo")}  # optional modules


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize(
    "path",
    [
        *sorted((ROOT / "docs" / "tutorials").glob("*.md")),
        *(ROOT / "docs" / f"{name}.md" for name in TOLD_AS_TUTORIALS),
    ],
    ids=lambda path: path.stem,
)
def test_tutorials__print_the_output_they_show(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in NEEDS.get(path.name, ()):
        pytest.importorskip(module)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("LILGYM_DATA", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert run_document(path) == []


RUN_ELSEWHERE = ("extending", "programs", "proposer_verifier", "wrappers")  # by the tests of what they describe
NOT_RUN = "<!-- not run -->"


def test_code_blocks__are_run_by_a_test_or_marked_as_not_run() -> None:
    run = {"README", *TOLD_AS_TUTORIALS, *RUN_ELSEWHERE, *(Path(name).stem for name in DOCUMENTS)}
    unmarked = [
        f"{path.relative_to(ROOT)}:{text[: block.start()].count(chr(10)) + 1}"
        for path in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
        if path.stem not in run and path.parent.name != "tutorials"
        for text in [path.read_text()]
        for block in re.finditer(r"^ *```python\n", text, re.MULTILINE)
        if not text[: block.start()].rstrip().endswith(NOT_RUN)
    ]
    assert unmarked == [], f"run the code of these documents in DOCUMENTS, or precede it by {NOT_RUN}"


def test_commands__are_accepted_by_the_parser() -> None:
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")]
    text = "\n".join(page.read_text() for page in pages).replace("\\\n", "")
    found = re.findall(r"^ *(?:\$ )?lilgym-mp ([a-z-]+ .*)", text, re.MULTILINE)
    commands = [command for command in found if "[" not in command]  # not a synopsis
    assert len(commands) > 60
    for command in commands:
        plain = re.sub(r"(--seed) \S+", r"\1 0", re.sub(r" [|>&].*", "", command))
        words = shlex.split(plain, comments=True)
        if "--help" not in words and "--version" not in words:
            parse_args(words)


def test_run_document__reports_wrong_output_and_errors(tmp_path: Path) -> None:
    document = tmp_path / "wrong.md"
    document.write_text("```python\nprint(1)\n```\n\n```text\n2\n```\n\n```python\n1 / 0\n```\n")
    first, second = run_document(document)
    assert first.startswith("wrong.md, block 1 shows\n2\nbut prints\n1")
    assert second.startswith("wrong.md, block 3: ZeroDivisionError")


def test_links_between_documents__have_existing_targets() -> None:
    broken = [
        f"{path.name}: {target}"
        for path in [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", path.read_text())
        if not (path.parent / target).exists()
    ]
    assert not broken


def test_reference__names_public_import_paths() -> None:
    """The shortest path by which packages export an object."""
    for page in (ROOT / "docs" / "api").glob("*.md"):
        for path in re.findall("(?m)^::: (.*)", page.read_text()):
            *package, name = path.split(".")
            documented = resolve_name(path)
            for length in range(1, len(package)):
                found = getattr(import_module(".".join(package[:length])), name, None)
                assert found is not documented, f"{page.name}: {path} is also exported by {'.'.join(package[:length])}"


def test_tests_named_in_the_fidelity_table__exist() -> None:
    named = re.findall(r"`(test_[a-z_]+__[a-z_]+[a-z])`", (ROOT / "docs/fidelity.md").read_text())
    sources = "".join(path.read_text() for path in (ROOT / "tests").rglob("test_*.py"))
    assert named
    assert [name for name in named if f"def {name}(" not in sources] == []
