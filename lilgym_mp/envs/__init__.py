"""Environments over one core: single, batched, workers, and two agents sharing one MDP."""

from lilgym_mp.submodules import submodule_getter

__getattr__ = submodule_getter(__name__)
