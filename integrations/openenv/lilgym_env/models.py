"""The adapter of `lilgym_mp.contrib.adapters.openenv`, under its old name."""

from lilgym_mp.contrib.adapters.openenv import LilgymAction, LilgymObservation

__all__ = ["LilgymAction", "LilgymObservation"]
