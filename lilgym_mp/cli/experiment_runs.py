"""Executes an experiment's runs in parallel: each is a sequence of commands in subprocesses, with a log."""

from __future__ import annotations

import ctypes
import os
import shlex
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from enum import StrEnum
from pathlib import Path

from lilgym_mp.cli.experiment_plan import OUT, PlannedRun
from lilgym_mp.cli.options import CommandError
from lilgym_mp.evaluation.files import read_json, read_lines, writable_directory, write_json
from lilgym_mp.learning.common.run_directory import CHECKPOINT_FILE, PROGRESS_FILE, RUN_FILE

RUNS = "runs"
EPISODES = "episodes"
LOGS = "logs"
FINISHED = "finished"
THREAD_VARIABLES = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
HUGE_PAGES = {"GLIBC_TUNABLES": "glibc.malloc.hugetlb=1"}  # 12 % more PPO steps a second on Scatter


class RunStatus(StrEnum):
    """State of one run of an experiment, as the table of its progress shows it."""

    WAITING = "waiting"
    TRAINING = "training"
    EVALUATING = "evaluating"
    FINISHED = "finished"
    FAILED = "failed"
    INTERRUPTED = "interrupted"


class Attempt:
    """An execution of a planned run, which remembers the commands that are done in `FINISHED/NAME.json`."""

    def __init__(self, planned: PlannedRun, results: Path, threads: int) -> None:
        self.planned = planned
        self.results = results
        self.run = results / RUNS / planned.name
        self.episodes = results / EPISODES / planned.name
        self.log = results / LOGS / f"{planned.name}.log"
        self.marker = results / FINISHED / f"{planned.name}.json"
        self.threads = threads
        self.status = RunStatus.WAITING
        self.done: list[list[str]] = []
        self.error = ""
        self._process: subprocess.Popen[bytes] | None = None
        self._stopped = threading.Event()
        self._load()

    def _load(self) -> None:
        """Loads what was done earlier. Raises CommandError if the run was trained with other options."""
        if not self.marker.exists():
            return
        try:
            saved = read_json(self.marker)
            self.done = list(saved["commands"])
            trained, *_ = self.done
        except (ValueError, KeyError, TypeError) as error:
            raise CommandError(f"{self.marker}: damaged: {error!r}; delete it to execute the run again") from None
        if self.planned.train and trained != list(self.planned.train):
            raise CommandError(
                f"{self.marker}: the run {self.planned.name} was made with other options: {trained}, not"
                f" {list(self.planned.train)}; choose another directory with --out"
            )
        if all(words in self.done for words in self.planned.commands):
            self.status = RunStatus.FINISHED

    def execute(self) -> None:
        """Trains or resumes training, then evaluates, unless it is done. Failures are stored, never raised."""
        try:
            for words in self.planned.commands:
                if words not in self.done:
                    self._train(words) if words[0] == "train" else self._evaluate(words)
                    self.done.append(words)
                    write_json(self.marker, {"commands": self.done})
        except _Failed as error:
            self.error = str(error)
            self.status = RunStatus.INTERRUPTED if self._stopped.is_set() else RunStatus.FAILED
        except OSError as error:
            self.error = f"{error.filename}: {error.strerror}"
            self.status = RunStatus.FAILED
        else:
            self.status = RunStatus.FINISHED

    def _train(self, words: Sequence[str]) -> None:
        self.status = RunStatus.TRAINING
        resumed = (self.run / CHECKPOINT_FILE).exists()
        with suppress(OSError, ValueError, KeyError, TypeError):  # training may have ended when this process was dead
            run = read_json(self.run / RUN_FILE)
            key, amount = self.planned.budget or ("", 0)
            if run["finished"] and (self.fraction_done == 1 or run["options"][key] == amount):
                return
        if self.run.exists() and not resumed:
            shutil.rmtree(self.run)
        options = ["--out", str(self.results / RUNS / self.planned.name), "--threads", str(self.threads)]
        self._call([*words, *options, *(["--resume"] if resumed else [])])

    def _evaluate(self, words: Sequence[str]) -> None:
        self.status = RunStatus.EVALUATING
        run, episodes = (str(self.results / parent / self.planned.name) for parent in (RUNS, EPISODES))
        agent = [run, "--alone", "--threads", str(self.threads)] if self.planned.train else []
        place = ["--record", episodes] if self.planned.records else ["--out", f"{episodes}-{words[-1]}.json"]
        self._call([words[0], *agent[:1], *words[1:], *agent[1:], *place, "--force"])

    def _call(self, words: Sequence[str]) -> None:
        """Runs `lilgym-mp` with these arguments. Raises _Failed with the last line of the log."""
        if self._stopped.is_set():
            raise _Failed("not started")
        words = [word.replace(OUT, str(self.results)) for word in words]
        environment = {**HUGE_PAGES, **os.environ, **dict.fromkeys(THREAD_VARIABLES, str(self.threads))}
        with self.log.open("ab") as log:
            log.write(f"$ lilgym-mp {shlex.join(words)}\n".encode())
            log.flush()
            command = [sys.executable, "-m", "lilgym_mp", *words]
            self._process = subprocess.Popen(
                command,
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
            reason = f"exit code {code}" if code > 0 else f"killed by {signal.Signals(-code).name}"
            raise _Failed(f"{reason}: {lines[-1] if lines else ''}")

    def stop(self) -> None:
        """Asks the run's process to save and exit; only once, as a second signal would interrupt the saving."""
        if self._stopped.is_set():
            return
        self._stopped.set()
        if self._process is not None and self._process.poll() is None:
            self._process.send_signal(signal.SIGTERM)

    @property
    def fraction_done(self) -> float | None:
        """Fraction of the training budget used, None if unknown."""
        if self.status is not RunStatus.TRAINING or self.planned.budget is None:
            return None
        key, budget = self.planned.budget
        with suppress(OSError, ValueError, IndexError, KeyError, TypeError):
            return min(1.0, read_lines(self.run / PROGRESS_FILE)[-1][key] / budget)
        return None


class _Failed(Exception):
    """A command failed."""


if sys.platform == "linux":
    _LIBC = ctypes.CDLL(None)
    _PR_SET_PDEATHSIG = 1


def _end_with_parent() -> None:
    """Makes this process save and exit when its parent is killed, so that a resumed run is not trained twice."""
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def make_attempts(plan: Sequence[PlannedRun], results: Path, threads: int) -> list[Attempt]:
    """An attempt for each run of the plan, its status FINISHED if it was before.

    Raises CommandError, OutputError.
    """
    attempts = [Attempt(planned, results, threads) for planned in plan]
    for name in (RUNS, EPISODES, LOGS, FINISHED):
        writable_directory(results / name)
    return attempts


def execute(attempts: Sequence[Attempt], jobs: int, on_poll: Callable[[], object], poll_seconds: float) -> None:
    """Executes the unfinished attempts, `jobs` in parallel; calls `on_poll` at least every `poll_seconds`.

    On KeyboardInterrupt, the runs save before it is raised again.
    """
    unfinished = [attempt for attempt in attempts if attempt.status is not RunStatus.FINISHED]
    with ThreadPoolExecutor(max_workers=jobs) as pool:
        pending: set[Future[None]] = {pool.submit(attempt.execute) for attempt in unfinished}
        try:
            while pending:
                _, pending = wait(pending, timeout=poll_seconds, return_when=FIRST_COMPLETED)
                on_poll()
        except KeyboardInterrupt:
            for attempt in unfinished:
                attempt.stop()
            wait(pending)
            on_poll()
            raise
