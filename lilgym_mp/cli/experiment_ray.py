"""An experiment's runs as tasks of a Ray cluster: a run whose node dies is made again on another one."""

from __future__ import annotations

import io
import logging
import tarfile
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from lilgym_mp.cli.errors import CommandError
from lilgym_mp.cli.experiment_plan import PlannedRun
from lilgym_mp.cli.experiment_runs import PATIENCE, Attempt, Standing, attempts, mark_finished
from lilgym_mp.extras import install

RETRIES = 3  # of a run, where its node or Ray's process for it dies
TELL_SECONDS = 1.0
CORPORA_EVERYWHERE = ("builtin", "lilgym")  # found by name on each node


@dataclass(frozen=True)
class Told:
    """What a run says of itself while it goes on."""

    node: str
    attempt: int  # from 1; one more after each node that died
    standing: Standing
    share_done: float | None


@dataclass(frozen=True)
class Outcome:
    """What a run left."""

    standing: Standing
    error: str
    seconds: float
    files: bytes  # `packed`


class Keeper:
    """An actor on the driver's node: what runs say of themselves, and whether they shall end."""

    def __init__(self) -> None:
        self._told: dict[str, Told] = {}
        self._begun: dict[str, int] = {}
        self._stopped = False

    def begin(self, name: str) -> int:
        """How many times the run has begun, this one included."""
        self._begun[name] = self._begun.get(name, 0) + 1
        return self._begun[name]

    def tell(self, name: str, told: Told) -> bool:
        """Whether the run shall save and end."""
        self._told[name] = told
        return self._stopped

    def told(self) -> dict[str, Told]:
        return dict(self._told)

    def stop(self) -> None:
        self._stopped = True


def carry_out_on_ray(
    made: Sequence[Attempt], address: str, threads: int, watch: Callable[[], object], every: float
) -> None:
    """Carries out what is not finished, as many runs at a time as the cluster has processors for; as `carry_out` does.

    What each run leaves is brought back when it ends; one that an earlier call left unfinished is sent along.
    Raises CommandError for a cluster that cannot be reached, and for a corpus that nodes would not find.
    """
    _check_corpora(made)
    ray = _connected(address)
    try:
        _carry_out(ray, [a for a in made if a.standing is not Standing.FINISHED], threads, watch, every)
    finally:
        ray.shutdown()


def _connected(address: str) -> Any:
    try:
        ray: Any = import_module("ray")
    except ImportError:
        raise CommandError(f"--ray needs ray: {install('ray')}") from None
    try:
        ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR)
    except (ConnectionError, RuntimeError, ValueError) as error:
        reason = str(error).strip().splitlines()[0]
        raise CommandError(f"--ray {address}: no cluster could be joined there: {reason}") from None
    return ray


def _check_corpora(made: Sequence[Attempt]) -> None:
    for attempt in made:
        for words in attempt.planned.commands:
            corpus = words[words.index("--corpus") + 1] if "--corpus" in words else CORPORA_EVERYWHERE[0]
            if corpus not in CORPORA_EVERYWHERE and not Path(corpus).is_absolute():
                raise CommandError(
                    f"corpus: {corpus} is a path from here; with --ray name a file by a whole path that all nodes have"
                )


def _carry_out(ray: Any, todo: Sequence[Attempt], threads: int, watch: Callable[[], object], every: float) -> None:
    here = ray.util.scheduling_strategies.NodeAffinitySchedulingStrategy(
        ray.get_runtime_context().get_node_id(), soft=False
    )
    keeper = ray.remote(Keeper).options(num_cpus=0, scheduling_strategy=here).remote()
    task = ray.remote(run_on_node).options(num_cpus=threads, max_retries=RETRIES)
    waiting = {task.remote(keeper, a.planned, _named_there(a.named), threads, packed(a)): a for a in todo}

    def attend(timeout: float) -> None:
        ready, _ = ray.wait(list(waiting), timeout=timeout)
        for ended in ready:
            _bring_back(ray, ended, waiting.pop(ended))
        _hear(ray.get(keeper.told.remote()), list(waiting.values()))
        watch()

    try:
        while waiting:
            attend(every)
    except KeyboardInterrupt:
        keeper.stop.remote()
        for ref, attempt in list(waiting.items()):
            if attempt.standing is Standing.WAITING:
                ray.cancel(ref)
                del waiting[ref]
        until = time.monotonic() + PATIENCE
        while waiting and time.monotonic() < until:
            attend(every)
        raise


def _named_there(results: Path) -> Path:
    """The results' name within a node's own directory: the same where it leads nowhere else."""
    return Path(results.name) if results.is_absolute() or ".." in results.parts else results


def _hear(told: dict[str, Told], going: Sequence[Attempt]) -> None:
    for attempt in going:
        if (found := told.get(attempt.planned.name)) is not None:
            attempt.standing, attempt.remote_share = found.standing, found.share_done
            attempt.where = f"on {found.node}" + (f", attempt {found.attempt}" if found.attempt > 1 else "")
            attempt.began = attempt.began or time.monotonic()


def _bring_back(ray: Any, ended: Any, attempt: Attempt) -> None:
    attempt.remote_share, attempt.where = None, ""
    try:
        outcome: Outcome = ray.get(ended)
    except (ray.exceptions.RayError, OSError) as error:
        attempt.standing, attempt.error = Standing.FAILED, str(error).strip().splitlines()[0]
        return
    unpack(outcome.files, attempt)
    attempt.error, attempt.seconds = outcome.error, outcome.seconds
    if outcome.standing is Standing.FINISHED:
        mark_finished(attempt)
    attempt.standing = outcome.standing


def run_on_node(keeper: Any, planned: PlannedRun, named: Path, threads: int, files: bytes) -> Outcome:
    """Carries out a run in a directory of its own on the node that calls it."""
    ray: Any = import_module("ray")
    node = ray.util.get_node_ip_address()
    number = ray.get(keeper.begin.remote(planned.name))
    with tempfile.TemporaryDirectory(prefix="lilgym-mp-") as place:
        (attempt,) = attempts([planned], named, threads, Path(place))
        unpack(files, attempt)
        ended = threading.Event()

        def tell() -> None:
            while not ended.wait(TELL_SECONDS):
                told = Told(node, number, attempt.standing, attempt.share_done)
                if ray.get(keeper.tell.remote(planned.name, told)):
                    attempt.stop()

        telling = threading.Thread(target=tell, daemon=True)
        telling.start()
        attempt.carry_out()
        ended.set()
        telling.join()
        return Outcome(attempt.standing, attempt.error, attempt.seconds, packed(attempt))


def packed(attempt: Attempt) -> bytes:
    """The run's files as a tar archive, by their places in the results."""
    content = io.BytesIO()
    with tarfile.open(fileobj=content, mode="w") as archive:
        for path in attempt.files:
            if path.exists():
                archive.add(path, path.relative_to(attempt.directory))
    return content.getvalue()


def unpack(files: bytes, attempt: Attempt) -> None:
    """Puts the files in the place of those that are there."""
    with tarfile.open(fileobj=io.BytesIO(files)) as archive:
        archive.extractall(attempt.directory, filter="data")
