"""Evaluates untrusted programs in worker processes with a time and a memory limit."""

from __future__ import annotations

import asyncio
import multiprocessing
import os
import queue
import signal
import sys
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

from lilgym_mp.programs import ProgramError, ProgramRuntimeError, compile_program
from lilgym_mp.programs.tracing import TraceEntry, trace
from lilgym_mp.scene import Scene

START_SECONDS = 60.0  # timeout for a new worker's imports on a busy machine
WAIT_SECONDS = 20.0  # timeout for a free worker, beyond the start and the limit of the one that evaluates
NICENESS = 10  # workers leave the processor to the server, which answers everybody else
MAX_MEMORY = 2 << 30  # bytes of address space


class SceneValue(NamedTuple):
    """A program's value on a scene."""

    truth: bool | None  # None: evaluating the program failed
    fault: str | None  # why
    parts: list[TraceEntry]  # empty unless requested


class ProgramEvaluationError(Exception):
    """A program that cannot be evaluated: a syntax error, a timeout or a crash."""


class EvaluatorBusy(Exception):
    """No worker became free in time."""


def evaluate(source: str, scenes: Sequence[Scene], *, traced: bool) -> list[SceneValue]:
    """Evaluates in this process. Raises ProgramError if the source is not a valid program."""
    program = compile_program(source)
    values: list[SceneValue] = []
    for scene in scenes:
        truth, fault = None, None
        try:
            truth = program.evaluate(scene)
        except ProgramRuntimeError as error:
            fault = str(error)
        values.append(SceneValue(truth, fault, trace(source, scene) if traced else []))
    return values


def _worker_main(connection: Connection) -> None:
    """Serves evaluation requests until the connection is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # on Ctrl-C the server closes the connection
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _limit_resources()
    connection.send("ready")
    while True:
        try:
            source, scenes, traced = connection.recv()
        except (EOFError, OSError):
            return
        reply: list[SceneValue] | str
        try:
            reply = evaluate(source, scenes, traced=traced)
        except ProgramError as fault:
            reply = str(fault)
        except (MemoryError, RecursionError):
            reply = "the program needs too much memory"
        connection.send(reply)


def _end_with_parent() -> None:
    """Also in the middle of a program."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _limit_resources() -> None:
    if sys.platform != "win32":
        import resource

        with suppress(ValueError, OSError):
            os.nice(NICENESS)
            resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY, MAX_MEMORY))


class _Worker:
    """A worker process, started on first use."""

    def __init__(self) -> None:
        self._process: Any = None
        self._connection: Connection | None = None

    def evaluate(self, source: str, scenes: Sequence[Scene], seconds: float, *, traced: bool) -> list[SceneValue] | str:
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
        process, connection, self._process, self._connection = self._process, self._connection, None, None
        if connection is not None:
            connection.close()
        if process is not None:
            process.kill()
            process.join(5)


class ProgramEvaluator:
    """Evaluates programs in worker processes, in order of arrival.

    Waiting occupies no thread of the pool that serves pages.
    """

    def __init__(self, processes: int, seconds: float) -> None:
        self._seconds = seconds
        self._workers = [_Worker() for _ in range(processes)]
        self._free: queue.LifoQueue[_Worker] = queue.LifoQueue()
        for worker in self._workers:
            self._free.put(worker)
        self._threads = ThreadPoolExecutor(processes, "lilgym-mp programs")

    async def evaluate(self, source: str, scenes: Sequence[Scene], *, traced: bool = False) -> list[SceneValue]:
        """Evaluates the program on each scene; `traced` adds the value of each part.

        Raises ProgramEvaluationError for an invalid program or one that exceeds a limit, EvaluatorBusy.
        """
        try:
            async with asyncio.timeout(WAIT_SECONDS + START_SECONDS + self._seconds):
                loop = asyncio.get_running_loop()
                reply = await loop.run_in_executor(self._threads, self._evaluate, source, scenes, traced)
        except TimeoutError:
            raise EvaluatorBusy from None
        if isinstance(reply, str):
            raise ProgramEvaluationError(reply)
        return reply

    def _evaluate(self, source: str, scenes: Sequence[Scene], traced: bool) -> list[SceneValue] | str:
        worker = self._free.get()  # there are as many workers as threads
        try:
            return worker.evaluate(source, scenes, self._seconds, traced=traced)
        except ProgramEvaluationError as fault:
            return str(fault)
        finally:
            self._free.put(worker)

    def close(self) -> None:
        for worker in self._workers:
            worker.kill()
        self._threads.shutdown(cancel_futures=True)
