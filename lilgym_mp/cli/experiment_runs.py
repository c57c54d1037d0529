"""Carrying out an experiment's runs: each a sequence of commands of its own process, with a log, several at a time."""

from __future__ import annotations

import ctypes
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from enum import StrEnum
from itertools import zip_longest
from pathlib import Path

from lilgym_mp.cli.errors import CommandError
from lilgym_mp.cli.experiment_plan import PlannedRun
from lilgym_mp.evaluation.files import writable_directory, write_json

RUNS, EPISODES, LOGS, FINISHED = "runs", "episodes", "logs", "finished"
THREAD_VARIABLES = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
PATIENCE = 30.0  # seconds that interrupted runs have to save


class Standing(StrEnum):
    WAITING = "waiting"
    TRAINING = "training"
    EVALUATING = "evaluating"
    FINISHED = "finished"
    FAILED = "failed"
    INTERRUPTED = "interrupted"


class Attempt:
    """One run on its way."""

    def __init__(self, planned: PlannedRun, named: Path, threads: int, cwd: Path = Path()) -> None:
        """`named`: the results, as commands name them; `cwd`: where these are run."""
        self.planned = planned
        self.named = named
        self.cwd = cwd
        self.directory = cwd / named
        self.run = self.directory / RUNS / planned.name
        self.episodes = self.directory / EPISODES / planned.name
        self.log = self.directory / LOGS / f"{planned.name}.log"
        self.marker = self.directory / FINISHED / f"{planned.name}.json"
        self.threads = threads
        self.standing = Standing.WAITING
        self.where = ""  # the node of a run on a cluster
        self.remote_share: float | None = None  # of its training, as told from there
        self.began: float | None = None
        self.seconds = 0.0
        self.error = ""
        self._process: subprocess.Popen[bytes] | None = None
        self._stopped = threading.Event()

    def done_before(self) -> bool:
        """Whether the run was finished earlier. Raises CommandError when it was made by other commands."""
        if not self.marker.exists():
            return False
        try:
            made = json.loads(self.marker.read_text(encoding="utf-8"))
            commands, seconds = list(made["commands"]), float(made["seconds"])
        except (ValueError, KeyError, TypeError) as error:
            raise CommandError(f"{self.marker}: damaged: {error!r}; delete it to evaluate the run again") from None
        if commands != self.planned.commands:
            pairs = zip_longest(commands, self.planned.commands)
            made_by, wanted = next((made, wanted) for made, wanted in pairs if made != wanted)
            raise CommandError(
                f"{self.marker}: the run {self.planned.name} was made with other options: {made_by}, not {wanted};"
                " choose another directory with --out"
            )
        self.standing, self.seconds = Standing.FINISHED, seconds
        return True

    def carry_out(self) -> None:
        """Trains, goes on training or leaves that out, then evaluates; never raises."""
        self.began = time.monotonic()
        try:
            if self.planned.train:
                self._train()
            self._evaluate()
        except _Failed as error:
            self.error = str(error)
            self.standing = Standing.INTERRUPTED if self._stopped.is_set() else Standing.FAILED
        except OSError as error:
            self.error, self.standing = f"{error.filename}: {error.strerror}", Standing.FAILED
        else:
            self.seconds = round(time.monotonic() - self.began, 1)
            mark_finished(self)
            self.standing = Standing.FINISHED

    def _train(self) -> None:
        self.standing = Standing.TRAINING
        trained = self.run / "trained"  # left once training has ended
        if trained.exists():
            return
        resumed = (self.run / "checkpoint.pt").exists()
        if self.run.exists() and not resumed:
            shutil.rmtree(self.run)
        place = ["--out", str(self.named / RUNS / self.planned.name), "--threads", str(self.threads)]
        self._call([*self.planned.train, *place, *["--resume"] * resumed])
        trained.touch()

    def _evaluate(self) -> None:
        self.standing = Standing.EVALUATING
        run, episodes = (str(self.named / kind / self.planned.name) for kind in (RUNS, EPISODES))
        agent = [run, "--alone", "--threads", str(self.threads)] if self.planned.train else []
        for words in self.planned.evaluate:
            first, *rest = words
            self._call([first, *agent[:1], *rest, *agent[1:], "--record", episodes, "--force"])

    def _call(self, words: Sequence[str]) -> None:
        """Raises _Failed with the last line of the log."""
        if self._stopped.is_set():
            raise _Failed("not begun")
        environment = {**os.environ, **dict.fromkeys(THREAD_VARIABLES, str(self.threads))}
        with self.log.open("ab") as log:
            log.write(f"$ lilgym-mp {' '.join(words)}\n".encode())
            log.flush()
            command = [sys.executable, "-m", "lilgym_mp", *words]
            self._process = subprocess.Popen(
                command,
                cwd=self.cwd,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                env=environment,
                start_new_session=True,
                preexec_fn=_end_with_parent if sys.platform == "linux" else None,
            )
            code = self._process.wait()
        if code:
            lines = self.log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
            how = f"exit code {code}" if code > 0 else f"ended by {signal.Signals(-code).name}"
            raise _Failed(f"{how}: {lines[-1] if lines else ''}")

    def stop(self) -> None:
        """Asks the run's process, once, to save and end: a second time would interrupt that."""
        if self._stopped.is_set():
            return
        self._stopped.set()
        if self._process is not None and self._process.poll() is None:
            self._process.send_signal(signal.SIGTERM)

    @property
    def files(self) -> tuple[Path, ...]:
        """Files and directories that are the run's own."""
        return self.run, self.episodes, self.log

    @property
    def share_done(self) -> float | None:
        """Of the training, by its progress; None where nothing is known."""
        if self.remote_share is not None:
            return self.remote_share
        if self.standing is not Standing.TRAINING or self.planned.budget is None:
            return None
        key, whole = self.planned.budget
        try:
            with (self.run / "progress.jsonl").open("rb") as file:
                file.seek(max(0, file.seek(0, os.SEEK_END) - 4096))
                last = json.loads(file.read().splitlines()[-1])
            return min(1.0, last[key] / whole)
        except (OSError, ValueError, IndexError, KeyError, TypeError):
            return None


class _Failed(Exception):
    """A command that did not succeed."""


def mark_finished(attempt: Attempt) -> None:
    """Lets the run be left out next time."""
    write_json(attempt.marker, {"commands": attempt.planned.commands, "seconds": attempt.seconds})


if sys.platform == "linux":
    _LIBC = ctypes.CDLL(None)
    _SIGNAL_AT_DEATH_OF_PARENT = 1  # PR_SET_PDEATHSIG


def _end_with_parent() -> None:
    """Lets this process save and end when the one that started it is killed, lest two train one run when it goes on."""
    _LIBC.prctl(_SIGNAL_AT_DEATH_OF_PARENT, signal.SIGTERM)


def attempts(plan: Sequence[PlannedRun], named: Path, threads: int, cwd: Path = Path()) -> list[Attempt]:
    """Every run of the plan, those finished before marked so. Raises CommandError, OutputError."""
    for name in (RUNS, EPISODES, LOGS, FINISHED):
        writable_directory(cwd / named / name)
    made = [Attempt(planned, named, threads, cwd) for planned in plan]
    for attempt in made:
        attempt.done_before()
    return made


def carry_out(made: Sequence[Attempt], jobs: int, watch: Callable[[], object], every: float) -> None:
    """Carries out what is not finished, `jobs` at a time; calls `watch` every so many seconds.

    A KeyboardInterrupt is passed on when the runs have saved.
    """
    todo = [attempt for attempt in made if attempt.standing is not Standing.FINISHED]
    with ThreadPoolExecutor(max_workers=jobs) as pool:
        waiting: set[Future[None]] = {pool.submit(attempt.carry_out) for attempt in todo}
        try:
            while waiting:
                _, waiting = wait(waiting, timeout=every, return_when=FIRST_COMPLETED)
                watch()
        except KeyboardInterrupt:
            for attempt in todo:
                attempt.stop()
            wait(waiting, timeout=PATIENCE)
            watch()
            raise
