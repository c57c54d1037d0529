"""Executes an experiment's runs as tasks of a Ray cluster: a run whose node dies is retried on another."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from contextlib import chdir
from importlib import import_module
from pathlib import Path
from typing import Any

from lilgym_mp.cli.experiment_plan import PlannedRun
from lilgym_mp.cli.experiment_runs import Attempt, RunStatus
from lilgym_mp.evaluation.options import CommandError

RETRIES = 3  # retries per run, if its node or its Ray worker process dies


def run_on_ray(
    attempts: Sequence[Attempt], address: str, threads: int, on_poll: Callable[[], object], poll_seconds: float
) -> None:
    """Executes the unfinished attempts, as many in parallel as the cluster has CPUs for.

    All nodes must share the current directory, in which they write the results; a retried or resumed run goes on from
    its last checkpoint. Raises CommandError if the cluster cannot be reached.
    """
    ray: Any = import_module("ray")
    try:
        ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR)
    except (ConnectionError, RuntimeError, ValueError) as error:
        raise CommandError(f"--ray {address}: cannot connect to a cluster: {_first_line(error)}") from None
    try:
        task = ray.remote(run_on_node).options(num_cpus=threads, max_retries=RETRIES)
        unfinished = [attempt for attempt in attempts if attempt.status is not RunStatus.FINISHED]
        pending = {task.remote(Path.cwd(), each.planned, each.results, threads): each for each in unfinished}
        while pending:
            ready, _ = ray.wait(list(pending), timeout=poll_seconds)
            for ref in ready:
                attempt = pending.pop(ref)
                try:
                    attempt.status, attempt.error = ray.get(ref)
                except (ray.exceptions.RayError, OSError) as error:
                    attempt.status, attempt.error = RunStatus.FAILED, _first_line(error)
            on_poll()
    finally:
        ray.shutdown()


def _first_line(error: Exception) -> str:
    return str(error).strip().splitlines()[0]


def run_on_node(directory: Path, planned: PlannedRun, results: Path, threads: int) -> tuple[RunStatus, str]:
    """Executes a run in the shared directory; its status and error."""
    with chdir(directory):
        attempt = Attempt(planned, results, threads)
        attempt.load()
        attempt.execute()
        return attempt.status, attempt.error
