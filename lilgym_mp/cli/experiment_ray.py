"""Executes an experiment's runs as tasks of a Ray cluster: a run whose node dies is retried on another."""

from __future__ import annotations

import io
import logging
import tarfile
import tempfile
from collections.abc import Callable, Sequence
from contextlib import chdir
from importlib import import_module
from pathlib import Path
from typing import Any

from lilgym_mp.cli.experiment_plan import PlannedRun
from lilgym_mp.cli.experiment_runs import Attempt, RunStatus, make_attempts
from lilgym_mp.evaluation.options import CommandError

NAMED_CORPORA = ("builtin", "lilgym", "generated")  # available on every node
RETRIES = 3  # retries per run, if its node or its Ray worker process dies


def run_on_ray(
    attempts: Sequence[Attempt], address: str, threads: int, on_poll: Callable[[], object], poll_seconds: float
) -> None:
    """Executes the unfinished attempts, as many in parallel as the cluster has CPUs for.

    A run's files are sent along when it begins and copied back when it ends; an interrupt loses what the runs in
    progress did on their nodes. Raises CommandError if the cluster cannot be reached, and for a corpus whose path is
    relative.
    """
    for words in [words for attempt in attempts for words in attempt.planned.commands]:
        corpus = words[words.index("--corpus") + 1] if "--corpus" in words else NAMED_CORPORA[0]
        if corpus.split(":")[0] not in NAMED_CORPORA and not Path(corpus).is_absolute():
            raise CommandError(f"corpus: {corpus} is a relative path; --ray needs one that exists on all nodes")
    ray: Any = import_module("ray")
    try:
        ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR)
    except (ConnectionError, RuntimeError, ValueError) as error:
        raise CommandError(f"--ray {address}: cannot connect to a cluster: {_first_line(error)}") from None
    try:
        task = ray.remote(run_on_node).options(num_cpus=threads, max_retries=RETRIES)
        unfinished = [attempt for attempt in attempts if attempt.status is not RunStatus.FINISHED]
        pending = {task.remote(each.planned, _results(each), threads, pack(each)): each for each in unfinished}
        while pending:
            ready, _ = ray.wait(list(pending), timeout=poll_seconds)
            for ref in ready:
                attempt = pending.pop(ref)
                try:
                    status, attempt.error, attempt.seconds, files = ray.get(ref)
                except (ray.exceptions.RayError, OSError) as error:
                    attempt.status, attempt.error = RunStatus.FAILED, _first_line(error)
                    continue
                unpack(files, attempt)
                attempt.status = status
            on_poll()
    finally:
        ray.shutdown()


def _first_line(error: Exception) -> str:
    return str(error).strip().splitlines()[0]


def _results(attempt: Attempt) -> Path:
    """The results directory, relative to the node's working directory."""
    is_inside = not attempt.results.is_absolute() and ".." not in attempt.results.parts
    return attempt.results if is_inside else Path(attempt.results.name)


def run_on_node(planned: PlannedRun, results: Path, threads: int, files: bytes) -> tuple[RunStatus, str, float, bytes]:
    """Executes a run in a temporary directory of the current node; its status, error, seconds, and files by `pack`."""
    with tempfile.TemporaryDirectory(prefix="lilgym-mp-") as directory, chdir(directory):
        (attempt,) = make_attempts([planned], results, threads)
        unpack(files, attempt)
        attempt.load()
        attempt.execute()
        return attempt.status, attempt.error, attempt.seconds, pack(attempt)


def pack(attempt: Attempt) -> bytes:
    """The run's files as a tar archive, with paths relative to the results directory."""
    content = io.BytesIO()
    with tarfile.open(fileobj=content, mode="w") as archive:
        for path in (attempt.run, attempt.episodes, attempt.log, attempt.marker):
            if path.exists():
                archive.add(path, path.relative_to(attempt.results))
    return content.getvalue()


def unpack(files: bytes, attempt: Attempt) -> None:
    """Extracts an archive made by `pack`, overwriting existing files."""
    with tarfile.open(fileobj=io.BytesIO(files)) as archive:
        archive.extractall(attempt.results, filter="data")
