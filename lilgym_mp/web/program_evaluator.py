"""Programs evaluated in processes of their own, which are ended when a program takes too long or too much memory."""

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

START_SECONDS = 60.0  # for a new process to import what it needs, on a busy machine
WAIT_SECONDS = 20.0  # for a process to be free
MOST_MEMORY = 2 << 30  # bytes of address space


class Evaluation(NamedTuple):
    """What a program says of scenes: a truth each, None where it has no value, and the first reason for that."""

    truths: list[bool | None]
    fault: str | None
    parts: list[TraceEntry]  # of the program in the first scene, where they were asked for


class EvaluationError(Exception):
    """A program that could not be evaluated at all; the text says why."""


class EvaluatorBusy(Exception):
    """No process was free in time."""


def evaluate(source: str, scenes: Sequence[Scene], *, traced: bool) -> Evaluation:
    """Evaluates in this process. Raises ProgramError for what is no program."""
    program = compile_program(source)
    truths: list[bool | None] = []
    first_fault: str | None = None
    for scene in scenes:
        try:
            truths.append(program.evaluate(scene))
        except ProgramRuntimeError as fault:
            truths.append(None)
            first_fault = first_fault or str(fault)
    return Evaluation(truths, first_fault, trace(source, scenes[0]) if traced and scenes else [])


def _work(connection: Connection) -> None:
    """Answers what comes through the connection until it is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the server, which then closes the connection
    _limit_memory()
    connection.send("ready")
    while True:
        try:
            source, scenes, traced = connection.recv()
        except (EOFError, OSError):
            return
        answer: Any
        try:
            answer = evaluate(source, scenes, traced=traced)
        except ProgramError as fault:
            answer = str(fault)
        except (MemoryError, RecursionError):
            answer = "the program needs too much memory"
        connection.send(answer)


def _limit_memory() -> None:
    if sys.platform != "win32":
        import resource

        with suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))


class _Worker:
    """One process, started when it is first needed."""

    def __init__(self) -> None:
        self._process: Any = None
        self._connection: Connection | None = None

    def ask(self, source: str, scenes: Sequence[Scene], seconds: float, *, traced: bool) -> Evaluation | str:
        try:
            connection = self._connection or self._start()
            connection.send((source, list(scenes), traced))
            if connection.poll(seconds):
                return connection.recv()
        except (EOFError, OSError):
            self.end()
            raise EvaluationError("the process that evaluated the program ended; try again") from None
        self.end()
        raise EvaluationError(f"the program took longer than {seconds:g} seconds")

    def _start(self) -> Connection:
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=_work, args=(theirs,), daemon=True, name="lilgym-mp programs")
        process.start()
        theirs.close()
        self._process, self._connection = process, ours
        if not ours.poll(START_SECONDS):
            raise EOFError
        ours.recv()
        return ours

    def end(self) -> None:
        if self._connection is not None:
            self._connection.close()
        if self._process is not None:
            self._process.kill()
            self._process.join(5)
        self._process = self._connection = None


class Evaluator:
    """Some processes that evaluate programs, for any number of threads."""

    def __init__(self, processes: int, seconds: float) -> None:
        self._seconds = seconds
        self._workers = [_Worker() for _ in range(processes)]
        self._free: queue.LifoQueue[_Worker] = queue.LifoQueue()
        for worker in self._workers:
            self._free.put(worker)
        self._closing = threading.Lock()

    def evaluate(self, source: str, scenes: Sequence[Scene], *, traced: bool = False) -> Evaluation:
        """What the program says of the scenes.

        Raises EvaluationError for what is no program and for one that takes too long, EvaluatorBusy.
        """
        try:
            worker = self._free.get(timeout=WAIT_SECONDS)
        except queue.Empty:
            raise EvaluatorBusy from None
        try:
            answer = worker.ask(source, scenes, self._seconds, traced=traced)
        finally:
            self._free.put(worker)
        if isinstance(answer, str):
            raise EvaluationError(answer)
        return answer

    def close(self) -> None:
        with self._closing:
            for worker in self._workers:
                worker.end()
