"""The adapter of `lilgym_mp.contrib.adapters.reasoning_gym`, under its old name."""

from lilgym_mp.contrib.adapters.reasoning_gym import LilgymConfig, LilgymCurriculum, LilgymDataset

__all__ = ["LilgymConfig", "LilgymCurriculum", "LilgymDataset"]
