"""The device networks run on."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager

import torch

from lilgym_mp.choices import choose

DEVICES = {name: name for name in ("auto", "cpu", "cuda")}


class DeviceError(ValueError):
    """A device this machine does not have."""


def select_device(name: str) -> torch.device:
    """The device of that name; "auto" is CUDA if available, else the CPU. Raises ValueError naming the choices."""
    name = choose("device", name, DEVICES)
    available = torch.cuda.is_available()
    if name == "cuda" and not available:
        raise DeviceError("device cuda was requested, but PyTorch finds no CUDA device here; choose cpu or auto")
    return torch.device("cuda" if name != "cpu" and available else "cpu")


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Within the block torch uses `count` threads."""
    before = torch.get_num_threads()
    if before != count:
        torch.set_num_threads(count)
    try:
        yield
    finally:
        if before != count:
            torch.set_num_threads(before)


def single_thread() -> AbstractContextManager[None]:
    """Limits torch to one thread; networks as small as the parser's run slower on several."""
    return torch_threads(1)
