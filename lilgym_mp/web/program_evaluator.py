"""Evaluates untrusted programs in worker processes with a time and a memory limit."""

from __future__ import annotations

import multiprocessing
import queue
import signal
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

from lilgym_mp.programs import ProgramError, ProgramRuntimeError, compile_program
from lilgym_mp.programs.tracing import TraceEntry, trace
from lilgym_mp.scene import Scene

START_SECONDS = 60.0  # timeout for a new worker's imports on a busy machine
WAIT_SECONDS = 20.0  # timeout for a free worker
MAX_MEMORY = 2 << 30  # bytes of address space


class ProgramEvaluation(NamedTuple):
    """Truth values of a program on a list of scenes."""

    truths: list[bool | None]  # None: evaluating the program on this scene failed
    fault: str | None  # first error message
    parts: list[TraceEntry]  # trace of the program on the first scene; empty unless requested


class ProgramEvaluationError(Exception):
    """A program that cannot be evaluated: a syntax error, a timeout or a crash."""


class EvaluatorBusy(Exception):
    """No worker became free in time."""


def evaluate(source: str, scenes: Sequence[Scene], *, traced: bool) -> ProgramEvaluation:
    """Evaluates in this process. Raises ProgramError if the source is not a valid program."""
    program = compile_program(source)
    truths: list[bool | None] = []
    first_fault: str | None = None
    for scene in scenes:
        try:
            truths.append(program.evaluate(scene))
        except ProgramRuntimeError as fault:
            truths.append(None)
            first_fault = first_fault or str(fault)
    return ProgramEvaluation(truths, first_fault, trace(source, scenes[0]) if traced and scenes else [])


def _worker_main(connection: Connection) -> None:
    """Serves evaluation requests until the connection is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # on Ctrl-C the server closes the connection
    _limit_memory()
    connection.send("ready")
    while True:
        try:
            source, scenes, traced = connection.recv()
        except (EOFError, OSError):
            return
        reply: ProgramEvaluation | str
        try:
            reply = evaluate(source, scenes, traced=traced)
        except ProgramError as fault:
            reply = str(fault)
        except (MemoryError, RecursionError):
            reply = "the program needs too much memory"
        connection.send(reply)


def _limit_memory() -> None:
    if sys.platform != "win32":
        import resource

        with suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY, MAX_MEMORY))


class _Worker:
    """A worker process, started on first use."""

    def __init__(self) -> None:
        self._process: Any = None
        self._connection: Connection | None = None

    def evaluate(
        self, source: str, scenes: Sequence[Scene], seconds: float, *, traced: bool
    ) -> ProgramEvaluation | str:
        """The evaluation, or an error message. Raises ProgramEvaluationError if the process is killed or crashes."""
        try:
            connection = self._connection or self._start()
            connection.send((source, list(scenes), traced))
            if connection.poll(seconds):
                return connection.recv()
        except (EOFError, OSError):
            self.kill()
            raise ProgramEvaluationError("the process evaluating the program crashed; try again") from None
        self.kill()
        raise ProgramEvaluationError(f"the program took longer than {seconds:g} seconds")

    def _start(self) -> Connection:
        context = multiprocessing.get_context("spawn")
        parent_end, child_end = context.Pipe()
        process = context.Process(target=_worker_main, args=(child_end,), daemon=True, name="lilgym-mp programs")
        process.start()
        child_end.close()
        self._process, self._connection = process, parent_end
        if not parent_end.poll(START_SECONDS):
            raise EOFError
        parent_end.recv()  # "ready"
        return parent_end

    def kill(self) -> None:
        if self._connection is not None:
            self._connection.close()
        if self._process is not None:
            self._process.kill()
            self._process.join(5)
        self._process = self._connection = None


class ProgramEvaluator:
    """Thread-safe pool of worker processes that evaluate programs."""

    def __init__(self, processes: int, seconds: float) -> None:
        self._seconds = seconds
        self._workers = [_Worker() for _ in range(processes)]
        self._free: queue.LifoQueue[_Worker] = queue.LifoQueue()
        for worker in self._workers:
            self._free.put(worker)
        self._closing = threading.Lock()

    def evaluate(self, source: str, scenes: Sequence[Scene], *, traced: bool = False) -> ProgramEvaluation:
        """Evaluates the program on the scenes; `traced` adds the value of each part on the first scene.

        Raises ProgramEvaluationError for an invalid program or one that exceeds a limit, EvaluatorBusy.
        """
        try:
            worker = self._free.get(timeout=WAIT_SECONDS)
        except queue.Empty:
            raise EvaluatorBusy from None
        try:
            reply = worker.evaluate(source, scenes, self._seconds, traced=traced)
        finally:
            self._free.put(worker)
        if isinstance(reply, str):
            raise ProgramEvaluationError(reply)
        return reply

    def close(self) -> None:
        with self._closing:
            for worker in self._workers:
                worker.kill()
