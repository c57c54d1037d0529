"""The adapter of `lilgym_mp.contrib.adapters.balrog`, under its old name."""

from lilgym_mp.contrib.adapters.balrog import BalrogEnv

__all__ = ["BalrogEnv"]
