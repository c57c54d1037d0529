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

NO_ENTRIES = "has no entries"


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
        present = [name for name in ALL_FILE_NAMES if (path / name).exists()]
        try:
            counts = list(_counts(path, faults))
        except CorpusError as fault:
            faults.add(str(path), str(fault).removeprefix(f"{path}: "))
            counts = []
        absent = [name for name in ALL_FILE_NAMES if name not in present] if path.is_dir() else []
        if path.is_dir() and not present:
            faults.add(str(path), "has none of the released files")
        return CorpusReport(str(path), tuple(faults.found), tuple(counts), tuple(absent))


def _count(tasks: TaskSet) -> TaskCount:
    origin = tasks.provenance
    return TaskCount(origin.appearance, origin.start, origin.split, len(tasks), contexts(tasks))


def _counts(path: Path, faults: FaultLog) -> Iterator[TaskCount]:
    """The counts of every configuration and split of a corpus file, or of those that a directory has."""
    file = None if path.is_dir() else CorpusFile(path, faults)
    if file is not None and not (file.entries or faults.found):
        faults.add(str(path), NO_ENTRIES)
    for appearance in APPEARANCES:
        reader = TaskReader(appearance, faults)
        for start, split in product(STARTS, SPLITS):
            released = path / file_name(appearance, start, split)
            try:
                if file is not None:
                    records = file.records(appearance, start, split)
                elif released.exists():
                    source = ReleasedFile(released, start)
                    records = source.records(faults)
                    if not source.content:
                        faults.add(str(released), NO_ENTRIES)
                else:
                    continue
            except CorpusError as fault:
                faults.add(str(released), str(fault).removeprefix(f"{released}: "))
                continue
            tasks = list(reader.tasks(records))
            yield TaskCount(appearance, start, split, len(tasks), contexts(tasks))
