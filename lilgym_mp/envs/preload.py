"""Imported by a fork server before it forks, so that each of its processes starts with the corpus loaded."""

from __future__ import annotations

import json
import multiprocessing
import os
from contextlib import suppress

from lilgym_mp.corpus import TaskSet
from lilgym_mp.corpus.loading import load_tasks
from lilgym_mp.corpus.statement_arrays import training_tasks

VARIABLE = "LILGYM_MP_PRELOAD"  # arguments of `load_tasks` as JSON


def preload_tasks(tasks: TaskSet, *modules: str) -> None:
    """Lets a fork server that starts after this call load the tasks and import the modules, once."""
    origin = tasks.provenance
    os.environ[VARIABLE] = json.dumps([origin.corpus, origin.appearance, origin.start, origin.split])
    if "forkserver" in multiprocessing.get_all_start_methods():
        multiprocessing.set_forkserver_preload(["__main__", __name__, *modules])


with suppress(KeyError, ValueError, TypeError):  # the environment itself reports what is wrong
    training_tasks(load_tasks(*json.loads(os.environ[VARIABLE])))
