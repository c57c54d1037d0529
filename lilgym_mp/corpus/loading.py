"""Loads and validates the tasks of a configuration and split; cached per process."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterable, Iterator
from functools import cache, lru_cache
from itertools import product
from pathlib import Path

from lilgym_mp.corpus.faults import CorpusError, Fault, NoTasksError
from lilgym_mp.corpus.formats import Configuration, read_corpus_file
from lilgym_mp.corpus.locations import PathLike, corpus_path, is_generated, is_split
from lilgym_mp.corpus.notes import note_after, write_note
from lilgym_mp.corpus.records import SPLITS, STARTS
from lilgym_mp.corpus.tasks import Provenance, TaskReader, TaskSet
from lilgym_mp.scene.appearances import APPEARANCES
from lilgym_mp.scene.choices import choose

CACHED_SETS = 16

_LOADING = threading.Lock()


def load_tasks(corpus: PathLike, appearance: str, start: str, split: str, *, needs_tasks: bool = True) -> TaskSet:
    """The validated tasks of one configuration and split.

    Task sets are cached until their file changes; callers in several threads wait for one of them to load a set.

    Args:
        corpus: "builtin", "lilgym" (the official one), "generated:LEVEL:SEED", a split such as "builtin:form", or the
            path of a corpus file, a file of lists or a directory of released files.
        appearance: "tower" or "scatter", or the name of another appearance.
        start: "scratch" or "flipit".
        split: The split's name.
        needs_tasks: Whether statements without a program alone raise NoTasksError; a note on stderr tells of them.

    Returns:
        The tasks, in file order.

    Raises:
        CorpusError: For an unusable corpus; the message names file, entry and fault.
        NoTasksError: When there are no tasks.
        ValueError: For an unknown appearance, start or split.
    """
    choose("appearance", appearance, APPEARANCES)
    choose("start", start, STARTS)
    choose("split", split, SPLITS)
    # What follows is imported when first needed: most processes load the builtin corpus.
    if is_generated(corpus):
        from lilgym_mp.corpus.generator import load_generated

        with _LOADING:
            return load_generated(os.fspath(corpus), appearance, start, split)
    if is_split(corpus):
        from lilgym_mp.corpus.splits import load_listed

        return load_listed(os.fspath(corpus), appearance, start, split)
    with corpus_path(corpus) as path, _LOADING:
        file = path
        if is_released := path.is_dir():
            from lilgym_mp.corpus.official import released_path

            file = released_path(path, appearance, start, split)
        try:
            status = file.stat()
        except OSError as fault:
            raise CorpusError(f"{file}: cannot be read: {fault.strerror or fault}") from None
        cache_key = status.st_mtime_ns, status.st_size, is_released
        path = file.parent.resolve() / file.name
        tasks, contents = _load(os.fspath(corpus), path, cache_key, (appearance, start, split))
    if not tasks and not (tasks.without_program and not needs_tasks):
        raise NoTasksError(f"{path}: has no tasks for {tasks.provenance}; it has {contents}")
    return tasks


def load_all_tasks(
    corpus: PathLike,
    appearances: Iterable[str] = APPEARANCES,
    starts: Iterable[str] = STARTS,
    splits: Iterable[str] = SPLITS,
    *,
    needs_tasks: bool = True,
) -> Iterator[TaskSet]:
    """All non-empty task sets of a corpus, by appearance, start and split. Raises NoTasksError when there are none.

    `needs_tasks`: as for `load_tasks`.
    """
    found = False
    for appearance, start, split in product(appearances, starts, splits):
        try:
            tasks = load_tasks(corpus, appearance, start, split, needs_tasks=needs_tasks)
        except NoTasksError:
            continue
        found = True
        yield tasks
    if not found:
        raise NoTasksError(f"corpus {os.fspath(corpus)!r} has no tasks for the requested configurations and splits")


@lru_cache(maxsize=CACHED_SETS)
def _load(
    corpus: str, file: Path, cache_key: tuple[int, int, bool], configuration: Configuration
) -> tuple[TaskSet, str]:
    """The tasks, possibly none, and what the file has."""
    faults: list[Fault] = []
    appearance, start, split = configuration
    *_, is_released = cache_key
    with note_after(f"loading corpus {corpus}"):
        if is_released:
            from lilgym_mp.corpus.official import read_released_file

            source = read_released_file(file, faults)
        else:
            source = read_corpus_file(file, faults, configuration)
        provenance = Provenance(corpus, source.name, str(file), *configuration, source.sha256)
        reader = TaskReader(appearance, faults)
        found = list(reader.tasks(source.records[configuration], trusted=source.is_prevalidated))
    if faults:
        raise CorpusError(str(faults[0]))
    left_out = [task for task in found if not task.program]
    if count := len({task.statement for task in left_out}):
        _note(f"{file}: {count} statements of {appearance} {split} have no program: they are neither played nor scored")
    return TaskSet((task for task in found if task.program), provenance, left_out), source.contents(start)


_note = cache(write_note)  # says each line once
