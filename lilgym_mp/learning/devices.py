"""Which device networks run on."""

from __future__ import annotations

import torch

from lilgym_mp.choices import choose

DEVICES = {name: name for name in ("auto", "cpu", "cuda")}


class DeviceError(ValueError):
    """A device that this machine does not have."""


def chosen_device(name: str) -> torch.device:
    """The device of that name; "auto" is CUDA where there is one. Raises ValueError naming the choices."""
    name = choose("device", name, DEVICES)
    available = torch.cuda.is_available()
    if name == "cuda" and not available:
        raise DeviceError("device cuda was asked for, but PyTorch finds no CUDA device here; choose cpu or auto")
    return torch.device("cuda" if name != "cpu" and available else "cpu")
