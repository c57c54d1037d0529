"""Plays a document: runs its code blocks one after another, and compares what they print with what it shows.

A block ```python is executed; ```console holds lines `$ lilgym-mp ...`, which are run in this process. What is printed
is compared with the rest of a console block, or with the block ```text that follows a Python block; `...` stands for
anything. An exception counts as printed, as its type and message.
"""

from __future__ import annotations

import contextlib
import io
import re
import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from lilgym_mp.cli import main

PROMPT = "$ lilgym-mp "
_BLOCK = re.compile(r"^```(python|console|text)\n(.*?)^```$", re.DOTALL | re.MULTILINE)


class Shown(NamedTuple):
    """A block of code with what the document says that it prints; None where it says nothing."""

    language: str
    code: str
    printed: str | None
    number: int


def shown_blocks(text: str) -> Iterator[Shown]:
    """The blocks of a document that can be run."""
    blocks = [(match[1], match[2]) for match in _BLOCK.finditer(text)]
    for number, (language, code) in enumerate(blocks, start=1):
        if language == "python":
            after = blocks[number] if number < len(blocks) else ("", "")
            yield Shown(language, code, after[1] if after[0] == "text" else None, number)
        elif language == "console":
            yield from _commands(code, number)


def _commands(block: str, number: int) -> Iterator[Shown]:
    for part in re.split(rf"^(?={re.escape(PROMPT)})", block, flags=re.MULTILINE):
        if part.startswith(PROMPT):
            command, _, printed = part.partition("\n")
            yield Shown("console", command.removeprefix(PROMPT), printed or None, number)


def play(path: Path, shorter: Mapping[str, str] | None = None) -> list[str]:
    """Runs a document; gives a line for each block that prints something else than it shows, or fails.

    `shorter`: parts of commands and what to run instead; their output is not compared.
    """
    names: dict[str, Any] = {"__name__": "__main__"}
    faults: list[str] = []
    for shown in shown_blocks(path.read_text()):
        code = shown.code
        for long, short in (shorter or {}).items():
            code = code.replace(long, short)
        where = f"{path.name}, block {shown.number}"
        printed, failed = _run(shown.language, code, names, where)
        expected = shown.printed if code == shown.code else None
        if expected is None and failed:
            faults.append(f"{where}: {printed}")
        elif expected is not None and not _fits(expected, printed):
            faults.append(f"{where} shows\n{expected}but prints\n{printed}")
    return faults


def _run(language: str, code: str, names: dict[str, Any], where: str) -> tuple[str, bool]:
    """What is printed, and whether it ended in an error."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        if language == "console":
            status = main(shlex.split(code, comments=True))
            return out.getvalue(), status != 0
        try:
            exec(compile(code, where, "exec"), names)
        except Exception as fault:
            print(f"{type(fault).__name__}: {fault}")
            return out.getvalue(), True
    return out.getvalue(), False


def _fits(expected: str, printed: str) -> bool:
    """Whether `printed` is what is expected, but for `...` and blanks at the ends of lines."""
    pattern = r".*".join(map(re.escape, re.split(r"\.\.\.", _trimmed(expected))))
    return re.fullmatch(pattern, _trimmed(printed), re.DOTALL) is not None


def _trimmed(text: str) -> str:
    return "\n".join(line.rstrip() for line in text.strip().splitlines())
