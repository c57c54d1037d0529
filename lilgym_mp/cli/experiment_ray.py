"""Executes an experiment's runs on a Ray cluster: a task for each, which is `lilgym-mp experiment FILE --only RUN`."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from lilgym_mp.cli.options import CommandError
from lilgym_mp.corpus.extras import install

os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # no usage reports to Ray's developers
os.environ.setdefault("RAY_worker_niceness", "0")  # by default 15, with which runs starve on a busy machine


def execute_on_ray(
    address: str, names: Sequence[str], file: Path, results: Path, threads: int, more: Sequence[str]
) -> Iterator[tuple[str, str]]:
    """Executes the runs; yields the name of each as it ends, and what went wrong, "" if nothing did.

    A task whose node is lost starts again on another one and resumes its run, for which the nodes share a file system.

    Args:
        address: Of a running cluster, such as "auto"; "" starts Ray on this machine.
        names: The runs.
        file: The experiment.
        results: The results directory.
        threads: CPUs of each task.
        more: Further options of the command.

    Raises:
        CommandError: If Ray is not installed, or cannot be reached.
    """
    try:
        import ray  # pyright: ignore[reportMissingImports]
    except ModuleNotFoundError:
        raise CommandError(f"--ray needs Ray: {install('ray')}") from None
    try:
        ray.init(address=address or None, log_to_driver=False)
    except Exception as error:  # for a node that starts too slowly, a plain Exception
        raise CommandError(f"--ray {address or 'on this machine'}: {error}") from None
    task = ray.remote(num_cpus=threads, max_retries=3)(_run)
    place = ["experiment", str(file.absolute()), "--out", str(results.absolute()), *more]
    pending: Mapping[Any, str] = {task.remote([*place, "--only", name], threads): name for name in names}
    try:
        while pending:
            (ended, *_), _ = ray.wait(list(pending))
            try:
                code = ray.get(ended)
                error = f"exit code {code}" if code else ""
            except Exception as fault:  # of the task, or of the cluster
                error = f"{type(fault).__name__}: {fault}"
            yield pending[ended], error
            pending = {one: name for one, name in pending.items() if one != ended}
    finally:
        ray.shutdown()


def _run(words: list[str], threads: int) -> int:
    """Executes the command in a process of Ray, whose end also ends the run's, which then saves."""
    from lilgym_mp.cli import main
    from lilgym_mp.envs.machine import usable_cores

    return main([*words, "--jobs", str(max(1, usable_cores() // threads))])
