"""Imported by a fork server before it forks, so that each of its processes starts with the corpus loaded."""

from __future__ import annotations

import json
import os
from contextlib import suppress

from lilgym_mp.corpus.loading import load_tasks
from lilgym_mp.corpus.statement_arrays import training_tasks

VARIABLE = "LILGYM_MP_PRELOAD"  # arguments of `load_tasks` as JSON

with suppress(KeyError, ValueError, TypeError):  # the environment itself reports what is wrong
    training_tasks(load_tasks(*json.loads(os.environ[VARIABLE])))
