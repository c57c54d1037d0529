"""Environments in several processes that share one block of memory.

The calling process steps the first part of the environments itself, a worker process each other part. The caller
announces a command by a counter in shared memory. Whoever waits for a counter spins briefly, then yields, then blocks
on a pipe. Only resets, states and tracebacks go through pipes. A worker exits when its caller exits, or when
nobody holds the other ends of its pipes.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
import sys
import threading
import traceback
import weakref
from collections.abc import Callable, Iterator, Sequence
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
from lilgym_mp.envs.buffers import ALIGNMENT, ArraySpec, Buffers, buffers_size
from lilgym_mp.envs.cores import FEWEST_COMPILED
from lilgym_mp.envs.engine import Engine, Reset, Settings
from lilgym_mp.envs.shared_memory import SharedMemory
from lilgym_mp.render import image_shape
from lilgym_mp.rules import State

AUTO = "auto"
ENVS_WORTH_A_PROCESS = 64  # "auto" gives each process at least so many
SPIN_SECONDS = 100e-6
YIELD_SECONDS = 1e-3
PAGES = 3  # copies of all images that the caller can hold before it has to copy them itself
NO_PAGE = -1
POLL_SECONDS = 0.2  # between checks that the other processes are alive
START_SECONDS = 120.0  # for a worker to import what it needs and load its tasks
JOIN_SECONDS = 1.0
LONGEST_WAIT = 1e6  # seconds that the system can be asked to wait
DESCRIPTORS = 12  # a worker takes while it is started; Python loses some when they run out half-way


class WorkerError(RuntimeError):
    """A worker cannot be started, died, hung or raised; names it, with exit code or traceback. The environment is
    closed then."""


class Command(IntEnum):
    RESET = 0
    STEP = 1
    MASK = 2
    GOAL = 3
    ITEMS = 4
    STATES = 5
    TASKS = 6
    CLOSE = 7


COPIED = (Command.RESET, Command.STEP)  # commands after which observations are given out
_WRITES = {"mask": Command.MASK, "goal": Command.GOAL, "items": Command.ITEMS}
_WRITTEN = {command: what for what, command in _WRITES.items()}

_WORDS = ALIGNMENT // 8  # 64-bit words of a cache line
# Held while workers are started, and by whoever forks: no process then begins amid another thread's imports here.
_starting = threading.RLock()
os.register_at_fork(before=_starting.acquire, after_in_parent=_starting.release, after_in_child=_starting.release)


class WorkerControl:
    """Command and acknowledgement counters of one worker, in shared memory, on a cache line each."""

    LINES = 2

    def __init__(self, words: memoryview, number: int) -> None:
        self._words = words
        self._lock = threading.RLock()
        self._asked = (number * self.LINES) * _WORDS
        self._answered = self._asked + _WORDS

    def _fence(self) -> None:
        """Orders what this process wrote before what it reads next, on any processor."""
        with self._lock:
            pass

    def ask(self, count: int, command: Command, page: int = NO_PAGE) -> None:
        self._words[self._asked + 1] = command
        self._words[self._asked + 3] = page
        self._fence()
        self._words[self._asked] = count

    @property
    def asked(self) -> int:
        """How many commands have been given."""
        return self._words[self._asked]

    @property
    def command(self) -> Command:
        return Command(self._words[self._asked + 1])

    @property
    def page(self) -> int:
        """Where the images are to be copied to, or NO_PAGE."""
        return self._words[self._asked + 3]

    def answer(self, count: int) -> None:
        self._fence()
        self._words[self._answered] = count

    @property
    def answered(self) -> int:
        """How many commands have been carried out."""
        return self._words[self._answered]

    def set_asleep(self, *, worker: bool, asleep: bool) -> None:
        self._words[(self._asked if worker else self._answered) + 2] = asleep
        self._fence()

    def is_asleep(self, *, worker: bool) -> bool:
        self._fence()
        return bool(self._words[(self._asked if worker else self._answered) + 2])


def _spun(ready: Callable[[], bool], spin_seconds: float) -> bool:
    """Whether `ready` came true within a short time."""
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
    """What a worker process is told at its start; picklable."""

    settings: Settings
    shared: SharedMemory
    number: int
    first: int
    stop: int
    pages: int
    spin_seconds: float


def _control_size(workers: int) -> int:
    """Bytes before the buffers' arrays."""
    return workers * WorkerControl.LINES * ALIGNMENT


def _pages_form(settings: Settings, pages: int) -> ArraySpec:
    return ArraySpec((pages, settings.num_envs, *image_shape(settings.image_size)), np.uint8)


def _laid_out(
    shared: SharedMemory, settings: Settings, workers: int, pages: int
) -> tuple[memoryview, Buffers, UInt8Array]:
    """The words of the posts, the buffers, and the pages (pages, N, height, width, 3) for copies of its images."""
    control = _control_size(workers)
    forms, form = settings.forms(), _pages_form(settings, pages)
    memory = shared.memory[control:]
    copies = np.frombuffer(memory, np.uint8, math.prod(form.shape), buffers_size(forms)).reshape(form.shape)
    return shared.memory[:control].cast("q"), Buffers.over(memory, forms), copies


def _worker_main(
    assignment: Assignment,
    workers: int,
    messages: Connection,
    wake_pipe: Connection,
    caller_wake_pipe: Connection,
    inherited: Sequence[Connection],
) -> None:
    """Main loop of a worker: carries out commands until it is told to close or the caller is gone.

    `inherited`: the caller's ends of pipes, which a forked worker has open as well.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the caller's to handle
    for connection in inherited:
        connection.close()
    try:
        ends = _ends_of_caller()
        words, buffers, pages = _laid_out(assignment.shared, assignment.settings, workers, assignment.pages)
        part = slice(assignment.first, assignment.stop)
        engine = Engine(assignment.settings, buffers.part(part.start, part.stop), part.start)
        messages.send(None)
        control = WorkerControl(words, assignment.number)
        count = 0
        while _wait_for_command(control, count, wake_pipe, ends, assignment.spin_seconds):
            count += 1
            command = control.command
            if command is Command.CLOSE:
                break
            _carry_out(engine, command, messages)
            if control.page != NO_PAGE:
                pages[control.page, part] = engine.buffers.image
            control.answer(count)
            if control.is_asleep(worker=False):
                caller_wake_pipe.send_bytes(b"!")
    except (BrokenPipeError, ConnectionResetError, EOFError):
        return  # the caller is gone
    except Exception:
        _send_fault(traceback.format_exc(), messages, caller_wake_pipe)


def _send_fault(fault: str, messages: Connection, caller_wake_pipe: Connection) -> None:
    with suppress(OSError):  # the caller is gone
        messages.send(fault)
        caller_wake_pipe.send_bytes(b"!")


def _ends_of_caller() -> list[int]:
    """Descriptors that can be read once the caller has ended. Raises EOFError when it has.

    The pipe that Python gives a process for this is not enough: whoever the caller forked holds its other end too.
    """
    caller = multiprocessing.parent_process()
    assert caller is not None
    ends = [caller.sentinel]
    if hasattr(os, "pidfd_open") and caller.pid is not None:  # Linux
        try:
            ends.append(os.pidfd_open(caller.pid))
        except ProcessLookupError:
            raise EOFError from None
        except OSError:  # forbidden, or no descriptor is left
            pass
    return ends


def _wait_for_command(
    control: WorkerControl, count: int, wake_pipe: Connection, ends: Sequence[int], spin_seconds: float
) -> bool:
    """Waits for the next command; False when the caller is gone, one of whose `ends` can be read then."""

    def asked() -> bool:
        return control.asked > count

    while not _spun(asked, spin_seconds):
        control.set_asleep(worker=True, asleep=True)
        readable = [] if asked() else wait([wake_pipe, *ends])
        control.set_asleep(worker=True, asleep=False)
        if wake_pipe in readable:
            wake_pipe.recv_bytes()
        elif readable:
            return False
    return True


def _carry_out(engine: Engine, command: Command, messages: Connection) -> None:
    if command is Command.STEP:
        engine.step()
    elif command is Command.RESET:
        engine.reset(messages.recv())
    elif command is Command.STATES:
        messages.send(engine.states())
    elif command is Command.TASKS:
        change: TaskOperation = messages.recv()
        engine.play(change(engine.tasks))
    else:
        engine.write(_WRITTEN[command])


@dataclass(frozen=True, eq=False)
class _Worker:
    """The caller's handle of a worker."""

    number: int
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
    """N environments in `num_workers` processes, the calling one among them; otherwise as `BatchedEnv`.

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
        """`id`: such as "lilgym_mp/TowerScratch-v0"; `settings`: the keywords of `engine.Settings.of` beside it.

        `num_workers`: processes that step environments, this one included (1: no other process); "auto": as many
        as there are cores, if each gets 64 environments or more. `start_method`: "fork", "forkserver" or "spawn",
        None for Python's default. `timeout_seconds`: a worker that takes longer over a call counts as hung.
        Raises ValueError for unusable settings, SharedMemoryError without room, WorkerError when a worker fails or
        cannot be started, as in a daemonic process. Belongs to the process that made it: a child that was forked from
        it can only `close` its own hold on it.
        """
        # First, as Gymnasium before 1.3 closes what could not be made, too.
        self._workers: list[_Worker] = []
        self._owner = os.getpid()
        self._finalizer: weakref.finalize[Any, Any] | None = None  # set once there are processes or memory to release
        checked = Settings.of(num_envs, **{**gym.spec(id).kwargs, **settings})
        count = checked_worker_count(num_workers, checked.num_envs)
        context = _context(start_method)
        self._timeout = _checked_timeout(timeout_seconds)
        self._count = 0
        pages = PAGES if copy and count > 1 else 0
        size = _control_size(count) + buffers_size(checked.forms()) + _pages_form(checked, pages).size
        self._shared = SharedMemory(size)
        self._finalizer = weakref.finalize(self, _stop_workers, self._workers, self._shared, self._owner)
        words, buffers, self._pages = _laid_out(self._shared, checked, count, pages)
        self._page_start = size - _pages_form(checked, pages).size
        self._lent: list[weakref.ref[Any] | None] = [None] * pages  # to whom each page was given
        self._page = NO_PAGE
        super().__init__(checked, buffers, render_mode=render_mode, copy=copy)
        bounds: list[int] = np.linspace(0, checked.num_envs, count + 1).round().astype(int).tolist()
        self._spin_seconds = SPIN_SECONDS if count <= usable_cores() else 0.0
        self._own = slice(0, bounds[1])
        assignments = [
            Assignment(checked, self._shared, number, bounds[number], bounds[number + 1], pages, self._spin_seconds)
            for number in range(1, count)
        ]
        try:
            self._start(context, checked, assignments, words)
        except BaseException:
            self.close()
            raise

    def _start(self, context: Any, settings: Settings, assignments: Sequence[Assignment], words: memoryview) -> None:
        with _starting:
            _check_room(len(assignments), self._shared)
            if assignments and context.get_start_method() == "fork":
                _warm_up(settings)
            self._engine = Engine(settings, self._buffers.part(0, self._own.stop))
            for assignment in assignments:
                _start_worker(context, assignment, len(assignments) + 1, words, self._workers)
        for worker in self._workers:
            self._receive(worker, START_SECONDS)

    @property
    def num_workers(self) -> int:
        """Processes that step environments, this one included."""
        return len(self._workers) + 1

    @property
    def worker_pids(self) -> tuple[int, ...]:
        """Process numbers of workers 1, 2, ...; worker 0 is the calling process."""
        return tuple(worker.process.pid or 0 for worker in self._workers)

    def _reset(self, order: Reset) -> None:
        payloads = [_part(order, worker.first, worker.stop) for worker in self._workers]

        def own_part() -> None:
            self._engine.reset(_part(order, 0, self._own.stop))
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
        """A page that nobody holds any more, or NO_PAGE."""
        for page, lent in enumerate(self._lent):
            if lent is None or lent() is None:
                return page
        return NO_PAGE

    def _images(self) -> UInt8Array:
        if self._page == NO_PAGE:
            return super()._images()
        # An array of its own over the page: whatever view of it the caller keeps, keeps it alive.
        shape = self._pages.shape[1:]
        start = self._page_start + self._page * math.prod(shape)
        root = np.frombuffer(self._shared.memory, np.uint8, math.prod(shape), start)
        self._lent[self._page] = weakref.ref(root)
        return root.reshape(shape)

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
        self._run_everywhere(Command.TASKS, lambda: self._engine.play(self.tasks), [change] * len(self._workers))

    def _run_everywhere(self, command: Command, own_part: Callable[[], None], payloads: Sequence[object] = ()) -> None:
        """Has a command carried out in every process. On any failure all workers are stopped."""
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
                worker.control.ask(self._count, command, self._page if command in COPIED else NO_PAGE)
                if worker.control.is_asleep(worker=True):
                    worker.wake_pipe.send_bytes(b"!")
        except OSError:  # the worker is gone
            self._raise_worker_failure()

    def _wait_for_worker(self, worker: _Worker) -> None:
        """Returns when the worker has carried out the last command. Raises WorkerError when it will not."""
        control, count = worker.control, self._count

        def answered() -> bool:
            return control.answered >= count

        if _spun(answered, self._spin_seconds):
            return
        end = perf_counter() + self._timeout
        while not answered():
            control.set_asleep(worker=False, asleep=True)
            if not answered():
                self._wait_for_wake_up(worker)
            control.set_asleep(worker=False, asleep=False)
            if perf_counter() > end and not answered():
                raise WorkerError(f"worker {worker.number} has not answered for {self._timeout:g} seconds")

    def _wait_for_wake_up(self, worker: _Worker) -> None:
        """Blocks until the worker wakes this process, POLL_SECONDS at most. Raises WorkerError if it failed."""
        readable = wait([worker.caller_wake_pipe, worker.messages, worker.process.sentinel], POLL_SECONDS)
        if worker.caller_wake_pipe in readable:
            try:
                worker.caller_wake_pipe.recv_bytes()
            except (EOFError, OSError):
                self._raise_worker_failure()
        if worker.messages in readable or worker.process.sentinel in readable:
            self._raise_worker_failure()

    def _receive(self, worker: _Worker, seconds: float) -> Any:
        """The worker's next message. Raises WorkerError when that is a traceback or when none comes."""
        readable = wait([worker.messages, worker.process.sentinel], min(seconds, LONGEST_WAIT))
        if worker.messages in readable:
            try:
                message = worker.messages.recv()
            except (EOFError, OSError):  # it has died, be it in the middle of a message
                raise WorkerError(_exit_message(worker)) from None
            if isinstance(message, str):
                raise WorkerError(f"worker {worker.number} raised:\n{message}")
            return message
        if readable:
            raise WorkerError(_exit_message(worker))
        raise WorkerError(f"worker {worker.number} has not answered for {seconds:g} seconds")

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
        raise WorkerError("a worker broke off, but none has died")

    def _check_open(self) -> None:
        super()._check_open()
        if os.getpid() != self._owner:
            raise gym.error.ClosedEnvironmentError(
                f"this environment belongs to process {self._owner}, of which this one is a fork; make a new one"
            )

    def close_extras(self, **kwargs: Any) -> None:
        """Ends the workers and gives the memory back."""
        if self._finalizer is not None:
            _stop_workers(self._workers, self._shared, self._owner)
            self._finalizer.detach()


def _stop_workers(workers: list[_Worker], shared: SharedMemory, owner: int) -> None:
    """Ends the workers and empties their list; in a child forked from their owner, only lets go of them.

    May be interrupted and begun again. A worker of which nothing is known but its connections ends with these.
    """
    started = [worker for worker in workers if os.getpid() == owner and worker.process.pid is not None]
    for worker in started:
        worker.control.ask(worker.control.asked + 1, Command.CLOSE)
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
    return f"worker {worker.number} (environments {worker.first} to {worker.stop - 1}) died {how}"


def _check_room(workers: int, shared: SharedMemory) -> None:
    """Raises WorkerError where this process may not start so many workers."""
    if workers and multiprocessing.current_process().daemon:
        raise WorkerError("a daemonic process may not start workers; use num_workers=1, or gymnasium.make_vec")
    if not shared.has_room_for(workers * DESCRIPTORS):
        raise WorkerError(
            f"{workers} workers take up to {workers * DESCRIPTORS} file descriptors, and this process may not open so"
            " many more; close some, raise the limit (ulimit -n), or use fewer workers"
        )


def _warm_up(settings: Settings) -> None:
    """Steps a few environments, so that forked processes inherit everything imported, loaded and compiled.

    A process forked while another thread imports a module could wait for that module forever.
    """
    few = min(settings.num_envs, FEWEST_COMPILED)
    settings = replace(settings, num_envs=few)
    engine = Engine(settings, Buffers.new(settings.forms()))
    engine.reset(Reset(np.arange(few), [0] * few, [None] * few, everywhere=True))
    engine.step()
    for what in _WRITES:
        engine.write(what)
    engine.states()


def _start_worker(context: Any, assignment: Assignment, workers: int, words: memoryview, listed: list[_Worker]) -> None:
    """Starts a worker. It is added to `listed` first: closing those ends one whose start was interrupted as well."""
    ours, theirs = context.Pipe()
    wake_receiver, wake_pipe = context.Pipe(duplex=False)
    caller_wake_pipe, caller_wake_sender = context.Pipe(duplex=False)
    inherited: list[Connection] = []
    process = context.Process(
        target=_worker_main,
        args=(assignment, workers, theirs, wake_receiver, caller_wake_sender, inherited),
        name=f"lilgym_mp worker {assignment.number}",
        daemon=True,
    )
    control = WorkerControl(words, assignment.number)
    listed.append(
        _Worker(
            assignment.number, assignment.first, assignment.stop, process, control, ours, wake_pipe, caller_wake_pipe
        )
    )
    if context.get_start_method() == "fork":
        inherited += [connection for worker in listed for connection in worker.connections]
    try:
        with _compiler_lock_held(), _interrupts_blocked(context):
            process.start()
    except OSError as fault:
        raise WorkerError(f"worker {assignment.number} cannot be started: {fault}") from fault
    finally:
        inherited.clear()
        for connection in (theirs, wake_receiver, caller_wake_sender):
            connection.close()


def _compiler_lock_held() -> AbstractContextManager[object]:
    """Holds numba's lock, if it is loaded: a process forked while another thread compiles could never compile."""
    module = sys.modules.get("numba.core.compiler_lock")
    return nullcontext() if module is None else module.global_compiler_lock


@contextmanager
def _interrupts_blocked(context: Any) -> Iterator[None]:
    """Blocks SIGINT while a process is started, so that Ctrl-C never reaches it; the caller receives it afterwards."""
    if context.get_start_method() != "fork":  # these servers must not inherit the block
        resource_tracker.ensure_running()
    if context.get_start_method() == "forkserver":
        forkserver.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _part(order: Reset, first: int, stop: int) -> Reset:
    """What of an command concerns environments first .. stop - 1, numbered from 0."""
    low, high = np.searchsorted(order.env_ids, [first, stop]).tolist()
    return Reset(order.env_ids[low:high] - first, order.seeds[low:high], order.tasks[low:high], order.everywhere)


def usable_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def checked_worker_count(num_workers: int | str, num_envs: int) -> int:
    """`num_workers`, or what "auto" stands for. Raises ValueError."""
    if isinstance(num_workers, str) and num_workers == AUTO:
        if multiprocessing.current_process().daemon:  # which may have no children
            return 1
        return max(1, min(usable_cores(), num_envs // ENVS_WORTH_A_PROCESS))
    if isinstance(num_workers, bool) or not isinstance(num_workers, int | np.integer) or num_workers < 1:
        raise ValueError(f"num_workers must be {AUTO!r} or a positive whole number, not {num_workers!r}")
    if num_workers > num_envs:
        raise ValueError(f"{num_workers} workers for {num_envs} environments; choose at most one for each")
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
