"""Anonymous shared memory for a process and its children: nothing is left behind, however they exit."""

from __future__ import annotations

import mmap
import os
import tempfile
from contextlib import suppress
from multiprocessing import reduction
from typing import Any

ZEROS = bytes(1 << 20)  # written at a time


class SharedMemoryError(MemoryError):
    """There is not enough memory to share; the message names the size."""


class SharedMemory:
    """`size` zero bytes that can be passed to a child process as an argument, with any start method.

    On Linux an anonymous file (memfd) rather than /dev/shm, which is often small in containers; elsewhere an unlinked
    temporary file.
    """

    _fd = -1

    def __init__(self, size: int, fd: int | None = None) -> None:
        """`fd`: of an existing file. Raises SharedMemoryError if there is not enough memory."""
        self._fd = _anonymous_file(size) if fd is None else fd
        self._size = size
        self.memory = memoryview(mmap.mmap(self._fd, size))

    def __reduce__(self) -> tuple[Any, tuple[Any, int]]:
        return _attached, (reduction.DupFd(self._fd), self._size)  # pyright: ignore[reportAttributeAccessIssue]

    def release(self) -> None:
        """Closes the file; the memory is freed with the last array that uses it."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1

    def __del__(self) -> None:
        self.release()


def _anonymous_file(size: int) -> int:
    """The descriptor of an unlinked file of `size` bytes."""
    with suppress(AttributeError, ValueError, OSError):  # not every system says how much memory it has
        available = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
        if size > available:
            raise SharedMemoryError(
                f"cannot share {_megabytes(size)}: this machine has {_megabytes(available)} of memory"
            )
    try:
        if hasattr(os, "memfd_create"):
            fd = os.memfd_create("lilgym_mp", os.MFD_CLOEXEC)
        else:
            with tempfile.TemporaryFile(buffering=0) as file:
                for start in range(0, size, len(ZEROS)):  # reports a full disk now instead of by a signal later
                    file.write(ZEROS[: size - start])
                fd = os.dup(file.fileno())
    except OSError as fault:
        raise SharedMemoryError(f"cannot create a file of {_megabytes(size)} to share: {fault.strerror}") from None
    try:
        os.ftruncate(fd, size)
    except OSError as fault:
        os.close(fd)
        raise SharedMemoryError(f"no space for {_megabytes(size)} to share: {fault.strerror}") from None
    return fd


def _megabytes(size: int) -> str:
    return f"{size / 1e6:,.1f} MB"


def _attached(duplicate: Any, size: int) -> SharedMemory:
    return SharedMemory(size, duplicate.detach())
