"""Compile-time and run-time errors of programs."""

from __future__ import annotations

import re
from typing import NamedTuple

CONTEXT = 60  # characters of source shown on either side of an error


class Position(NamedTuple):
    """A 1-based position in the source."""

    line: int
    column: int


class ProgramError(ValueError):
    """A source text that is not a valid program; `position` is the line and column of the fault, counted from 1.

    Args:
        source: The program's text.
        offset: Index of the fault in `source`.
        piece: The offending text.
        reason: The rule it breaks.
    """

    def __init__(self, source: str, offset: int, piece: str, reason: str) -> None:
        self.source = source
        self.offset = offset
        self.piece = piece
        self.reason = reason
        before = source[:offset]
        self.position = Position(before.count("\n") + 1, offset - (before.rfind("\n") + 1) + 1)
        shown = f" at {_shown(piece)}" if piece else ""
        super().__init__(f"line {self.position.line}, column {self.position.column}{shown}: {reason}")

    def explain(self) -> str:
        """A multi-line message: the reason, the source line, and carets under the offending text."""
        start = self.source.rfind("\n", 0, self.offset) + 1
        end = self.source.find("\n", self.offset)
        line = self.source[start:] if end < 0 else self.source[start:end]
        column = self.offset - start
        left = max(0, column - CONTEXT)
        right = min(len(line), column + CONTEXT)
        prefix = "..." if left else ""
        suffix = "..." if right < len(line) else ""
        window = re.sub("[^ -~]", "?", line[left:right])  # so that the carets stay aligned
        indent = " " * (2 + len(prefix) + column - left)
        carets = "^" * max(1, min(len(self.piece), right - column))
        where = f"line {self.position.line}, column {self.position.column}"
        return f"{self.reason}\n  {prefix}{window}{suffix}\n{indent}{carets}\n{where}"

    def __reduce__(self) -> tuple[type[ProgramError], tuple[str, int, str, str]]:
        return ProgramError, (self.source, self.offset, self.piece, self.reason)


class ProgramRuntimeError(RuntimeError):
    """A program has no value on a scene: `unique` of an empty list, `AND` of a number, an exceeded limit."""


class StepLimitError(ProgramRuntimeError):
    """An evaluation needs more steps than its limit."""


def _shown(piece: str) -> str:
    clipped = piece if len(piece) <= CONTEXT else piece[:CONTEXT] + "..."
    return ascii(clipped)


class FallbackError(Exception):
    """Generated code cannot decide the value; fall back to the reference evaluator."""
