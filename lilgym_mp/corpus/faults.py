"""What can be wrong with a corpus, and whether the first fault stops the reading."""

from __future__ import annotations

from typing import NamedTuple

from lilgym_mp.terminal import printable


class CorpusError(ValueError):
    """A corpus that cannot be used: names the file, the line or entry, and the fault. The text is safe to print."""

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


class NoTasksError(CorpusError):
    """A corpus without tasks for the configuration and split asked for."""


class InterruptionError(CorpusError):
    """A download that stopped half-way and can go on later."""


class Fault(NamedTuple):
    """One fault and the place where it is."""

    where: str
    what: str

    def __str__(self) -> str:
        return printable(f"{self.where}: {self.what}")


class FaultLog:
    """Takes faults as they are found: raises the first as CorpusError, or keeps them all."""

    def __init__(self, *, stop_at_first: bool) -> None:
        self.stop_at_first = stop_at_first
        self.found: list[Fault] = []

    def add(self, where: str, what: str) -> None:
        fault = Fault(where, what)
        if self.stop_at_first:
            raise CorpusError(str(fault))
        self.found.append(fault)
