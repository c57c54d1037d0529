"""Environments over one core: single, batched, workers, and two agents sharing one MDP."""

from __future__ import annotations

from collections.abc import Callable

from lilgym_mp.programs.compiler import register_generator
from lilgym_mp.programs.syntax import Node
from lilgym_mp.scene import Scene
from lilgym_mp.submodules import submodule_getter


def _generate_function(tree: Node) -> Callable[[Scene], bool] | None:
    """Imported when a program is evaluated often, because the core plays without it."""
    from lilgym_mp.envs.fast.code_generation import generate_function

    return generate_function(tree)


register_generator(_generate_function)

__getattr__ = submodule_getter(__name__)
