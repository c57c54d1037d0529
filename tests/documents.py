"""Runs the code blocks of a document in order and compares their output with the output shown.

A ```python block is executed; its output is the ```text block after it. A ```console block holds `$ lilgym-mp ...`
commands, which run in this process, each followed by its output. In expected output, `...` matches any text. An
exception counts as output, in the form "Type: message". Notes that something takes long to load are left out.
"""

import contextlib
import io
import re
import shlex
from typing import NamedTuple

from lilgym_mp.cli import main

PROMPT = "$ lilgym-mp "
_LOADING = re.compile(r"^loading .* \.\.\.\n", re.MULTILINE)
_BLOCK = re.compile(r"^```(python|console|text)\n(.*?)^```$", re.DOTALL | re.MULTILINE)


class CodeBlock(NamedTuple):
    """Code from a document, and the output it shows, or None if it shows none."""

    language: str
    code: str
    output: str | None
    number: int  # of the block in the document, from 1


def code_blocks(text):
    """The Python blocks and commands of a document."""
    blocks = [(match[1], match[2]) for match in _BLOCK.finditer(text)]
    for number, (language, code) in enumerate(blocks, start=1):
        if language == "python":
            following = blocks[number] if number < len(blocks) else ("", "")
            yield CodeBlock(language, code, following[1] if following[0] == "text" else None, number)
        elif language == "console":
            yield from _commands(code, number)


def _commands(block, number):
    for part in re.split(rf"^(?={re.escape(PROMPT)})", block, flags=re.MULTILINE):
        if part.startswith(PROMPT):
            command, _, output = part.partition("\n")
            yield CodeBlock("console", command.removeprefix(PROMPT), output or None, number)


def run_document(path):
    """Runs a document and returns a message for each block that fails or prints something unexpected."""
    namespace = {"__name__": "__main__"}
    faults = []
    for block in code_blocks(path.read_text()):
        place = f"{path.name}, block {block.number}"
        printed, failed = _run(block.language, block.code, namespace, place)
        if block.output is None and failed:
            faults.append(f"{place}: {printed}")
        elif block.output is not None and not _matches(block.output, printed):
            faults.append(f"{place} shows\n{block.output}but prints\n{printed}")
    return faults


def _run(language, code, namespace, place):
    """The output, and whether the code failed."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        failed = False
        if language == "console":
            failed = main(shlex.split(code, comments=True)) != 0
        else:
            try:
                exec(compile(code, place, "exec"), namespace)
            except Exception as fault:
                print(f"{type(fault).__name__}: {fault}")
                failed = True
    return out.getvalue(), failed


def _matches(expected, printed):
    """Whether the output matches, ignoring trailing blanks; `...` matches any text."""
    pattern = re.escape(_trimmed(expected)).replace(r"\.\.\.", ".*")
    return re.fullmatch(pattern, _trimmed(printed), re.DOTALL) is not None


def _trimmed(text):
    return "\n".join(line.rstrip() for line in _LOADING.sub("", text).strip().splitlines())
