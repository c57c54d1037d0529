"""The environment `lilgym` of verifiers, which finds it by this name."""

from lilgym_mp.contrib.adapters.verifiers import LilgymEnv, LilgymTaskset

__all__ = ["LilgymEnv", "LilgymTaskset"]
