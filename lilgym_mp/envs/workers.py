"""Environments in several processes that share one block of memory.

The calling process steps the first part of the environments itself, a worker process each other part. An order is
a number in shared memory; who waits for it spins for a moment, then yields, then sleeps until a bell rings. Only
resets, states and faults go through pipes. A worker ends when its caller does, and when nobody holds the other ends
of its pipes any more.
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
NAP_SECONDS = 0.2  # between looks at whether the others live
START_SECONDS = 120.0  # for a worker to import what it needs and load its tasks
GOODBYE_SECONDS = 1.0
LONGEST_WAIT = 1e6  # seconds that the system can be asked to wait
DESCRIPTORS = 12  # a worker takes while it is started; Python loses some when they run out half-way


class WorkerError(RuntimeError):
    """A worker cannot be started, died, hung or raised; names it, with exit code or traceback. The environment is
    closed then."""


class Order(IntEnum):
    RESET = 0
    STEP = 1
    MASK = 2
    GOAL = 3
    ITEMS = 4
    STATES = 5
    TASKS = 6
    CLOSE = 7


COPIED = (Order.RESET, Order.STEP)  # orders after which observations are given out
_WRITES = {"mask": Order.MASK, "goal": Order.GOAL, "items": Order.ITEMS}
_WRITTEN = {order: what for what, order in _WRITES.items()}

_WORDS = ALIGNMENT // 8  # 64-bit words of a cache line
# Held while workers are started, and by whoever forks: no process then begins amid another thread's imports here.
_starting = threading.RLock()
os.register_at_fork(before=_starting.acquire, after_in_parent=_starting.release, after_in_child=_starting.release)


class Post:
    """What one worker and the caller tell each other, each on a cache line of its own."""

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

    def ask(self, count: int, order: Order, page: int = NO_PAGE) -> None:
        self._words[self._asked + 1] = order
        self._words[self._asked + 3] = page
        self._fence()
        self._words[self._asked] = count

    @property
    def asked(self) -> int:
        """How many orders have been given."""
        return self._words[self._asked]

    @property
    def order(self) -> Order:
        return Order(self._words[self._asked + 1])

    @property
    def page(self) -> int:
        """Where the images are to be copied to, or NO_PAGE."""
        return self._words[self._asked + 3]

    def answer(self, count: int) -> None:
        self._fence()
        self._words[self._answered] = count

    @property
    def answered(self) -> int:
        """How many orders have been carried out."""
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
    return workers * Post.LINES * ALIGNMENT


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


def _work(
    assignment: Assignment,
    workers: int,
    messages: Connection,
    bell: Connection,
    caller_bell: Connection,
    inherited: Sequence[Connection],
) -> None:
    """A worker's life: carries out orders until it is told to close or the caller is gone.

    `inherited`: ends of the caller's that came along with the fork.
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
        post = Post(words, assignment.number)
        count = 0
        while _heard(post, count, bell, ends, assignment.spin_seconds):
            count += 1
            order = post.order
            if order is Order.CLOSE:
                break
            _carry_out(engine, order, messages)
            if post.page != NO_PAGE:
                pages[post.page, part] = engine.buffers.image
            post.answer(count)
            if post.is_asleep(worker=False):
                caller_bell.send_bytes(b"!")
    except (BrokenPipeError, ConnectionResetError, EOFError):
        return  # the caller is gone
    except Exception:
        _report(traceback.format_exc(), messages, caller_bell)


def _report(fault: str, messages: Connection, caller_bell: Connection) -> None:
    with suppress(OSError):  # nobody is left to hear it
        messages.send(fault)
        caller_bell.send_bytes(b"!")


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


def _heard(post: Post, count: int, bell: Connection, ends: Sequence[int], spin_seconds: float) -> bool:
    """Waits for the next order; False when the caller is gone, one of whose `ends` can be read then."""

    def asked() -> bool:
        return post.asked > count

    while not _spun(asked, spin_seconds):
        post.set_asleep(worker=True, asleep=True)
        rung = [] if asked() else wait([bell, *ends])
        post.set_asleep(worker=True, asleep=False)
        if bell in rung:
            bell.recv_bytes()
        elif rung:
            return False
    return True


def _carry_out(engine: Engine, order: Order, messages: Connection) -> None:
    if order is Order.STEP:
        engine.step()
    elif order is Order.RESET:
        engine.reset(messages.recv())
    elif order is Order.STATES:
        messages.send(engine.states())
    elif order is Order.TASKS:
        change: TaskOperation = messages.recv()
        engine.play(change(engine.tasks))
    else:
        engine.write(_WRITTEN[order])


@dataclass(frozen=True, eq=False)
class _Worker:
    """A worker as its caller sees it."""

    number: int
    first: int
    stop: int
    process: BaseProcess
    post: Post
    messages: Connection
    bell: Connection  # wakes the worker
    caller_bell: Connection  # wakes the caller

    @property
    def connections(self) -> tuple[Connection, ...]:
        return self.messages, self.bell, self.caller_bell


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
        self._dismissal: weakref.finalize[Any, Any] | None = None  # once there is something to dismiss
        checked = Settings.of(num_envs, **{**gym.spec(id).kwargs, **settings})
        count = checked_worker_count(num_workers, checked.num_envs)
        context = _context(start_method)
        self._timeout = _checked_timeout(timeout_seconds)
        self._count = 0
        pages = PAGES if copy and count > 1 else 0
        size = _control_size(count) + buffers_size(checked.forms()) + _pages_form(checked, pages).size
        self._shared = SharedMemory(size)
        self._dismissal = weakref.finalize(self, _dismiss, self._workers, self._shared, self._owner)
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
                _rehearse(settings)
            self._engine = Engine(settings, self._buffers.part(0, self._own.stop))
            for assignment in assignments:
                _hire(context, assignment, len(assignments) + 1, words, self._workers)
        for worker in self._workers:
            self._hear(worker, START_SECONDS)

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
        self._everywhere(Order.RESET, own_part, payloads)

    def _step(self) -> None:
        self._page = self._free_page()
        self._everywhere(Order.STEP, self._own_step)

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
        self._everywhere(_WRITES[what], lambda: self._engine.write(what))

    def _states(self) -> list[State]:
        states: list[State] = []

        def collect() -> None:
            states.extend(self._engine.states())
            for worker in self._workers:
                states.extend(self._hear(worker, self._timeout))

        self._everywhere(Order.STATES, collect)
        return states

    def _change_tasks(self, change: TaskOperation) -> None:
        self._everywhere(Order.TASKS, lambda: self._engine.play(self.tasks), [change] * len(self._workers))

    def _everywhere(self, order: Order, own_part: Callable[[], None], payloads: Sequence[object] = ()) -> None:
        """Has an order carried out in every process. Whatever goes wrong, no worker is left behind."""
        self._check_open()
        try:
            self._give(order, payloads)
            own_part()
            for worker in self._workers:
                self._await(worker)
        except BaseException:
            self.close()
            raise

    def _give(self, order: Order, payloads: Sequence[object]) -> None:
        self._count += 1
        try:
            for worker, payload in zip(self._workers, payloads, strict=False):
                worker.messages.send(payload)
            for worker in self._workers:
                worker.post.ask(self._count, order, self._page if order in COPIED else NO_PAGE)
                if worker.post.is_asleep(worker=True):
                    worker.bell.send_bytes(b"!")
        except OSError:  # nobody hears it
            self._lament()

    def _await(self, worker: _Worker) -> None:
        """Returns when the worker has carried out the last order. Raises WorkerError when it will not."""
        post, count = worker.post, self._count

        def answered() -> bool:
            return post.answered >= count

        if _spun(answered, self._spin_seconds):
            return
        end = perf_counter() + self._timeout
        while not answered():
            post.set_asleep(worker=False, asleep=True)
            if not answered():
                self._nap(worker)
            post.set_asleep(worker=False, asleep=False)
            if perf_counter() > end and not answered():
                raise WorkerError(f"worker {worker.number} has not answered for {self._timeout:g} seconds")

    def _nap(self, worker: _Worker) -> None:
        """Sleeps until the worker rings, for a moment at most. Raises WorkerError when it has raised or died."""
        rung = wait([worker.caller_bell, worker.messages, worker.process.sentinel], NAP_SECONDS)
        if worker.caller_bell in rung:
            try:
                worker.caller_bell.recv_bytes()
            except (EOFError, OSError):
                self._lament()
        if worker.messages in rung or worker.process.sentinel in rung:
            self._lament()

    def _hear(self, worker: _Worker, seconds: float) -> Any:
        """The worker's next message. Raises WorkerError when that is a fault or none comes."""
        rung = wait([worker.messages, worker.process.sentinel], min(seconds, LONGEST_WAIT))
        if worker.messages in rung:
            try:
                message = worker.messages.recv()
            except (EOFError, OSError):  # it has died, be it in the middle of a message
                raise WorkerError(_death(worker)) from None
            if isinstance(message, str):
                raise WorkerError(f"worker {worker.number} raised:\n{message}")
            return message
        if rung:
            raise WorkerError(_death(worker))
        raise WorkerError(f"worker {worker.number} has not answered for {seconds:g} seconds")

    def _lament(self) -> NoReturn:
        """Raises WorkerError for the worker that raised or died."""
        end = perf_counter() + GOODBYE_SECONDS
        while perf_counter() < end:
            for worker in self._workers:
                with suppress(OSError):
                    while worker.messages.poll():
                        self._hear(worker, 0)
                if not worker.process.is_alive():
                    raise WorkerError(_death(worker))
        raise WorkerError("a worker broke off, but none has died")

    def _check_open(self) -> None:
        super()._check_open()
        if os.getpid() != self._owner:
            raise gym.error.ClosedEnvironmentError(
                f"this environment belongs to process {self._owner}, of which this one is a fork; make a new one"
            )

    def close_extras(self, **kwargs: Any) -> None:
        """Ends the workers and gives the memory back."""
        if self._dismissal is not None:
            _dismiss(self._workers, self._shared, self._owner)
            self._dismissal.detach()


def _dismiss(workers: list[_Worker], shared: SharedMemory, owner: int) -> None:
    """Ends the workers and empties their list; in a child forked from their owner, only lets go of them.

    May be interrupted and begun again. A worker of which nothing is known but its connections ends with these.
    """
    started = [worker for worker in workers if os.getpid() == owner and worker.process.pid is not None]
    for worker in started:
        worker.post.ask(worker.post.asked + 1, Order.CLOSE)
        with suppress(OSError):  # it has ended already
            worker.bell.send_bytes(b"!")
    end = perf_counter() + GOODBYE_SECONDS
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


def _death(worker: _Worker) -> str:
    worker.process.join(GOODBYE_SECONDS)
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


def _rehearse(settings: Settings) -> None:
    """Plays a few environments, so that what they import, load and compile is there for processes forked from this.

    Such a process could wait for ever for a module that another thread was importing when it was forked.
    """
    few = min(settings.num_envs, FEWEST_COMPILED)
    settings = replace(settings, num_envs=few)
    engine = Engine(settings, Buffers.new(settings.forms()))
    engine.reset(Reset(np.arange(few), [0] * few, [None] * few, everywhere=True))
    engine.step()
    for what in _WRITES:
        engine.write(what)
    engine.states()


def _hire(context: Any, assignment: Assignment, workers: int, words: memoryview, listed: list[_Worker]) -> None:
    """Starts a worker, listed before it is: whenever this is interrupted, who closes the listed ends it."""
    ours, theirs = context.Pipe()
    bell_heard, bell = context.Pipe(duplex=False)
    caller_bell, caller_bell_rung = context.Pipe(duplex=False)
    inherited: list[Connection] = []
    process = context.Process(
        target=_work,
        args=(assignment, workers, theirs, bell_heard, caller_bell_rung, inherited),
        name=f"lilgym_mp worker {assignment.number}",
        daemon=True,
    )
    post = Post(words, assignment.number)
    listed.append(_Worker(assignment.number, assignment.first, assignment.stop, process, post, ours, bell, caller_bell))
    if context.get_start_method() == "fork":
        inherited += [connection for worker in listed for connection in worker.connections]
    try:
        with _compiler_at_rest(), _deaf_to_interrupts(context):
            process.start()
    except OSError as fault:
        raise WorkerError(f"worker {assignment.number} cannot be started: {fault}") from fault
    finally:
        inherited.clear()
        for connection in (theirs, bell_heard, caller_bell_rung):
            connection.close()


def _compiler_at_rest() -> AbstractContextManager[object]:
    """Holds numba's lock, if it is loaded: a process forked while another thread compiles could never compile."""
    module = sys.modules.get("numba.core.compiler_lock")
    return nullcontext() if module is None else module.global_compiler_lock


@contextmanager
def _deaf_to_interrupts(context: Any) -> Iterator[None]:
    """Keeps Ctrl-C from a process that is started here, from its first moment on; the caller hears it afterwards."""
    if context.get_start_method() != "fork":  # these are started first, or would be deaf for good, and lift the block
        resource_tracker.ensure_running()
    if context.get_start_method() == "forkserver":
        forkserver.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _part(order: Reset, first: int, stop: int) -> Reset:
    """What of an order concerns environments first .. stop - 1, numbered from 0."""
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
