"""Imported by a fork server before it forks, so that each of its processes starts with the corpus loaded."""

from __future__ import annotations

import json
import multiprocessing
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from lilgym_mp.corpus import TaskSet
from lilgym_mp.corpus.loading import load_tasks
from lilgym_mp.corpus.statement_arrays import training_tasks
from lilgym_mp.envs.machine import start_method_kept

VARIABLE = "LILGYM_MP_PRELOAD"  # arguments of `load_tasks` as JSON


@contextmanager
def preloading(tasks: TaskSet, *modules: str) -> Iterator[None]:
    """A fork server that starts in this block loads the tasks and imports the modules, once.

    Afterwards the variables of this process, its start method and the list of modules to preload are as they were.
    """
    origin = tasks.provenance
    os.environ[VARIABLE] = json.dumps([origin.corpus, origin.appearance, origin.start, origin.split])
    before: list[str] | None = None
    if "forkserver" in multiprocessing.get_all_start_methods():
        from multiprocessing import forkserver

        # There is no public way to read the list.
        before = list(forkserver._forkserver._preload_modules)  # pyright: ignore
        multiprocessing.set_forkserver_preload([*before, __name__, *modules])
    try:
        with start_method_kept():
            yield
    finally:
        del os.environ[VARIABLE]
        if before is not None:
            multiprocessing.set_forkserver_preload(before)


with suppress(KeyError, ValueError, TypeError):  # the environment itself reports what is wrong
    training_tasks(load_tasks(*json.loads(os.environ[VARIABLE])))
