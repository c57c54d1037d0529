"""Anonymous shared memory for a process and its children: nothing is left behind, however they exit."""

from __future__ import annotations

import mmap
import os
import tempfile
import weakref
from contextlib import suppress
from multiprocessing import reduction
from typing import Any

ZEROS = bytes(1 << 20)  # written at a time
HAS_MEMFD = hasattr(os, "memfd_create")


class SharedMemoryError(MemoryError):
    """There is not enough memory to share; the message names the size."""


class SharedMemory:
    """`size` zero bytes that can be passed to a child process as an argument, with any start method.

    On Linux an anonymous file (memfd), because /dev/shm, where `multiprocessing` has its own, is often small in
    containers; elsewhere an unlinked temporary file. `release()` closes the file; the memory is freed with the last
    array that uses it.
    """

    def __init__(self, size: int, fd: int | None = None) -> None:
        """`fd`: of an existing file. Raises SharedMemoryError if there is not enough memory."""
        self._fd = _anonymous_file(size) if fd is None else fd
        self.release = weakref.finalize(self, os.close, self._fd)
        self.memory = memoryview(mmap.mmap(self._fd, size))

    def __reduce__(self) -> tuple[Any, tuple[Any, int]]:
        return _attached, (reduction.DupFd(self._fd), len(self.memory))  # pyright: ignore[reportAttributeAccessIssue]


def _attached(duplicate: Any, size: int) -> SharedMemory:
    return SharedMemory(size, duplicate.detach())


def _anonymous_file(size: int) -> int:
    """The descriptor of an unlinked file of `size` bytes."""
    megabytes = f"{size / 1e6:,.1f} MB"
    with suppress(AttributeError, ValueError, OSError):  # not every system says how much memory it has
        available = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
        if size > available:
            raise SharedMemoryError(f"cannot share {megabytes}: this machine has {available / 1e6:,.1f} MB of memory")
    try:
        if HAS_MEMFD:
            fd = os.memfd_create("lilgym_mp")
            os.ftruncate(fd, size)
            return fd
        with tempfile.TemporaryFile(buffering=0) as file:
            for start in range(0, size, len(ZEROS)):  # reports a full disk now instead of by a signal later
                file.write(ZEROS[: size - start])
            return os.dup(file.fileno())
    except OSError as fault:
        raise SharedMemoryError(f"cannot create a file of {megabytes} to share: {fault.strerror}") from None
