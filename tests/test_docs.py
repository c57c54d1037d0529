"""The code in the documents runs and prints the output they show; their links and pictures are right."""

import doctest
import fnmatch
import io
import re
import shlex
from pathlib import Path

import pytest
from PIL import Image, ImageSequence

from lilgym_mp.cli import main, parse_args
from lilgym_mp.solver import expert
from tests.documents import run_document
from tests.scripts import ROOT, load_script, needs

PAGES = (
    *("api/index", "corpus", "fidelity", "language_models", "own_statements", "perception"),
    *("proposer_verifier", "questions", "troubleshooting", "vectorised", "wrappers"),
)
DOCUMENTS = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
PICTURES = (".png", ".gif", ".svg")
LONG_PAGES = ("README.md", "docs/stable_baselines3.md")
NEEDS = {  # optional modules
    "proposer_verifier.md": ("pettingzoo",),
    "stable_baselines3.md": ("stable_baselines3",),
    "troubleshooting.md": ("stable_baselines3",),
}


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize(
    "path",
    [
        *(pytest.param(ROOT / name, marks=pytest.mark.long) for name in LONG_PAGES),
        *sorted((ROOT / "docs" / "tutorials").glob("*.md")),
        *(ROOT / "docs" / f"{name}.md" for name in PAGES),
    ],
    ids=lambda path: path.stem,
)
def test_pages__print_the_output_they_show(path, tmp_path, monkeypatch):
    needs(*NEEDS.get(path.name, ()))
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("LILGYM_DATA", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert run_document(path) == []


def test_solver__has_correct_doctests():
    for failures, tried in (doctest.testfile(str(ROOT / "docs" / "solver.md"), False), doctest.testmod(expert)):
        assert (failures, tried > 3) == (0, True)


README_SHORTER = {  # long-running parts of README's commands, and their replacements in tests
    "parse-and-plan": "parse-and-plan --updates 2 --generated-pairs 100 --width 32 --held-out-statements 5",
    "--configuration TowerFlipIt": "--configuration TowerScratch --corpus OWN",
    "--steps 1500000": "--steps 256 --envs 2 --same-statement 1 --rollout 256 --batch-size 128",
}


@pytest.mark.long
@pytest.mark.filterwarnings("default")
def test_readme__commands_run(tmp_path, monkeypatch, own):
    needs("torch", "matplotlib", "jinja2")
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
        assert main(shlex.split(command.replace("OWN", own))) == 0, command


RUN_ELSEWHERE = ("extending", "programs")  # by the tests of what they describe
NOT_RUN = "<!-- not run -->"


def test_code_blocks__are_run_by_a_test_or_marked_as_not_run():
    run = {*RUN_ELSEWHERE, *(Path(name).stem for name in (*PAGES, *LONG_PAGES))}
    unmarked = [
        f"{path.relative_to(ROOT)}:{text[: block.start()].count(chr(10)) + 1}"
        for path in DOCUMENTS
        if path.stem not in run and path.parent.name != "tutorials"
        for text in [path.read_text()]
        for block in re.finditer(r"^ *```python\n", text, re.MULTILINE)
        if not text[: block.start()].rstrip().endswith(NOT_RUN)
    ]
    assert unmarked == [], f"run the code of these documents in PAGES, or precede it by {NOT_RUN}"


def test_commands__are_accepted_by_the_parser():
    text = "\n".join(page.read_text() for page in DOCUMENTS if page.stem != "CHANGELOG").replace("\\\n", "")
    found = re.findall(r"^ *(?:\$ )?lilgym-mp ([a-z-]+ .*)", text, re.MULTILINE)
    commands = [command for command in found if "[" not in command]  # not a synopsis
    assert len(commands) > 60
    for command in commands:
        plain = re.sub(r"(--seed) \S+", r"\1 0", re.sub(r" [|>&].*", "", command))
        words = shlex.split(plain, comments=True)
        if "--help" not in words and "--version" not in words:
            parse_args(words)


def test_addresses__have_parameters_that_their_page_reads():
    addresses = re.findall(r"`/(\w+)\?([^`]+)`", "".join(path.read_text() for path in DOCUMENTS))
    assert addresses
    unread = [
        f"/{page}?{name}"
        for page, query in addresses
        for script in [(ROOT / "lilgym_mp/contrib/web/assets" / f"{page}.js").read_text()]
        for name in re.findall(r"(?:^|&)(\w+)", query)
        if f'get("{name}")' not in script and not re.search(rf"function choose\(\{{[^}}]*\b{name}\b", script)
    ]
    assert unread == []


def test_links_between_documents__have_existing_targets():
    broken = [
        f"{path.name}: {target}"
        for path in DOCUMENTS
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", path.read_text())
        if not (path.parent / target).exists()
    ]
    assert not broken


def test_tests_named_in_the_fidelity_table__exist():
    named = re.findall(r"`(test_[a-z_]+__[a-z_]+[a-z])`", (ROOT / "docs/fidelity.md").read_text())
    sources = "".join(path.read_text() for path in (ROOT / "tests").rglob("test_*.py"))
    assert named
    assert [name for name in named if f"def {name}(" not in sources] == []


def test_pictures__are_each_shown_on_a_page_and_made_by_a_documented_command():
    needs("pettingzoo")
    drawing = load_script("draw_pictures")
    folder = ROOT / "docs" / "pictures"
    names = {path.relative_to(folder).as_posix() for path in folder.rglob("*.*") if path.suffix in PICTURES}
    pages = "".join(path.read_text() for path in DOCUMENTS)
    assert [name for name in names if f"pictures/{name}" not in pages] == []
    assert names >= set(drawing.FILES)
    others = names - set(drawing.FILES)
    found = {pattern: set(fnmatch.filter(others, pattern)) for pattern in drawing.ELSEWHERE}
    assert set.union(*found.values()) == others
    assert [pattern for pattern, named in found.items() if not named] == []
    assert (folder / "badges.svg").read_text() == drawing.badges()
    assert (folder / "logo.svg").read_text() == drawing.logo()


@pytest.mark.long
def test_pictures_drawn_from_code_and_tables__are_the_saved_ones(tmp_path, monkeypatch):
    needs("torch", "matplotlib", "pettingzoo")
    drawing = load_script("draw_pictures")
    saved = drawing.PICTURES
    monkeypatch.setattr(drawing, "PICTURES", tmp_path)
    for name in drawing.DRAWN.keys() - {"report"}:  # which has the fonts of the machine
        drawing.DRAWN[name]()
    drawn = sorted(tmp_path.iterdir())
    assert {path.name for path in drawn} == {*drawing.FILES} - {"report.png"}
    assert [path.name for path in drawn if _pixels(path) != _pixels(saved / path.name)] == []


def _pixels(path):
    """The frames of a picture, or the text of a drawing."""
    if path.suffix == ".svg":
        return path.read_text()
    with Image.open(path) as picture:
        return [frame.convert("RGB").tobytes() for frame in ImageSequence.Iterator(picture)]
