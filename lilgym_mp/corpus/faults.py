"""Errors of corpora, and checks that collect faults."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

from lilgym_mp.corpus.notes import printable

Checked = TypeVar("Checked")


class CorpusError(ValueError):
    """A corpus cannot be used. The message names the file, the line or entry, and the fault, and is safe to print.

    Args:
        message: The text; characters that cannot be printed are escaped.
    """

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


class NoTasksError(CorpusError):
    """The corpus has no tasks for the requested configuration and split."""


class Fault(NamedTuple):
    """A validation fault and its location."""

    where: str
    what: str

    def __str__(self) -> str:
        return printable(f"{self.where}: {self.what}")


def checked(faults: list[Fault], where: str, function: Callable[..., Checked], *values: Any) -> Checked | None:
    """What the function returns; None, and one more fault, where it raises ValueError."""
    try:
        return function(*values)
    except ValueError as fault:
        faults.append(Fault(where, str(fault)))
        return None
