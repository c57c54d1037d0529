"""Cores step a batch of environments over the arrays of `Buffers`.

`scalar.ScalarCore` applies `rules` to one scene after another, for any appearance. `TowerCore` and `ScatterCore` are
compiled with numba. Each is imported, and numba with the compiled ones, when a batch first needs it.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from functools import cache
from pkgutil import resolve_name

from lilgym_mp.envs.buffers import Buffers
from lilgym_mp.envs.cores.base import Core
from lilgym_mp.envs.rules import Dynamics
from lilgym_mp.programs.task import Task
from lilgym_mp.submodules import submodule_getter

__all__ = ["FEWEST_COMPILED", "Core", "make_core"]

FEWEST_COMPILED = 8  # environments; for fewer, calling compiled code costs more than it saves
SCALAR = "lilgym_mp.envs.cores.scalar:ScalarCore"
COMPILED = {  # by the appearance's name
    "tower": "lilgym_mp.envs.cores.tower:TowerCore",
    "scatter": "lilgym_mp.envs.cores.scatter:ScatterCore",
}


def make_core(dynamics: Dynamics, tasks: Sequence[Task], buffers: Buffers, image_size: str) -> Core:
    """The fastest core for the appearance and the number of environments."""
    compiled = _compiled(dynamics.appearance.name) if len(buffers.action) >= FEWEST_COMPILED else None
    return (compiled or resolve_name(SCALAR))(dynamics, tasks, buffers, image_size)


@cache
def _compiled(appearance: str) -> Callable[[Dynamics, Sequence[Task], Buffers, str], Core] | None:
    """The compiled core of an appearance; None if it has none or, with a warning, if numba cannot be imported."""
    name = COMPILED.get(appearance)
    try:
        return None if name is None else resolve_name(name)
    except ImportError as fault:
        message = f"batches run several times slower because numba cannot be imported: {fault}"
        warnings.warn(message, RuntimeWarning, stacklevel=2)
        return None


__getattr__ = submodule_getter(__name__)
