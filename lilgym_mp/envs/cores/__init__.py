"""Cores step a batch of environments over the arrays of `Buffers`.

`ScalarCore` applies `rules` to one scene after another, for any appearance. `TowerCore` and `ScatterCore` are compiled
with numba; they are imported, and numba with them, when a batch first needs them.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib import import_module

from lilgym_mp.envs.buffers import Buffers
from lilgym_mp.envs.cores.base import Core
from lilgym_mp.envs.cores.scalar import ScalarCore
from lilgym_mp.envs.rules import Dynamics
from lilgym_mp.programs.task import Task
from lilgym_mp.scene.appearances import Appearance, Scatter, Tower

__all__ = ["FEWEST_COMPILED", "Core", "ScalarCore", "make_core"]

FEWEST_COMPILED = 8  # environments; for fewer, calling compiled code costs more than it saves
# module and class by appearance
_COMPILED: Mapping[type[Appearance], tuple[str, str]] = {
    Tower: ("lilgym_mp.envs.cores.tower", "TowerCore"),
    Scatter: ("lilgym_mp.envs.cores.scatter", "ScatterCore"),
}


def make_core(dynamics: Dynamics, tasks: Sequence[Task], buffers: Buffers, image_size: str) -> Core:
    """The fastest core for the appearance and the number of environments."""
    appearance = type(dynamics.appearance)
    compiled = _compiled(appearance) if len(buffers.action) >= FEWEST_COMPILED else None
    return (compiled or ScalarCore)(dynamics, tasks, buffers, image_size)


@cache
def _compiled(appearance: type[Appearance]) -> Callable[[Dynamics, Sequence[Task], Buffers, str], Core] | None:
    """The compiled core of an appearance; None if it has none or, with a warning, if numba cannot be imported."""
    if appearance not in _COMPILED:
        return None
    module, name = _COMPILED[appearance]
    try:
        return getattr(import_module(module), name)
    except ImportError as fault:
        message = f"batches run several times slower because numba cannot be imported: {fault}"
        warnings.warn(message, RuntimeWarning, stacklevel=2)
        return None
