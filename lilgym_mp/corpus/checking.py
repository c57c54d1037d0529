"""Validates a whole corpus: all faults, and the number of valid tasks, in one report."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import NamedTuple

from lilgym_mp.corpus.faults import CorpusError, Fault
from lilgym_mp.corpus.formats import read_corpus_file
from lilgym_mp.corpus.loading import load_all_tasks
from lilgym_mp.corpus.locations import PathLike, corpus_path, is_generated, is_split
from lilgym_mp.corpus.official import RELEASED_NAMES, read_released_file
from lilgym_mp.corpus.tasks import TaskReader, TaskSet, contexts
from lilgym_mp.scene.appearances import APPEARANCES


class TaskCount(NamedTuple):
    """The number of valid tasks, and of distinct MDPs, of one configuration and split."""

    appearance: str
    start: str
    split: str
    tasks: int
    contexts: int
    without_program: int = 0  # start scenes, or statements of Scratch, without a program


@dataclass(frozen=True, slots=True)
class CorpusReport:
    """Result of `check_corpus`: faults in file order, task counts, missing released files."""

    path: str
    faults: tuple[Fault, ...]
    counts: tuple[TaskCount, ...]
    absent_files: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """Whether the corpus has no faults."""
        return not self.faults

    def __str__(self) -> str:
        counts = [
            f"{count.appearance} {count.start} {count.split}: {count.tasks} tasks, {count.contexts} contexts"
            + (f"; {count.without_program} without a program, not played" if count.without_program else "")
            for count in self.counts
            if count.tasks or count.without_program
        ]
        absent = [f"missing: {name}" for name in self.absent_files]
        faults = [f"fault: {fault}" for fault in self.faults] or ["no faults"]
        return "\n".join([self.path, *counts, *absent, *faults])


def check_corpus(corpus: PathLike) -> CorpusReport:
    """Validates all of a corpus.

    Args:
        corpus: As for `load_tasks`.

    Returns:
        The faults in file order, counts of tasks, and missing released files.

    Raises:
        CorpusError: Only when the corpus does not exist or cannot be generated.
    """
    if is_generated(corpus) or is_split(corpus):
        return CorpusReport(os.fspath(corpus), (), tuple(map(_count, load_all_tasks(corpus))), ())
    with corpus_path(corpus) as path:
        is_released = path.is_dir()
        absent = [name for name in RELEASED_NAMES if not (path / name).exists()] if is_released else []
        faults = [Fault(str(path), "has none of the released files")] if len(absent) == len(RELEASED_NAMES) else []
        files = [path / name for name in RELEASED_NAMES if name not in absent] if is_released else [path]
        readers = {appearance: TaskReader(appearance, faults) for appearance in APPEARANCES}
        counts: list[TaskCount] = []
        for file in files:
            faults_before = len(faults)
            try:
                source = read_released_file(file, faults) if is_released else read_corpus_file(file, faults)
            except CorpusError as fault:
                faults.append(Fault(str(file), str(fault).removeprefix(f"{file}: ")))
                continue
            if not any(source.records.values()) and len(faults) == faults_before:
                faults.append(Fault(str(file), "has no entries"))
            for configuration, records in source.records.items():
                found = list(readers[configuration[0]].tasks(records))
                tasks = [task for task in found if task.program]
                counts.append(TaskCount(*configuration, len(tasks), contexts(tasks), len(found) - len(tasks)))
        return CorpusReport(str(path), tuple(dict.fromkeys(faults)), tuple(counts), tuple(absent))


def _count(tasks: TaskSet) -> TaskCount:
    origin = tasks.provenance
    return TaskCount(origin.appearance, origin.start, origin.split, len(tasks), contexts(tasks))
