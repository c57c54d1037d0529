"""Errors of corpora, and a log that collects validation faults or stops at the first."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

from lilgym_mp.corpus.notes import printable

Checked = TypeVar("Checked")


class CorpusError(ValueError):
    """A corpus cannot be used. The message names the file, the line or entry, and the fault, and is safe to print."""

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


class FaultLog:
    """Collects faults, or raises the first as CorpusError if `stop_at_first`."""

    def __init__(self, *, stop_at_first: bool) -> None:
        self.stop_at_first = stop_at_first
        self.found: list[Fault] = []

    def add(self, where: str, what: str) -> None:
        fault = Fault(where, what)
        if self.stop_at_first:
            raise CorpusError(str(fault))
        self.found.append(fault)

    def check(self, where: str, function: Callable[..., Checked], *values: Any) -> Checked | None:
        """What the function returns; None, with a fault in the log, where it raises ValueError."""
        try:
            return function(*values)
        except ValueError as fault:
            self.add(where, str(fault))
            return None
