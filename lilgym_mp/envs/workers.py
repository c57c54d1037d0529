"""Environments in several processes that share one block of memory.

The calling process steps the first slice of the batch itself, each worker process another slice. The caller sends a
command by increasing a counter in shared memory. A process that waits for a counter spins briefly, then yields, then
blocks on a pipe. Only resets, states and tracebacks go through pipes. A worker exits when its caller exits, or when
no process holds the other ends of its pipes.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import traceback
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from enum import IntEnum
from multiprocessing import forkserver, resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from numbers import Real
from time import perf_counter
from typing import Any, NoReturn

import gymnasium as gym
import numpy as np

from lilgym_mp.arrays import UInt8Array
from lilgym_mp.choices import choose
from lilgym_mp.envs.batched import LilGymVectorEnv, TaskOperation
from lilgym_mp.envs.buffers import ALIGNMENT, ArraySpec, Buffers, arrays_in, buffers_size
from lilgym_mp.envs.cores import FEWEST_COMPILED
from lilgym_mp.envs.engine import BatchSettings, Engine, ResetRequest
from lilgym_mp.envs.shared_memory import SharedMemory
from lilgym_mp.render import image_shape
from lilgym_mp.rules import State

AUTO = "auto"
MIN_ENVS_PER_PROCESS = 64  # fewest environments per process with "auto"
SPIN_SECONDS = 100e-6
YIELD_SECONDS = 1e-3
PAGES = 3  # copies of the images in shared memory that the caller can hold at a time; beyond that it copies them itself
NO_PAGE = -1
POLL_SECONDS = 0.2  # time between checks that the other processes are alive
START_SECONDS = 120.0  # time limit for a worker's imports and tasks
JOIN_SECONDS = 1.0
LONGEST_WAIT = 1e6  # seconds; the longest wait that the system accepts
DESCRIPTORS = 12  # file descriptors that starting a worker takes; Python leaks some if they run out half-way


class WorkerError(RuntimeError):
    """A worker could not be started, died, hung or raised. Names it, with exit code or traceback; the environment has
    been closed."""


class Command(IntEnum):
    RESET = 0
    STEP = 1
    MASK = 2
    GOAL = 3
    ITEMS = 4
    STATES = 5
    TASKS = 6
    CLOSE = 7


COPIED = (Command.RESET, Command.STEP)  # commands that return observations
_WRITES = {"mask": Command.MASK, "goal": Command.GOAL, "items": Command.ITEMS}
_WRITTEN = {command: what for what, command in _WRITES.items()}

_FIELDS = ALIGNMENT // 8  # 64-bit fields of a cache line
# Held while workers are started and by any fork: no process is forked while another thread imports something here.
_starting = threading.RLock()
os.register_at_fork(before=_starting.acquire, after_in_parent=_starting.release, after_in_child=_starting.release)


class WorkerControl:
    """Command and reply counters of one worker in shared memory, each on its own cache line."""

    LINES = 2

    def __init__(self, fields: memoryview, index: int) -> None:
        self._fields = fields
        self._lock = threading.RLock()
        self._command_field = (index * self.LINES) * _FIELDS
        self._reply_field = self._command_field + _FIELDS

    def _fence(self) -> None:
        """A memory fence: orders this process's writes before its next reads."""
        with self._lock:
            pass

    def send(self, count: int, command: Command, page: int = NO_PAGE) -> None:
        self._fields[self._command_field + 1] = command
        self._fields[self._command_field + 3] = page
        self._fence()
        self._fields[self._command_field] = count

    @property
    def sent(self) -> int:
        """Number of commands sent."""
        return self._fields[self._command_field]

    @property
    def command(self) -> Command:
        return Command(self._fields[self._command_field + 1])

    @property
    def page(self) -> int:
        """The page that images are copied to, or NO_PAGE."""
        return self._fields[self._command_field + 3]

    def acknowledge(self, count: int) -> None:
        self._fence()
        self._fields[self._reply_field] = count

    @property
    def acknowledged(self) -> int:
        """Number of commands carried out."""
        return self._fields[self._reply_field]

    def set_asleep(self, *, worker: bool, asleep: bool) -> None:
        self._fields[(self._command_field if worker else self._reply_field) + 2] = asleep
        self._fence()

    def is_asleep(self, *, worker: bool) -> bool:
        self._fence()
        return bool(self._fields[(self._command_field if worker else self._reply_field) + 2])


def _spin_until(ready: Callable[[], bool], spin_seconds: float) -> bool:
    """Waits briefly for `ready`; whether it became true."""
    end = perf_counter() + spin_seconds
    while perf_counter() < end:
        if ready():
            return True
    end += YIELD_SECONDS
    while perf_counter() < end:
        if ready():
            return True
        os.sched_yield()
    return ready()


@dataclass(frozen=True)
class Assignment:
    """The arguments of a worker process. Picklable."""

    settings: BatchSettings
    shared: SharedMemory
    array_specs: Mapping[str, ArraySpec]  # of the arrays in shared memory
    spin_seconds: float
    index: int = 0
    first: int = 0  # of its environments
    stop: int = 0


def _map_memory(assignment: Assignment) -> tuple[memoryview, Buffers, UInt8Array]:
    """The control fields, the buffers, and the pages (pages, N, height, width, 3) for copies of images."""
    arrays = arrays_in(assignment.shared.memory, assignment.array_specs)
    control, pages = arrays.pop("control"), arrays.pop("pages")
    return control.ravel().data, Buffers(**arrays), pages


def _worker_main(
    assignment: Assignment,
    messages: Connection,
    wake_pipe: Connection,
    caller_wake_pipe: Connection,
    inherited: Sequence[Connection],
) -> None:
    """Main loop of a worker: executes commands until it is closed or the caller is gone.

    `inherited`: the caller's ends of pipes, which are open in a forked worker.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the caller handles Ctrl-C
    for connection in inherited:
        connection.close()
    try:
        exit_fds = _exit_fds_of_caller()
        fields, buffers, pages = _map_memory(assignment)
        part = slice(assignment.first, assignment.stop)
        engine = Engine(assignment.settings, buffers.slice(part.start, part.stop), part.start)
        messages.send(None)
        control = WorkerControl(fields, assignment.index)
        count = 0
        while _wait_for_command(control, count, wake_pipe, exit_fds, assignment.spin_seconds):
            count += 1
            command = control.command
            if command is Command.CLOSE:
                break
            _execute(engine, command, messages)
            if control.page != NO_PAGE:
                pages[control.page, part] = engine.buffers.image
            control.acknowledge(count)
            if control.is_asleep(worker=False):
                caller_wake_pipe.send_bytes(b"!")
    except (BrokenPipeError, ConnectionResetError, EOFError):
        return  # the caller is gone
    except Exception:
        _send_error(traceback.format_exc(), messages, caller_wake_pipe)


def _send_error(fault: str, messages: Connection, caller_wake_pipe: Connection) -> None:
    with suppress(OSError):  # the caller is gone
        messages.send(fault)
        caller_wake_pipe.send_bytes(b"!")


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


def _wait_for_command(
    control: WorkerControl, count: int, wake_pipe: Connection, exit_fds: Sequence[int], spin_seconds: float
) -> bool:
    """Waits for the next command; False if the caller is gone, which makes one of `exit_fds` readable."""

    def sent() -> bool:
        return control.sent > count

    while not _spin_until(sent, spin_seconds):
        control.set_asleep(worker=True, asleep=True)
        readable = [] if sent() else wait([wake_pipe, *exit_fds])
        control.set_asleep(worker=True, asleep=False)
        if wake_pipe in readable:
            wake_pipe.recv_bytes()
        elif readable:
            return False
    return True


def _execute(engine: Engine, command: Command, messages: Connection) -> None:
    if command is Command.STEP:
        engine.step()
    elif command is Command.RESET:
        engine.reset(messages.recv())
    elif command is Command.STATES:
        messages.send(engine.states())
    elif command is Command.TASKS:
        change: TaskOperation = messages.recv()
        engine.set_tasks(change(engine.tasks))
    else:
        engine.write(_WRITTEN[command])


@dataclass(frozen=True, eq=False)
class _Worker:
    """The caller's handle of a worker."""

    index: int
    first: int
    stop: int
    process: BaseProcess
    control: WorkerControl
    messages: Connection
    wake_pipe: Connection  # wakes the worker
    caller_wake_pipe: Connection  # wakes the caller

    @property
    def connections(self) -> tuple[Connection, ...]:
        return self.messages, self.wake_pipe, self.caller_wake_pipe


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
        checked = BatchSettings.of(num_envs, **{**gym.spec(id).kwargs, **settings})
        count = checked_worker_count(num_workers, checked.num_envs)
        context = _context(start_method)
        self._timeout = _checked_timeout(timeout_seconds)
        self._count = 0
        pages = PAGES if copy and count > 1 else 0
        specs = {
            "control": ArraySpec((count, WorkerControl.LINES, _FIELDS), np.int64),
            **checked.array_specs(),
            "pages": ArraySpec((pages, checked.num_envs, *image_shape(checked.image_size)), np.uint8),
        }
        self._shared = SharedMemory(buffers_size(specs))
        self._finalizer = weakref.finalize(self, _stop_workers, self._workers, self._shared, self._owner)
        self._spin_seconds = SPIN_SECONDS if count <= usable_cores() else 0.0
        shared = Assignment(checked, self._shared, specs, self._spin_seconds)
        fields, buffers, self._pages = _map_memory(shared)
        # The array over each page that the caller may hold
        self._page_users: list[weakref.ref[Any] | None] = [None] * pages
        self._page = NO_PAGE
        super().__init__(checked, buffers, render_mode=render_mode, copy=copy)
        bounds: list[int] = np.linspace(0, checked.num_envs, count + 1).round().astype(int).tolist()
        self._own = slice(0, bounds[1])
        assignments = [
            replace(shared, index=index, first=bounds[index], stop=bounds[index + 1]) for index in range(1, count)
        ]
        try:
            self._start(context, checked, assignments, fields)
        except BaseException:
            self.close()
            raise

    def _start(
        self, context: Any, settings: BatchSettings, assignments: Sequence[Assignment], fields: memoryview
    ) -> None:
        with _starting:
            _check_room(len(assignments), self._shared)
            if assignments and context.get_start_method() == "fork":
                _warm_up(settings)
            self._engine = Engine(settings, self._buffers.slice(0, self._own.stop))
            for assignment in assignments:
                _start_worker(context, assignment, fields, self._workers)
        for worker in self._workers:
            self._receive(worker, START_SECONDS)

    @property
    def num_workers(self) -> int:
        """Processes that step environments, including this one."""
        return len(self._workers) + 1

    @property
    def worker_pids(self) -> tuple[int, ...]:
        """Process ids of workers 1, 2, ...; worker 0 is the calling process."""
        return tuple(worker.process.pid or 0 for worker in self._workers)

    def _reset(self, request: ResetRequest) -> None:
        payloads = [_slice_request(request, worker.first, worker.stop) for worker in self._workers]

        def own_part() -> None:
            self._engine.reset(_slice_request(request, 0, self._own.stop))
            self._copy_own_images()

        self._page = self._free_page()
        self._run_everywhere(Command.RESET, own_part, payloads)

    def _step(self) -> None:
        self._page = self._free_page()
        self._run_everywhere(Command.STEP, self._own_step)

    def _own_step(self) -> None:
        self._engine.step()
        self._copy_own_images()

    def _copy_own_images(self) -> None:
        if self._page != NO_PAGE:
            self._pages[self._page, self._own] = self._engine.buffers.image

    def _free_page(self) -> int:
        """A page that the caller no longer holds, or NO_PAGE."""
        for page, user in enumerate(self._page_users):
            if user is None or user() is None:
                return page
        return NO_PAGE

    def _images(self) -> UInt8Array:
        if self._page == NO_PAGE:
            return super()._images()
        # A new array over the page: any view that the caller keeps keeps this array alive.
        root = np.frombuffer(self._pages[self._page].data, np.uint8)
        self._page_users[self._page] = weakref.ref(root)
        return root.reshape(self._pages.shape[1:])

    def _write(self, what: str) -> None:
        self._run_everywhere(_WRITES[what], lambda: self._engine.write(what))

    def _states(self) -> list[State]:
        states: list[State] = []

        def collect() -> None:
            states.extend(self._engine.states())
            for worker in self._workers:
                states.extend(self._receive(worker, self._timeout))

        self._run_everywhere(Command.STATES, collect)
        return states

    def _change_tasks(self, change: TaskOperation) -> None:
        self._run_everywhere(Command.TASKS, lambda: self._engine.set_tasks(self.tasks), [change] * len(self._workers))

    def _run_everywhere(self, command: Command, own_part: Callable[[], None], payloads: Sequence[object] = ()) -> None:
        """Executes a command in every process. Stops all workers on any failure."""
        self._check_open()
        try:
            self._send_command(command, payloads)
            own_part()
            for worker in self._workers:
                self._wait_for_worker(worker)
        except BaseException:
            self.close()
            raise

    def _send_command(self, command: Command, payloads: Sequence[object]) -> None:
        self._count += 1
        try:
            for worker, payload in zip(self._workers, payloads, strict=False):
                worker.messages.send(payload)
            for worker in self._workers:
                worker.control.send(self._count, command, self._page if command in COPIED else NO_PAGE)
                if worker.control.is_asleep(worker=True):
                    worker.wake_pipe.send_bytes(b"!")
        except OSError:  # the worker is gone
            self._raise_worker_failure()

    def _wait_for_worker(self, worker: _Worker) -> None:
        """Waits until the worker has executed the last command. Raises WorkerError if it fails."""
        control, count = worker.control, self._count

        def acknowledged() -> bool:
            return control.acknowledged >= count

        if _spin_until(acknowledged, self._spin_seconds):
            return
        end = perf_counter() + self._timeout
        while not acknowledged():
            control.set_asleep(worker=False, asleep=True)
            if not acknowledged():
                self._wait_for_wake_up(worker)
            control.set_asleep(worker=False, asleep=False)
            if perf_counter() > end and not acknowledged():
                raise WorkerError(f"worker {worker.index} has not responded for {self._timeout:g} seconds")

    def _wait_for_wake_up(self, worker: _Worker) -> None:
        """Blocks until the worker wakes this process, at most POLL_SECONDS. Raises WorkerError if it failed."""
        readable = wait([worker.caller_wake_pipe, worker.messages, worker.process.sentinel], POLL_SECONDS)
        if worker.caller_wake_pipe in readable:
            try:
                worker.caller_wake_pipe.recv_bytes()
            except (EOFError, OSError):
                self._raise_worker_failure()
        if worker.messages in readable or worker.process.sentinel in readable:
            self._raise_worker_failure()

    def _receive(self, worker: _Worker, seconds: float) -> Any:
        """The worker's next message. Raises WorkerError if it is a traceback or none comes."""
        readable = wait([worker.messages, worker.process.sentinel], min(seconds, LONGEST_WAIT))
        if worker.messages in readable:
            try:
                message = worker.messages.recv()
            except (EOFError, OSError):  # it died, perhaps while sending
                raise WorkerError(_exit_message(worker)) from None
            if isinstance(message, str):
                raise WorkerError(f"worker {worker.index} raised:\n{message}")
            return message
        if readable:
            raise WorkerError(_exit_message(worker))
        raise WorkerError(f"worker {worker.index} has not responded for {seconds:g} seconds")

    def _raise_worker_failure(self) -> NoReturn:
        """Raises WorkerError for the worker that raised or died."""
        end = perf_counter() + JOIN_SECONDS
        while perf_counter() < end:
            for worker in self._workers:
                with suppress(OSError):
                    while worker.messages.poll():
                        self._receive(worker, 0)
                if not worker.process.is_alive():
                    raise WorkerError(_exit_message(worker))
        raise WorkerError("a worker closed its pipe, but none has died")

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


def _stop_workers(workers: list[_Worker], shared: SharedMemory, owner: int) -> None:
    """Stops the workers and empties their list; in a child forked from their owner, only closes its connections.

    Can be interrupted and called again. A worker whose process was not recorded stops when its connections close.
    """
    started = [worker for worker in workers if os.getpid() == owner and worker.process.pid is not None]
    for worker in started:
        worker.control.send(worker.control.sent + 1, Command.CLOSE)
        with suppress(OSError):  # it has ended already
            worker.wake_pipe.send_bytes(b"!")
    end = perf_counter() + JOIN_SECONDS
    for worker in started:
        worker.process.join(max(0.0, end - perf_counter()))
        if worker.process.is_alive():
            worker.process.kill()
            worker.process.join()
    while workers:
        for connection in workers[-1].connections:
            connection.close()
        worker = workers.pop()
        if worker in started:
            worker.process.close()
    shared.release()


def _exit_message(worker: _Worker) -> str:
    worker.process.join(JOIN_SECONDS)
    code = worker.process.exitcode
    how = f"by signal {signal.Signals(-code).name}" if code is not None and code < 0 else f"with exit code {code}"
    return f"worker {worker.index} (environments {worker.first} to {worker.stop - 1}) died {how}"


def _check_room(workers: int, shared: SharedMemory) -> None:
    """Raises WorkerError if this process cannot start this many workers."""
    if workers and multiprocessing.current_process().daemon:
        raise WorkerError("a daemonic process cannot start workers; use num_workers=1, or gymnasium.make_vec")
    if not shared.has_room_for(workers * DESCRIPTORS):
        raise WorkerError(
            f"{workers} workers take up to {workers * DESCRIPTORS} file descriptors, and this process cannot open that"
            " many more; close some, raise the limit (ulimit -n), or use fewer workers"
        )


def _warm_up(settings: BatchSettings) -> None:
    """Steps a few environments, so that forked processes inherit all imports, data and compiled code.

    A process forked while another thread imports a module could wait for that module forever.
    """
    few = min(settings.num_envs, FEWEST_COMPILED)
    settings = replace(settings, num_envs=few)
    engine = Engine(settings, Buffers.new(settings.array_specs()))
    engine.reset(ResetRequest(np.arange(few), [0] * few, [None] * few, all_envs=True))
    engine.step()
    for what in _WRITES:
        engine.write(what)
    engine.states()


def _start_worker(context: Any, assignment: Assignment, fields: memoryview, listed: list[_Worker]) -> None:
    """Starts a worker. It is added to `listed` first, so that a worker whose start was interrupted is stopped too."""
    ours, theirs = context.Pipe()
    wake_receiver, wake_pipe = context.Pipe(duplex=False)
    caller_wake_pipe, caller_wake_sender = context.Pipe(duplex=False)
    inherited: list[Connection] = []
    process = context.Process(
        target=_worker_main,
        args=(assignment, theirs, wake_receiver, caller_wake_sender, inherited),
        name=f"lilgym_mp worker {assignment.index}",
        daemon=True,
    )
    control = WorkerControl(fields, assignment.index)
    listed.append(
        _Worker(
            assignment.index, assignment.first, assignment.stop, process, control, ours, wake_pipe, caller_wake_pipe
        )
    )
    if context.get_start_method() == "fork":
        inherited += [connection for worker in listed for connection in worker.connections]
    try:
        with _compiler_lock_held(), _interrupts_blocked(context):
            process.start()
    except OSError as fault:
        raise WorkerError(f"worker {assignment.index} cannot be started: {fault}") from fault
    finally:
        inherited.clear()
        for connection in (theirs, wake_receiver, caller_wake_sender):
            connection.close()


def _compiler_lock_held() -> AbstractContextManager[object]:
    """Holds numba's lock, if numba is loaded: a process forked while another thread compiles could never compile."""
    module = sys.modules.get("numba.core.compiler_lock")
    return nullcontext() if module is None else module.global_compiler_lock


@contextmanager
def _interrupts_blocked(context: Any) -> Iterator[None]:
    """Blocks SIGINT while a process starts, so that Ctrl-C never reaches it; the caller receives it afterwards."""
    if context.get_start_method() != "fork":  # these helper processes must not inherit the block
        resource_tracker.ensure_running()
    if context.get_start_method() == "forkserver":
        forkserver.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _slice_request(request: ResetRequest, first: int, stop: int) -> ResetRequest:
    """The part of a request for environments first .. stop - 1, with env ids relative to `first`."""
    low, high = np.searchsorted(request.env_ids, [first, stop]).tolist()
    return ResetRequest(
        request.env_ids[low:high] - first, request.seeds[low:high], request.tasks[low:high], request.all_envs
    )


def usable_cores() -> int:
    """CPU cores available to this process."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


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
    if start_method is None:
        return multiprocessing.get_context()
    methods = {method: method for method in multiprocessing.get_all_start_methods()}
    return multiprocessing.get_context(choose("start_method", start_method, methods))
