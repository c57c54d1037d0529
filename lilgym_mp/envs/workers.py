"""Environments in several processes that share one block of memory.

The calling process steps the first slice of the batch itself, each worker process another slice. `Counter`s in shared
memory say how many calls of its `Engine` a worker has been told to make, and how many it has made. A process that
waits for a counter spins briefly, then yields, then sleeps until its pipe is readable. Pipes carry only the arguments
and results of some calls, tracebacks, and None to wake a process. A worker exits when its caller exits, or when no
process holds the other end of its pipe.
"""

from __future__ import annotations

import itertools
import multiprocessing
import os
import signal
import sys
import threading
import time
import traceback
import warnings
import weakref
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import reduction
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from numbers import Real
from pkgutil import resolve_name
from time import perf_counter
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec

from lilgym_mp.envs.batched import LilGymVectorEnv, T
from lilgym_mp.envs.buffers import ALIGNMENT, ArraySpec, Buffers, arrays_in
from lilgym_mp.envs.cores import FEWEST_COMPILED
from lilgym_mp.envs.engine import BatchSettings, Engine, ResetRequest
from lilgym_mp.envs.keywords import refuse_old_id
from lilgym_mp.envs.machine import start_method_kept, usable_cores
from lilgym_mp.envs.shared_memory import SharedMemory
from lilgym_mp.scene.arrays import UInt8Array
from lilgym_mp.scene.choices import choose
from lilgym_mp.scene.render import image_shape

AUTO = "auto"
MIN_ENVS_PER_PROCESS = 64  # fewest environments per process with "auto"
SPIN_SECONDS = 100e-6
YIELD_SECONDS = 1e-3
PAGES = 3  # copies of the images in shared memory that the caller can hold at a time; beyond that it copies them itself
NO_PAGE = -1
START_SECONDS = 120.0  # time limit for a worker's imports and tasks
JOIN_SECONDS = 1.0
LONGEST_WAIT = 1e6  # seconds; the longest wait that the system accepts

WRITERS = (Engine.write_masks, Engine.write_goals, Engine.write_items)
TAKING_ARGUMENTS = (Engine.reset, Engine.set_tasks, Engine.restore)
METHODS: tuple[Callable[..., Any], ...] = (Engine.step, Engine.states, Engine.save, *TAKING_ARGUMENTS, *WRITERS)
CLOSE = len(METHODS)  # instead of a method's index: the worker is to exit
COPYING = (Engine.step, Engine.reset)  # methods after which the images are copied to a page

LINE = ALIGNMENT // 8  # 64-bit fields of a cache line
# Held while workers are started and by any fork: no process is forked while another thread imports something here.
_starting = threading.RLock()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_starting.acquire, after_in_parent=_starting.release, after_in_child=_starting.release)
_yield = getattr(os, "sched_yield", partial(time.sleep, 0))


class WorkerError(RuntimeError):
    """A worker could not be started, died, hung or raised. Names it, with exit code or traceback; the environment has
    been closed."""


class Counter:
    """A counter on a cache line of shared memory: one process increases it, and another waits for it."""

    def __init__(self, line: memoryview) -> None:
        """`line`: the count, whether the waiting process sleeps, and what the increasing process adds."""
        self._line = line
        self._lock = threading.RLock()

    def _fence(self) -> None:
        """A memory fence: orders this process's writes before its next reads and writes.

        Without it a processor may delay the write of the count until after the look at the sleeper's flag, so that a
        wake-up is lost. Python has no fences of its own, but taking a lock is one. It takes about 1 us; a message
        through the pipe at every call, which would need neither counts nor flags, takes about 20 us.
        """
        with self._lock:
            pass

    @property
    def added(self) -> tuple[int, int]:
        return self._line[2], self._line[3]

    def increase(self, wake_pipe: Connection, first: int = 0, second: int = 0) -> None:
        """Increases the count, with two numbers for the other process, which is woken if it sleeps."""
        line = self._line
        line[2], line[3] = first, second
        self._fence()
        line[0] += 1
        self._fence()
        if line[1]:
            wake_pipe.send(None)

    def wait_for(self, count: int, spin_seconds: float, sleep: Callable[[], None]) -> None:
        """Waits until the count is reached. `sleep` returns when the other process has woken this one."""
        line = self._line
        end = perf_counter() + spin_seconds
        while line[0] < count and perf_counter() < end:
            pass
        end += YIELD_SECONDS
        while line[0] < count and perf_counter() < end:
            _yield()
        while line[0] < count:
            line[1] = True
            self._fence()
            if line[0] < count:
                sleep()
            line[1] = False


class Inbox:
    """The messages that come through a pipe, besides those that only wake this process."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe
        self._messages: deque[Any] = deque()

    def collect(self) -> None:
        """Reads one message, for which it waits. Raises EOFError or OSError if the other process is gone."""
        message = self._pipe.recv()
        if isinstance(message, str):
            raise WorkerError(message)
        if message is not None:
            self._messages.append(message)

    def take(self) -> Any:
        """The oldest message, for which it waits."""
        while not self._messages:
            self.collect()
        return self._messages.popleft()


@dataclass(frozen=True)
class Assignment:
    """The arguments of a worker process. Picklable."""

    settings: BatchSettings
    shared: SharedMemory
    array_specs: Mapping[str, ArraySpec]  # of the arrays in shared memory
    spin_seconds: float
    index: int
    part: slice  # of the batch

    def memory(self) -> tuple[Counter, Counter, Buffers, UInt8Array]:
        """The worker's counters of calls and of replies, and the batch's buffers and pages, copies of the images
        (pages, N, height, width, 3)."""
        arrays = arrays_in(self.shared.memory, self.array_specs)
        lines, pages = arrays.pop("lines"), arrays.pop("pages")
        calls, replies = (Counter(line.data) for line in lines[self.index])
        return calls, replies, Buffers(**arrays), pages


def _worker_main(assignment: Assignment, pipe: Connection, inherited: Sequence[Connection]) -> None:
    """Main loop of a worker: makes calls until it is closed or the caller is gone.

    `inherited`: the caller's ends of pipes, which are open in a forked worker.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the caller handles Ctrl-C
    for connection in inherited:
        connection.close()
    inbox = Inbox(pipe)

    def sleep() -> None:
        if pipe not in wait([pipe, *exit_fds]):
            raise EOFError
        inbox.collect()

    try:
        exit_fds = _exit_fds_of_caller()
        calls, replies, buffers, pages = assignment.memory()
        part = assignment.part
        engine = Engine(assignment.settings, buffers.slice(part.start, part.stop), part.start)
        for count in itertools.count(1):
            replies.increase(pipe)
            calls.wait_for(count, assignment.spin_seconds, sleep)
            index, page = calls.added
            if index == CLOSE:
                break
            method = METHODS[index]
            result = method(engine, *(inbox.take() if method in TAKING_ARGUMENTS else ()))
            if page != NO_PAGE:
                pages[page, part] = engine.buffers.image
            if result is not None:
                pipe.send(result)
    except (BrokenPipeError, ConnectionResetError, EOFError):
        return  # the caller is gone
    except Exception:
        with suppress(OSError):  # the caller is gone
            pipe.send(f"worker {assignment.index} raised:\n{traceback.format_exc()}")


def _exit_fds_of_caller() -> list[int]:
    """Descriptors that become readable when the caller exits. Raises EOFError if it has exited.

    Python's own sentinel pipe is not enough: other children forked from the caller hold its other end too.
    """
    caller = multiprocessing.parent_process()
    assert caller is not None
    exit_fds = [caller.sentinel]
    if hasattr(os, "pidfd_open") and caller.pid is not None:  # Linux
        try:
            exit_fds.append(os.pidfd_open(caller.pid))
        except ProcessLookupError:
            raise EOFError from None
        except OSError:  # forbidden, or out of descriptors
            pass
    return exit_fds


@dataclass(frozen=True, eq=False)
class _Worker:
    """The caller's handle of a worker."""

    assignment: Assignment
    process: BaseProcess
    calls: Counter
    replies: Counter
    pipe: Connection
    inbox: Inbox

    def wait_for(self, count: int, seconds: float) -> None:
        """Waits until the worker has replied `count` times. Raises WorkerError if it fails."""
        end = perf_counter() + seconds

        def sleep() -> None:
            left = max(0.0, min(end - perf_counter(), LONGEST_WAIT))
            if not wait([self.pipe, self.process.sentinel], left):
                raise WorkerError(f"worker {self.assignment.index} has not responded for {seconds:g} seconds")
            try:
                if not self.pipe.poll():
                    raise EOFError
                self.inbox.collect()
            except (EOFError, OSError):
                raise WorkerError(self._exit_message()) from None

        self.replies.wait_for(count, self.assignment.spin_seconds, sleep)

    def _exit_message(self) -> str:
        self.process.join(JOIN_SECONDS)
        code, part = self.process.exitcode, self.assignment.part
        how = f"by signal {signal.Signals(-code).name}" if code is not None and code < 0 else f"with exit code {code}"
        return f"worker {self.assignment.index} (environments {part.start} to {part.stop - 1}) died {how}"


class WorkerVectorEnv(LilGymVectorEnv):
    """As `BatchedEnv`, with N environments in `num_workers` processes, including the calling one.

    Results equal `BatchedEnv`'s bit for bit. Below about 128 environments one process is faster.
    """

    def __init__(
        self,
        id: str,
        num_envs: int,
        num_workers: int | str = AUTO,
        *,
        start_method: str | None = None,
        timeout_seconds: float = 20.0,
        render_mode: str | None = None,
        copy: bool = True,
        **settings: Any,
    ) -> None:
        """`id`: such as "lilgym_mp/TowerScratch-v0"; `settings`: the other keywords of `BatchedEnv`.

        `num_workers`: processes that step environments, including this one (1: no others); "auto": one for each
        core, but at least 64 environments per process. `start_method`: "fork", "forkserver" or "spawn",
        None for Python's default. `timeout_seconds`: a worker that takes longer for a call counts as hung.
        Raises ValueError for unusable settings, SharedMemoryError without enough memory, WorkerError if a worker fails
        or cannot be started, as in a daemonic process. Only the process that made it can use it: a child forked from
        that process can only `close` it, which releases the child's own resources.
        """
        # First, because Gymnasium before 1.3 also closes environments whose constructor failed.
        self._workers: list[_Worker] = []
        self._owner = os.getpid()
        self._finalizer: weakref.finalize[Any, Any] | None = None  # set when there are processes or memory to release
        spec = _batch_spec(id)
        given = spec.kwargs
        own = ("num_workers", "start_method", "timeout_seconds", "render_mode", "copy")
        checked = BatchSettings.of({"num_envs": num_envs, **given, **settings}, *own)
        count = checked_worker_count(num_workers, checked.num_envs)
        context = _context(start_method)
        self._timeout = _checked_timeout(timeout_seconds)
        self._replies = 1  # that each worker has been asked for; the first says that it has started
        pages = PAGES if copy and count > 1 else 0
        specs = {
            "lines": ArraySpec((count, 2, LINE), np.int64),
            **checked.array_specs(),
            "pages": ArraySpec((pages, checked.num_envs, *image_shape(checked.image_size)), np.uint8),
        }
        self._shared = shared = SharedMemory(sum(spec.size for spec in specs.values()))
        self._finalizer = weakref.finalize(self, _stop_workers, self._workers, shared, self._owner)
        bounds: list[int] = np.linspace(0, checked.num_envs, count + 1).round().astype(int).tolist()
        group = getattr(checked.sampler, "same_statement", 1)
        if any(bound % group for bound in bounds[1:-1]):
            warnings.warn(
                f"same_statement={group}: {count} workers split groups of environments that play one statement, so that"
                f" they play several; choose num_workers so that each process has a multiple of {group} environments",
                stacklevel=2,
            )
        spin_seconds = SPIN_SECONDS if count <= usable_cores() else 0.0
        own, *others = (
            Assignment(checked, shared, specs, spin_seconds, index, slice(bounds[index], bounds[index + 1]))
            for index in range(count)
        )
        _, _, buffers, self._pages = own.memory()
        # The array over each page that the caller may hold
        self._page_users: list[weakref.ref[Any] | None] = [None] * pages
        self._page = NO_PAGE
        super().__init__(checked, buffers, render_mode=render_mode, copy=copy)
        rendering = {} if render_mode is None else {"render_mode": render_mode}
        self.spec = replace(spec, kwargs={**given, **settings, **rendering, "num_envs": num_envs})
        self._own = own.part
        try:
            with _starting:
                if others:
                    _check_can_start()
                if others and context.get_start_method() == "fork":
                    _warm_up(checked)
                self._engine = Engine(checked, buffers.slice(0, own.part.stop))
                for assignment in others:
                    _start_worker(context, assignment, self._workers)
            for worker in self._workers:
                worker.wait_for(self._replies, START_SECONDS)
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
        page = NO_PAGE
        if method in COPYING:
            page = self._page = self._free_page()
        try:
            self._replies += 1
            for worker in self._workers:
                with suppress(OSError):  # it has died, which waiting for it reports
                    if arguments:
                        worker.pipe.send(arguments)
                    worker.calls.increase(worker.pipe, METHODS.index(method), page)
            results = super()._everywhere(method, *arguments)
            if page != NO_PAGE:
                self._pages[page, self._own] = self._engine.buffers.image
            for worker in self._workers:
                worker.wait_for(self._replies, self._timeout)
                if results[0] is not None:
                    results.append(worker.inbox.take())
            return results
        except BaseException:
            self.close()
            raise

    def _free_page(self) -> int:
        """A page that the caller no longer holds, or NO_PAGE."""
        free = (page for page, user in enumerate(self._page_users) if user is None or user() is None)
        return next(free, NO_PAGE)

    def _images(self) -> UInt8Array:
        if self._page == NO_PAGE:
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
        """Stops the workers and releases the memory."""
        if self._finalizer is not None:
            _stop_workers(self._workers, self._shared, self._owner)
            self._finalizer.detach()


def _batch_spec(id: str) -> EnvSpec:
    """The spec of a batch's id, "MODULE:ID" or "ID", of which MODULE is imported first, as in `gymnasium.make`.

    Its kwargs include the `max_episode_steps` of an id of one's own, as `gymnasium.make_vec` passes it: batches refuse
    it, because their rules end the episodes.

    Raises:
        gymnasium.error.Error: For an unknown id, one of the release, or one with wrappers of single environments.
    """
    module, _, name = id.rpartition(":")
    if module:
        resolve_name(module)
    spec = gym.spec(name)
    if spec.additional_wrappers:
        wrappers = ", ".join(each.name for each in spec.additional_wrappers)
        raise gym.error.Error(f"{name} is registered with additional_wrappers, which wrap no batches: {wrappers}")
    kwargs = dict(spec.kwargs)
    if "new_id" in kwargs:
        refuse_old_id(**kwargs)
    if spec.max_episode_steps is not None:
        kwargs.setdefault("max_episode_steps", spec.max_episode_steps)
    return replace(spec, kwargs=kwargs)


def _stop_workers(workers: list[_Worker], shared: SharedMemory, owner: int) -> None:
    """Stops the workers and empties their list; in a child forked from their owner, only closes its connections.

    Can be interrupted and called again. A worker whose process was not recorded stops when its connections close.
    """
    started = [worker for worker in workers if os.getpid() == owner and worker.process.pid is not None]
    for worker in started:
        with suppress(OSError):  # it has ended already
            worker.calls.increase(worker.pipe, CLOSE)
    end = perf_counter() + JOIN_SECONDS
    for worker in started:
        worker.process.join(max(0.0, end - perf_counter()))
        if worker.process.is_alive():
            worker.process.kill()
            worker.process.join()
    while workers:
        workers[-1].pipe.close()
        worker = workers.pop()
        if worker in started:
            worker.process.close()
    shared.release()


def _check_can_start() -> None:
    """Raises WorkerError if this process cannot start workers."""
    if not (hasattr(reduction, "DupFd") and hasattr(signal, "pthread_sigmask")):
        raise WorkerError("workers need Linux or macOS; use num_workers=1, or gymnasium.make_vec")
    if multiprocessing.current_process().daemon:
        raise WorkerError("a daemonic process cannot start workers; use num_workers=1, or gymnasium.make_vec")


def _warm_up(settings: BatchSettings) -> None:
    """Steps a few environments, so that forked processes inherit all imports, data and compiled code.

    A process forked while another thread imports a module could wait for that module forever.
    """
    few = min(settings.num_envs, FEWEST_COMPILED)
    settings = replace(settings, num_envs=few, sampler=None)
    engine = Engine(settings, Buffers.new(settings.array_specs()))
    engine.reset(ResetRequest(np.arange(few), [0] * few, [None] * few, all_envs=True))
    engine.step()
    for write in WRITERS:
        write(engine)
    engine.states()


def _start_worker(context: Any, assignment: Assignment, listed: list[_Worker]) -> None:
    """Starts a worker. It is added to `listed` first, so that a worker whose start was interrupted is stopped too."""
    ours, theirs = context.Pipe()
    inherited: list[Connection] = []
    name = f"lilgym_mp worker {assignment.index}"
    process = context.Process(target=_worker_main, args=(assignment, theirs, inherited), name=name, daemon=True)
    calls, replies, _, _ = assignment.memory()
    listed.append(_Worker(assignment, process, calls, replies, ours, Inbox(ours)))
    if context.get_start_method() == "fork":
        inherited += [worker.pipe for worker in listed]
    try:
        with start_method_kept(), _compiler_lock_held(), _interrupts_blocked(context):
            process.start()
    except OSError as fault:
        raise WorkerError(f"worker {assignment.index} cannot be started: {fault}") from fault
    finally:
        inherited.clear()
        theirs.close()


def _compiler_lock_held() -> AbstractContextManager[object]:
    """Holds numba's lock, if numba is loaded: a process forked while another thread compiles could never compile."""
    module = sys.modules.get("numba.core.compiler_lock")
    return nullcontext() if module is None else module.global_compiler_lock


@contextmanager
def _interrupts_blocked(context: Any) -> Iterator[None]:
    """Blocks SIGINT while a process starts, so that Ctrl-C never reaches it; the caller receives it afterwards."""
    if context.get_start_method() != "fork":  # these helper processes must not inherit the block
        from multiprocessing import resource_tracker

        resource_tracker.ensure_running()
    if context.get_start_method() == "forkserver":
        from multiprocessing import forkserver

        forkserver.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def checked_worker_count(num_workers: int | str, num_envs: int) -> int:
    """`num_workers` as an int, with "auto" resolved. Raises ValueError."""
    if isinstance(num_workers, str) and num_workers == AUTO:
        if multiprocessing.current_process().daemon:  # cannot have children
            return 1
        return max(1, min(usable_cores(), num_envs // MIN_ENVS_PER_PROCESS))
    if isinstance(num_workers, bool) or not isinstance(num_workers, int | np.integer) or num_workers < 1:
        raise ValueError(f"num_workers must be {AUTO!r} or a positive whole number, not {num_workers!r}")
    if num_workers > num_envs:
        raise ValueError(f"{num_workers} workers for {num_envs} environments; use at most one per environment")
    return int(num_workers)


def _checked_timeout(seconds: float) -> float:
    """Raises ValueError."""
    if isinstance(seconds, bool) or not isinstance(seconds, Real) or not seconds > 0:
        raise ValueError(f"timeout_seconds must be a positive number, not {seconds!r}")
    return float(seconds)


def _context(start_method: str | None) -> Any:
    if start_method is None:  # Python's default, which `get_context()` would fix for the whole process
        start_method = multiprocessing.get_start_method(allow_none=True) or multiprocessing.get_all_start_methods()[0]
    methods = {method: method for method in multiprocessing.get_all_start_methods()}
    return multiprocessing.get_context(choose("start_method", start_method, methods))
