"""Executes an experiment's runs as tasks of a Ray cluster: a run whose node dies is retried on another."""

from __future__ import annotations

import io
import logging
import tarfile
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from lilgym_mp.cli.experiment_plan import PlannedRun
from lilgym_mp.cli.experiment_runs import SHUTDOWN_SECONDS, Attempt, RunStatus, make_attempts, mark_finished
from lilgym_mp.corpus.extras import install
from lilgym_mp.evaluation.options import CommandError

RETRIES = 3  # retries per run, if its node or its Ray worker process dies
REPORT_SECONDS = 1.0
NAMED_CORPORA = ("builtin", "lilgym")  # corpora available by name on every node


Report = tuple[RunStatus, float | None, str]  # status, fraction done and node of a run


class ProgressActor:
    """Ray actor on the driver's node: collects the runs' progress and stops them on request."""

    def __init__(self) -> None:
        self._reports: dict[str, Report] = {}
        self._stopped = False

    def report(self, name: str, report: Report) -> bool:
        """Stores the report; returns whether the run must save and stop."""
        self._reports[name] = report
        return self._stopped

    def reports(self) -> dict[str, Report]:
        return self._reports

    def stop(self) -> None:
        self._stopped = True


def run_on_ray(
    attempts: Sequence[Attempt], address: str, threads: int, on_poll: Callable[[], object], poll_seconds: float
) -> None:
    """Executes the unfinished attempts, as many in parallel as the cluster has CPUs for; otherwise as `run_locally`.

    A run's files are copied back when it ends; those of a run left unfinished by an earlier call are sent along.
    Raises CommandError if the cluster cannot be reached, and for a corpus that is not available on every node.
    """
    _check_corpora(attempts)
    ray = _connect(address)
    try:
        unfinished = [attempt for attempt in attempts if attempt.status is not RunStatus.FINISHED]
        _execute(ray, unfinished, threads, on_poll, poll_seconds)
    finally:
        ray.shutdown()


def _connect(address: str) -> Any:
    try:
        ray: Any = import_module("ray")
    except ImportError:
        raise CommandError(f"--ray needs ray: {install('ray')}") from None
    try:
        ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR)
    except (ConnectionError, RuntimeError, ValueError) as error:
        reason = str(error).strip().splitlines()[0]
        raise CommandError(f"--ray {address}: cannot connect to a cluster: {reason}") from None
    return ray


def _check_corpora(attempts: Sequence[Attempt]) -> None:
    for words in [words for attempt in attempts for words in attempt.planned.commands]:
        corpus = words[words.index("--corpus") + 1] if "--corpus" in words else NAMED_CORPORA[0]
        if corpus not in NAMED_CORPORA and not Path(corpus).is_absolute():
            rule = "--ray needs an absolute path that exists on all nodes"
            raise CommandError(f"corpus: {corpus} is a relative path; {rule}")


def _execute(
    ray: Any, attempts: Sequence[Attempt], threads: int, on_poll: Callable[[], object], poll_seconds: float
) -> None:
    this_node = ray.util.scheduling_strategies.NodeAffinitySchedulingStrategy(
        ray.get_runtime_context().get_node_id(), soft=False
    )
    progress_actor = ray.remote(ProgressActor).options(num_cpus=0, scheduling_strategy=this_node).remote()
    task = ray.remote(run_on_node).options(num_cpus=threads, max_retries=RETRIES)
    pending: dict[Any, Attempt] = {}
    for attempt in attempts:
        is_inside = not attempt.results.is_absolute() and ".." not in attempt.results.parts
        results = attempt.results if is_inside else Path(attempt.results.name)  # in the node's working directory
        pending[task.remote(progress_actor, attempt.planned, results, threads, pack(attempt))] = attempt

    def poll() -> None:
        ready, _ = ray.wait(list(pending), timeout=poll_seconds)
        for ref in ready:
            _collect_result(ray, ref, pending.pop(ref))
        reports = ray.get(progress_actor.reports.remote())
        for attempt in pending.values():
            if attempt.planned.name in reports:
                attempt.status, attempt.remote_fraction_done, attempt.location = reports[attempt.planned.name]
        on_poll()

    try:
        while pending:
            poll()
    except KeyboardInterrupt:
        progress_actor.stop.remote()
        for ref, attempt in list(pending.items()):
            if attempt.status is RunStatus.WAITING:
                ray.cancel(ref)
                del pending[ref]
        deadline = time.monotonic() + SHUTDOWN_SECONDS
        while pending and time.monotonic() < deadline:
            poll()
        raise


def _collect_result(ray: Any, ref: Any, attempt: Attempt) -> None:
    attempt.remote_fraction_done, attempt.location = None, ""
    try:
        status, attempt.error, attempt.seconds, files = ray.get(ref)
    except (ray.exceptions.RayError, OSError) as error:
        attempt.status, attempt.error = RunStatus.FAILED, str(error).strip().splitlines()[0]
        return
    unpack(files, attempt)
    if status is RunStatus.FINISHED:
        mark_finished(attempt)
    attempt.status = status


def run_on_node(
    progress_actor: Any, planned: PlannedRun, results: Path, threads: int, files: bytes
) -> tuple[RunStatus, str, float, bytes]:
    """Executes a run in a temporary directory of the current node; its status, error, seconds, and files by `pack`."""
    ray: Any = import_module("ray")
    location = f"on {ray.util.get_node_ip_address()}"
    with tempfile.TemporaryDirectory(prefix="lilgym-mp-") as directory:
        (attempt,) = make_attempts([planned], results, threads, Path(directory))
        unpack(files, attempt)
        ended = threading.Event()

        def report_progress() -> None:
            while not ended.wait(REPORT_SECONDS):
                report = attempt.status, attempt.fraction_done, location
                if ray.get(progress_actor.report.remote(planned.name, report)):
                    attempt.stop()

        reporter = threading.Thread(target=report_progress, daemon=True)
        reporter.start()
        attempt.execute()
        ended.set()
        reporter.join()
        return attempt.status, attempt.error, attempt.seconds, pack(attempt)


def pack(attempt: Attempt) -> bytes:
    """The run's files as a tar archive, with paths relative to the results directory."""
    content = io.BytesIO()
    with tarfile.open(fileobj=content, mode="w") as archive:
        for path in attempt.files:
            if path.exists():
                archive.add(path, path.relative_to(attempt.directory))
    return content.getvalue()


def unpack(files: bytes, attempt: Attempt) -> None:
    """Extracts an archive made by `pack`, overwriting existing files."""
    with tarfile.open(fileobj=io.BytesIO(files)) as archive:
        archive.extractall(attempt.directory, filter="data")
