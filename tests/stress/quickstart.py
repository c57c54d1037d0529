"""Runs every quickstart line of README and site from the built wheel, in fresh environments.

Each environment has only the extra that the README section names, as in "Needs the extra `sb3`"; tutorials/index.md
names those of the tutorials. Lines that train for minutes are shortened unless --full is args; with it, lines that
name the official data need LILGYM_DATA.
Run from the root of a checkout: python -m tests.stress.quickstart [--full] [--python python3.12] [--torch-index URL]
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

ROOT = Path(__file__).parent.parent.parent
README, INDEX, TUTORIALS = ROOT / "README.md", ROOT / "docs" / "index.md", ROOT / "docs" / "tutorials"
NO_EXTRA = ""
SHORTER: Mapping[str, str] = {  # long-running parts of commands, and their replacements
    "parse-and-plan --corpus lilgym": "parse-and-plan --corpus builtin --updates 2",
    "--corpus lilgym --policy expert random-legal": "--configuration TowerScratch --policy random-legal",
    "--corpus lilgym": "--corpus builtin",
    "--updates 1700": "--updates 2",
    "--minutes 10": "--minutes 0.05",
    "--minutes 4": "--minutes 0.05",
    "--steps 1500000": "--steps 256 --envs 2 --same-statement 1 --rollout 256 --batch-size 128",
    "--minutes 3": "--minutes 0.05",
    "--steps 100000": "--steps 256 --envs 2 --same-statement 1 --rollout 256 --batch-size 128",
}
_HEADING = re.compile(r"^(?=#{2,3} )", re.MULTILINE)
_EXTRA = re.compile(r"extra `(\w+)`")
_CODE = re.compile(r"^```python\n(.*?)^```$|^ {4}\$ \S*?lilgym-mp ([^\n]*?)(?:  +#[^\n]*)?$", re.DOTALL | re.MULTILINE)
_CONSOLE = re.compile(r"^```console\n(.*?)^```$", re.DOTALL | re.MULTILINE)
_RAISED = re.compile(r"\s*```text\n[A-Z]\w+(?:Error|Environment): ")
_ROW = re.compile(r"^\| \[[^]]+\]\((\w+\.md)\).*\| *(.*?) *\|$", re.MULTILINE)
PLAYER = """
import contextlib, io, json, shlex, sys, traceback
names = {"__name__": "__main__"}
for kind, code in json.load(sys.stdin):
    sys.stdin = io.StringIO("stop\\nquit\\n")
    try:
        if kind == "raises":
            with contextlib.suppress(Exception):
                exec(compile(code, "quickstart", "exec"), names)
                sys.exit(f"raised nothing: {code}")
        elif kind == "python":
            exec(compile(code, "quickstart", "exec"), names)
        else:
            from lilgym_mp.cli import main
            assert main(shlex.split(code)) == 0, code
    except Exception:
        traceback.print_exc()
        sys.exit(f"failed: {code}")
import lilgym_mp
print("all lines ran, from", lilgym_mp.__file__)
"""


class Line(NamedTuple):
    """Code or a command that a document shows."""

    kind: str  # "python", "command", or "raises": Python that must raise an error
    code: str


class Quickstart(NamedTuple):
    """Lines that run in order in one process."""

    document: str
    extra: str
    lines: tuple[Line, ...]


def quickstarts(*, full: bool) -> Iterator[Quickstart]:
    """The lines of every document by the extra they need; lines without an extra run before those with one."""
    parts = [(_named_extra(part), list(_readme_lines(part))) for part in _HEADING.split(README.read_text())]
    for extra in dict.fromkeys(extra for extra, _ in parts):
        lines = [line for needed, found in parts if needed in (NO_EXTRA, extra) for line in found]
        yield Quickstart("README.md", extra, _with_length(lines, full=full))
    yield Quickstart("index.md", NO_EXTRA, _with_length(_page_lines(INDEX), full=full))
    for name, needs in _ROW.findall((TUTORIALS / "index.md").read_text()):
        yield Quickstart(name, _named_extra(needs), _with_length(_page_lines(TUTORIALS / name), full=full))


def _named_extra(text: str) -> str:
    found = _EXTRA.search(text)
    return NO_EXTRA if found is None else found[1]


def _readme_lines(part: str) -> Iterator[Line]:
    for python, command in _CODE.findall(part):
        yield Line("python", python) if python else Line("command", command)


def _page_lines(path: Path) -> Iterator[Line]:
    for found in re.finditer(rf"{_CODE.pattern}|{_CONSOLE.pattern}", path.read_text(), re.DOTALL | re.MULTILINE):
        if found[1]:
            yield Line("raises" if _RAISED.match(path.read_text(), found.end()) else "python", found[1])
        for command in re.findall(r"^\$ lilgym-mp (.*?)(?:  +#.*)?$", found[3] or "", re.MULTILINE):
            yield Line("command", command)


def _with_length(lines: Iterator[Line] | Sequence[Line], *, full: bool) -> tuple[Line, ...]:
    if full:
        return tuple(lines)
    return tuple(Line(line.kind, _shorter(line.code)) if line.kind == "command" else line for line in lines)


def _shorter(code: str) -> str:
    for long, short in SHORTER.items():
        code = code.replace(long, short)
    return code


def environment(place: Path, python: str, wheel: Path, extra: str, torch_index: str | None) -> Path:
    """Creates a virtual environment with the wheel and an extra, and returns its Python."""
    subprocess.run([python, "-m", "venv", place], check=True)
    made = place / "bin" / "python"
    install = [made, "-m", "pip", "install", "--quiet"]
    constraints = ROOT / "constraints.txt"
    if torch_index and extra != NO_EXTRA:
        (torch,) = re.findall(r"^torch==.*$", constraints.read_text(), re.MULTILINE)
        subprocess.run([*install, "--index-url", torch_index, torch], check=True)
    subprocess.run([*install, "--constraint", constraints, f"{wheel}[{extra}]" if extra else str(wheel)], check=True)
    return made


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--full", action="store_true", help="train for as long as the documents show")
    parser.add_argument("--python", default=sys.executable, help="the Python that creates the environments")
    parser.add_argument(
        "--torch-index", metavar="URL", help="package index for torch (default: the same as for everything else)"
    )
    parser.add_argument("--only", nargs="+", metavar="DOCUMENT", help="run only these, such as README.md")
    args = parser.parse_args()
    failures = 0
    with tempfile.TemporaryDirectory() as kept:
        scratch = Path(kept)
        build = [args.python, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", scratch, ROOT]
        subprocess.run(build, check=True)
        (wheel,) = scratch.glob("*.whl")
        pythons: dict[str, Path] = {}
        for index, quick in enumerate(quickstarts(full=args.full)):
            if not quick.lines or (args.only and quick.document not in args.only):
                continue
            if quick.extra not in pythons:
                place = scratch / f"venv-{quick.extra or 'none'}"
                pythons[quick.extra] = environment(place, args.python, wheel, quick.extra, args.torch_index)
            failures += not run(quick, pythons[quick.extra], scratch / str(index))
    return int(failures > 0)


def run(quick: Quickstart, python: Path, place: Path) -> bool:
    """Runs the lines in an empty directory, prints the result, and returns whether they succeeded."""
    place.mkdir()
    began = perf_counter()
    environ = {**os.environ, "XDG_CACHE_HOME": str(place), "PYTHONPATH": ""}
    done = subprocess.run(
        [python, "-c", PLAYER],
        input=json.dumps(quick.lines),
        cwd=place,
        env=environ,
        capture_output=True,
        text=True,
        check=False,
    )
    seconds = perf_counter() - began
    outcome = "ran" if done.returncode == 0 else "FAILED"
    extra = quick.extra or "no extra"
    print(f"{quick.document:30} {extra:12} {len(quick.lines):3} lines  {outcome}  {seconds:5.0f} s", flush=True)
    if done.returncode:
        print(done.stdout[-2000:], done.stderr[-3000:], sep="\n", flush=True)
    (Path.cwd() / "build").mkdir(exist_ok=True)
    log = Path.cwd() / "build" / f"quickstart-{quick.document}-{quick.extra}.log"
    log.write_text(done.stdout + done.stderr, encoding="utf-8")
    return done.returncode == 0


if __name__ == "__main__":
    sys.exit(main())
