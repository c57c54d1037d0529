"""Wrappers around the environments, installed as `lilgym_mp.wrappers`: one file each."""

from lilgym_mp.wrappers.action_mask import ActionMask
from lilgym_mp.wrappers.moment import WrongEnvironment
from lilgym_mp.wrappers.stop_forcing import StopForcing
from lilgym_mp.wrappers.tokens import TokenizedStatement

__all__ = ["ActionMask", "StopForcing", "TokenizedStatement", "WrongEnvironment"]
