"""Validates a whole corpus: all faults, and the number of valid tasks, in one report."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import NamedTuple

from lilgym_mp.corpus.faults import CorpusError, Fault, FaultLog
from lilgym_mp.corpus.jsonlines import CorpusFile
from lilgym_mp.corpus.loading import load_all_tasks
from lilgym_mp.corpus.locations import corpus_path, is_generated
from lilgym_mp.corpus.records import SPLITS, STARTS
from lilgym_mp.corpus.released import ALL_FILE_NAMES, ReleasedFile, file_name
from lilgym_mp.corpus.tasks import TaskReader, TaskSet, contexts
from lilgym_mp.scene.appearances import APPEARANCES


class TaskCount(NamedTuple):
    """The number of valid tasks, and of distinct MDPs, of one configuration and split."""

    appearance: str
    start: str
    split: str
    tasks: int
    contexts: int


@dataclass(frozen=True, slots=True)
class CorpusReport:
    """Result of `check_corpus`: faults in file order, task counts, missing released files."""

    path: str
    faults: tuple[Fault, ...]
    counts: tuple[TaskCount, ...]
    absent_files: tuple[str, ...]

    @property
    def ok(self) -> bool:
        return not self.faults

    def __str__(self) -> str:
        counts = [
            f"{count.appearance} {count.start} {count.split}: {count.tasks} tasks, {count.contexts} contexts"
            for count in self.counts
        ]
        absent = [f"missing: {name}" for name in self.absent_files]
        faults = [f"fault: {fault}" for fault in self.faults] or ["no faults"]
        return "\n".join([self.path, *counts, *absent, *faults])


def check_corpus(corpus: str | os.PathLike[str]) -> CorpusReport:
    """Validates all of a corpus; `corpus` as for `load_tasks`.

    Raises CorpusError only when the corpus does not exist or cannot be generated.
    """
    if is_generated(corpus):
        return CorpusReport(os.fspath(corpus), (), tuple(map(_count, load_all_tasks(corpus))), ())
    with corpus_path(corpus) as path:
        faults = FaultLog(stop_at_first=False)
        absent = [name for name in ALL_FILE_NAMES if not (path / name).exists()] if path.is_dir() else []
        if len(absent) == len(ALL_FILE_NAMES):
            faults.add(str(path), "has none of the released files")
        counts = tuple(_counts(path, faults))
        return CorpusReport(str(path), tuple(faults.found), counts, tuple(absent))


def _count(tasks: TaskSet) -> TaskCount:
    origin = tasks.provenance
    return TaskCount(origin.appearance, origin.start, origin.split, len(tasks), contexts(tasks))


def _counts(path: Path, faults: FaultLog) -> Iterator[TaskCount]:
    """The counts of every configuration and split of a corpus file, or of those that a directory has."""
    source = None if path.is_dir() else _opened(CorpusFile, path, faults)
    for appearance in APPEARANCES:
        reader = TaskReader(appearance, faults)
        for start, split in product(STARTS, SPLITS):
            released = path / file_name(appearance, start, split)
            if path.is_dir():
                source = _opened(ReleasedFile, released, faults) if released.exists() else None
            if source is not None:
                tasks = [task for task, _ in reader.tasks(source.records(appearance, start, split))]
                yield TaskCount(appearance, start, split, len(tasks), contexts(tasks))


def _opened(reader: type[CorpusFile | ReleasedFile], path: Path, faults: FaultLog) -> CorpusFile | ReleasedFile | None:
    """The file; None, with a fault in the log, if it cannot be read."""
    found_before = len(faults.found)
    try:
        source = reader(path, faults)
    except CorpusError as fault:
        faults.add(str(path), str(fault).removeprefix(f"{path}: "))
        return None
    if not source.entries and len(faults.found) == found_before:
        faults.add(str(path), "has no entries")
    return source
