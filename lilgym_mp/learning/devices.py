"""The device networks run on."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

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
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
