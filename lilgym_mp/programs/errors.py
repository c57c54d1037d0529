"""What can be wrong with a program: in its source, or when it is run on a scene."""

from __future__ import annotations

from typing import NamedTuple

CONTEXT = 60  # characters of source shown on either side of a fault


class Position(NamedTuple):
    """Where in the source, both counted from 1."""

    line: int
    column: int


class ProgramError(ValueError):
    """A source text that is not a program of the language.

    `position` and `piece` say where and what, `reason` says which rule it breaks.
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
        """The fault for a person: reason, source line, and a caret under the piece at fault."""
        start = self.source.rfind("\n", 0, self.offset) + 1
        end = self.source.find("\n", self.offset)
        line = self.source[start:] if end < 0 else self.source[start:end]
        column = self.offset - start
        left = max(0, column - CONTEXT)
        right = min(len(line), column + CONTEXT)
        prefix, suffix = ("..." if left else ""), ("..." if right < len(line) else "")
        window = _printable(line[left:right])
        indent = " " * (2 + len(prefix) + column - left)
        carets = "^" * max(1, min(len(self.piece), right - column))
        where = f"line {self.position.line}, column {self.position.column}"
        return f"{self.reason}\n  {prefix}{window}{suffix}\n{indent}{carets}\n{where}"

    def __reduce__(self) -> tuple[type[ProgramError], tuple[str, int, str, str]]:
        return ProgramError, (self.source, self.offset, self.piece, self.reason)


class ProgramRuntimeError(RuntimeError):
    """A program that has no value on a scene: `unique` of nothing, `AND` of a number, too much work."""


def _printable(text: str) -> str:
    """One column a character, so that carets stay in place."""
    return "".join(character if " " <= character <= "~" else "?" for character in text)


def _shown(piece: str) -> str:
    clipped = piece if len(piece) <= CONTEXT else piece[:CONTEXT] + "..."
    return ascii(clipped)
