"""How many processes step a batch, and how they are started."""

from __future__ import annotations

import multiprocessing
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from multiprocessing import reduction
from numbers import Real
from typing import Any

import numpy as np

from lilgym_mp.envs.machine import start_method_kept, usable_cores
from lilgym_mp.scene.choices import choose

AUTO = "auto"
MIN_ENVS_PER_PROCESS = 64  # fewest environments per process with "auto"
HAS_POSIX = hasattr(reduction, "DupFd") and hasattr(signal, "pthread_sigmask")


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


def checked_timeout(seconds: float) -> float:
    """`timeout_seconds` as a float. Raises ValueError."""
    if isinstance(seconds, bool) or not isinstance(seconds, Real) or not seconds > 0:
        raise ValueError(f"timeout_seconds must be a positive number, not {seconds!r}")
    return float(seconds)


def process_context(start_method: str | None) -> Any:
    """The context of a start method, None for Python's default. Raises ValueError naming the choices."""
    if start_method is None:  # Python's default, which `get_context()` would fix for the whole process
        start_method = multiprocessing.get_start_method(allow_none=True) or multiprocessing.get_all_start_methods()[0]
    methods = {method: method for method in multiprocessing.get_all_start_methods()}
    return multiprocessing.get_context(choose("start_method", start_method, methods))


def why_no_processes() -> str | None:
    """Why this process cannot start processes that share memory, None if it can."""
    if not HAS_POSIX:
        return "workers need Linux or macOS"
    if multiprocessing.current_process().daemon:
        return "a daemonic process cannot start workers"
    return None


@contextmanager
def start_protected(context: Any) -> Iterator[None]:
    """Blocks SIGINT while a process starts, so that Ctrl-C never reaches it; this one receives it afterwards.

    Holds numba's lock, if numba is loaded: a process forked while another thread compiles could never compile.
    """
    compiler = sys.modules.get("numba.core.compiler_lock")
    with start_method_kept(), nullcontext() if compiler is None else compiler.global_compiler_lock:
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
