"""The former home of `EnvConfig`."""

from lilgym_mp.envs.config import EnvConfig as Settings
from lilgym_mp.envs.registration import CONFIGURATIONS

__all__ = ["CONFIGURATIONS", "Settings"]
