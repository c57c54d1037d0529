"""Environments in several processes that share one block of memory.

The calling process steps the first slice of the batch itself, each worker process another slice. A worker reads a call
of its `Engine` from a pipe, makes it, and answers through the pipe; actions, images and results are in shared memory.
A worker exits when the other end of its pipe is closed, as when its caller exits.
"""

from __future__ import annotations

import os
import pickle
import select
import signal
import threading
import traceback
import warnings
import weakref
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from time import perf_counter
from typing import Any

import gymnasium as gym
import numpy as np

from lilgym_mp.envs import processes
from lilgym_mp.envs.batched import LilGymVectorEnv, T, batch_spec
from lilgym_mp.envs.buffers import ArraySpec, Buffers, arrays_in
from lilgym_mp.envs.cores import FEWEST_COMPILED
from lilgym_mp.envs.engine import BatchSettings, Engine, ResetRequest
from lilgym_mp.envs.shared_memory import SharedMemory
from lilgym_mp.scene.arrays import UInt8Array
from lilgym_mp.scene.render import image_shape

SPIN_SECONDS = 200e-6
PAGES = 3  # copies of the images in shared memory that the caller can hold at a time; beyond that it copies them itself
START_SECONDS = 120.0  # time limit for a worker's imports and tasks
JOIN_SECONDS = 1.0
LONGEST_WAIT = 1e6  # seconds; the longest wait that the system accepts
COPYING = (Engine.step, Engine.reset)  # methods after which the images are copied to a page

# Held while workers are started and by any fork: no process is forked while another thread imports something here.
_starting = threading.RLock()
_ends: weakref.WeakSet[Connection] = weakref.WeakSet()  # this process's ends of workers' pipes


def _after_fork() -> None:
    """Closes the ends in the child: a worker sees that its caller is gone when nobody else holds the other end."""
    for end in list(_ends):
        end.close()
    _starting.release()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_starting.acquire, after_in_parent=_starting.release, after_in_child=_after_fork)


class WorkerError(RuntimeError):
    """A worker could not be started, died, hung or raised. Names it, with exit code or traceback; the environment has
    been closed."""


class Channel:
    """Two pipes, from and to another process. Receiving polls for a short time before it sleeps: waking a process can
    take as long as a step."""

    def __init__(self, reader: Connection, writer: Connection, spin_seconds: float) -> None:
        self._pipes = (reader, writer)
        self._spin_seconds = spin_seconds
        self._poll = select.poll()
        self._poll.register(reader, select.POLLIN)
        self._file = os.fdopen(reader.fileno(), "rb", closefd=False)

    def send(self, message: object) -> None:
        """Pickles a message and writes all of it; waits while the pipe is full."""
        # 5 us for a small message with `receive`; 9 us by send and recv of Connection, 17 us by those of a socket pair.
        _, writer = self._pipes
        data = pickle.dumps(message)
        while data:
            data = data[os.write(writer.fileno(), data) :]

    def receive(self, seconds: float | None = None) -> Any:
        """The next message. Raises TimeoutError; EOFError, OSError or UnpicklingError if the other process is gone."""
        milliseconds = None if seconds is None else 1000 * min(seconds, LONGEST_WAIT)
        end = perf_counter() + self._spin_seconds
        ready = self._poll.poll(0)
        while not ready and perf_counter() < end:
            ready = self._poll.poll(0)
        if not ready and not self._poll.poll(milliseconds):
            raise TimeoutError
        return pickle.load(self._file)

    def close(self) -> None:
        """Closes all ends of the pipes that this process has."""
        for pipe in self._pipes:
            pipe.close()


@dataclass(frozen=True)
class Slice:
    """What a process needs to step its slice of a batch. Picklable."""

    settings: BatchSettings
    shared: SharedMemory
    spin_seconds: float
    pages: int
    name: str
    part: slice  # of the batch

    def memory(self) -> tuple[Buffers, UInt8Array]:
        """The batch's buffers and pages, copies of the images (pages, N, height, width, 3)."""
        arrays = arrays_in(self.shared.memory, _array_specs(self.settings, self.pages))
        pages = arrays.pop("pages")
        return Buffers(**arrays), pages

    def engine(self) -> Engine:
        """The engine of the worker's environments, on its part of the shared buffers."""
        buffers, _ = self.memory()
        return Engine(self.settings, buffers.slice(self.part.start, self.part.stop), self.part.start)


def _array_specs(settings: BatchSettings, pages: int) -> dict[str, ArraySpec]:
    images = ArraySpec((pages, settings.num_envs, *image_shape(settings.image_size)), np.uint8)
    return {**settings.array_specs(), "pages": images}


def _worker_main(own: Slice, reader: Connection, writer: Connection) -> None:
    """Main loop of a worker: makes calls until the caller closes the pipe or is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the caller handles Ctrl-C
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # instead of a handler of the caller's, inherited by a fork
    channel = Channel(reader, writer, own.spin_seconds)
    try:
        engine = own.engine()
        _, pages = own.memory()
        result = None
        while True:
            channel.send(result)
            method, arguments, page = channel.receive()
            result = getattr(engine, method)(*arguments)
            if page is not None:
                pages[page, own.part] = engine.buffers.image
    except (BrokenPipeError, ConnectionResetError, EOFError):
        return  # the caller is gone
    except Exception:
        with suppress(OSError):  # the caller is gone
            channel.send(f"{own.name} raised:\n{traceback.format_exc()}")


@dataclass(frozen=True, eq=False)
class _Worker:
    """The caller's handle of a worker."""

    own: Slice
    process: BaseProcess
    channel: Channel

    def receive(self, seconds: float) -> Any:
        """The worker's next answer. Raises WorkerError if it fails."""
        try:
            answer = self.channel.receive(seconds)
        except TimeoutError:
            raise WorkerError(f"{self.own.name} has not responded for {seconds:g} seconds") from None
        except (EOFError, OSError, pickle.UnpicklingError):
            raise WorkerError(self._exit_message()) from None
        if isinstance(answer, str):
            raise WorkerError(answer)
        return answer

    def _exit_message(self) -> str:
        self.process.join(JOIN_SECONDS)
        code = self.process.exitcode
        part = self.own.part
        how = f"by signal {signal.Signals(-code).name}" if code is not None and code < 0 else f"with exit code {code}"
        return f"{self.own.name} (environments {part.start} to {part.stop - 1}) died {how}"


class WorkerVectorEnv(LilGymVectorEnv):
    """As `BatchedEnv`, with N environments in `num_workers` processes, including the calling one.

    Results equal `BatchedEnv`'s bit for bit. Below about 128 environments one process is faster.
    """

    def __init__(
        self,
        id: str,
        num_envs: int,
        num_workers: int | str = processes.AUTO,
        *,
        start_method: str | None = None,
        timeout_seconds: float = 20.0,
        render_mode: str | None = None,
        copy: bool = True,
        **settings: Any,
    ) -> None:
        """Starts the workers.

        Only the process that made it can use it: a child forked from it can only `close` it, which releases the
        child's own resources.

        Args:
            id: Such as "lilgym_mp/TowerScratch-v0".
            num_envs: The number of environments, N.
            num_workers: Processes that step environments, including this one (1: no others); "auto": one for each core,
                but at least 64 environments per process.
            start_method: "fork", "forkserver" or "spawn"; None for Python's default.
            timeout_seconds: A worker that takes longer for a call counts as hung.
            render_mode: As for `BatchedEnv`.
            copy: As for `BatchedEnv`.
            settings: The other keywords of `BatchedEnv`.

        Raises:
            ValueError: For unusable settings.
            SharedMemoryError: Without enough memory.
            WorkerError: If a worker fails or cannot be started, as in a daemonic process.
        """
        # First, because Gymnasium before 1.3 also closes environments whose constructor failed.
        self._workers: list[_Worker] = []
        self._owner = os.getpid()
        self._finalizer: weakref.finalize[Any, Any] | None = None  # set when there are processes or memory to release
        spec = batch_spec(id)
        given = spec.kwargs
        names = ("num_workers", "start_method", "timeout_seconds", "render_mode", "copy")
        checked = BatchSettings.of({"num_envs": num_envs, **given, **settings}, *names)
        count = processes.checked_worker_count(num_workers, checked.num_envs)
        context = processes.process_context(start_method)
        self._timeout = processes.checked_timeout(timeout_seconds)
        pages = PAGES if copy and count > 1 else 0
        self._shared = shared = SharedMemory(sum(spec.size for spec in _array_specs(checked, pages).values()))
        self._finalizer = weakref.finalize(self, _stop_workers, self._workers, shared, self._owner)
        bounds: list[int] = np.linspace(0, checked.num_envs, count + 1).round().astype(int).tolist()
        group = getattr(checked.sampler, "same_statement", 1)
        if any(bound % group for bound in bounds[1:-1]):
            warnings.warn(
                f"same_statement={group}: {count} workers split groups of environments that play one statement, so that"
                f" they play several; choose num_workers so that each process has a multiple of {group} environments",
                stacklevel=2,
            )
        spin_seconds = SPIN_SECONDS if count <= processes.usable_cores() else 0.0
        own, *others = (
            Slice(checked, shared, spin_seconds, pages, f"worker {index}", slice(bounds[index], bounds[index + 1]))
            for index in range(count)
        )
        buffers, self._pages = own.memory()
        self._part = own.part
        # The array over each page that the caller may hold
        self._page_users: list[weakref.ref[Any] | None] = [None] * pages
        self._page: int | None = None
        super().__init__(checked, buffers, render_mode=render_mode, copy=copy)
        rendering = {} if render_mode is None else {"render_mode": render_mode}
        self.spec = replace(spec, kwargs={**given, **settings, **rendering, "num_envs": num_envs})
        try:
            with _starting:
                if others and (reason := processes.why_no_processes()) is not None:
                    raise WorkerError(f"{reason}; use num_workers=1, or gymnasium.make_vec")
                if others and context.get_start_method() == "fork":
                    _warm_up(checked)
                self._engine = own.engine()
                for other in others:
                    _start_worker(context, other, self._workers)
            for worker in self._workers:
                worker.receive(START_SECONDS)
        except BaseException:
            self.close()
            raise

    @property
    def num_workers(self) -> int:
        """Processes that step environments, including this one."""
        return len(self._workers) + 1

    @property
    def worker_pids(self) -> tuple[int, ...]:
        """Process ids of workers 1, 2, ...; worker 0 is the calling process."""
        return tuple(worker.process.pid or 0 for worker in self._workers)

    def _everywhere(self, method: Callable[..., T], *arguments: Any) -> list[T]:
        """Stops all workers on any failure."""
        self._check_open()
        self._page = self._free_page() if method in COPYING else None
        try:
            for worker in self._workers:
                with suppress(OSError):  # it has died, which receiving its answer reports
                    worker.channel.send((method.__name__, arguments, self._page))
            results = super()._everywhere(method, *arguments)
            if self._page is not None:
                self._pages[self._page, self._part] = self._engine.buffers.image
            return results + [worker.receive(self._timeout) for worker in self._workers]
        except BaseException:
            self.close()
            raise

    def _free_page(self) -> int | None:
        """A page that the caller no longer holds, if there is one."""
        free = (page for page, user in enumerate(self._page_users) if user is None or user() is None)
        return next(free, None)

    def _images(self) -> UInt8Array:
        if self._page is None:
            return super()._images()
        # A new array over the page: any view that the caller keeps keeps this array alive.
        root = np.frombuffer(self._pages[self._page].data, np.uint8)
        self._page_users[self._page] = weakref.ref(root)
        return root.reshape(self._pages.shape[1:])

    def _check_open(self) -> None:
        super()._check_open()
        if os.getpid() != self._owner:
            raise gym.error.ClosedEnvironmentError(
                f"this environment belongs to process {self._owner}, from which this one was forked; make a new one"
            )

    def close_extras(self, **kwargs: Any) -> None:
        """Stops the workers and releases the memory.

        Args:
            kwargs: Those of `close`, which have no effect.
        """
        if self._finalizer is not None:
            _stop_workers(self._workers, self._shared, self._owner)
            self._finalizer.detach()


def _stop_workers(workers: list[_Worker], shared: SharedMemory, owner: int) -> None:
    """Stops the workers and empties their list; in a child forked from their owner, only closes its connections.

    Can be interrupted and called again. A worker whose process was not recorded stops when its connections close.
    """
    for worker in workers:
        worker.channel.close()
    end = perf_counter() + JOIN_SECONDS
    while workers:
        process = workers[-1].process
        started = os.getpid() == owner and process.pid is not None
        if started:
            process.join(max(0.0, end - perf_counter()))
            process.kill()
            process.join()
        workers.pop()
        if started:
            process.close()
    shared.release()


def _warm_up(settings: BatchSettings) -> None:
    """Steps a few environments, so that forked processes inherit all imports, data and compiled code.

    A process forked while another thread imports a module could wait for that module forever.
    """
    few = min(settings.num_envs, FEWEST_COMPILED)
    settings = replace(settings, num_envs=few, sampler=None)
    engine = Engine(settings, Buffers.new(settings.array_specs()))
    engine.reset(ResetRequest(np.arange(few), [0] * few, [None] * few, all_envs=True))
    for call in (engine.step, engine.write_masks, engine.write_goals, engine.write_items, engine.states):
        call()


def _start_worker(context: Any, own: Slice, listed: list[_Worker]) -> None:
    """Starts a worker. It is added to `listed` first, so that a worker whose start was interrupted is stopped too."""
    answers, their_writer = context.Pipe(duplex=False)
    their_reader, calls = context.Pipe(duplex=False)
    _ends.update((answers, calls))
    name = f"lilgym_mp {own.name}"
    process = context.Process(target=_worker_main, args=(own, their_reader, their_writer), name=name, daemon=True)
    listed.append(_Worker(own, process, Channel(answers, calls, own.spin_seconds)))
    try:
        with processes.start_protected(context):
            process.start()
    except OSError as fault:
        raise WorkerError(f"{own.name} cannot be started: {fault}") from fault
    finally:
        their_reader.close()
        their_writer.close()
