"""Proximal policy optimisation from rewards, with the paper's stop forcing (PPO+SF).

By default programs are read too, to exchange colours; without `recolour` it learns from rewards alone.
"""

from lilgym_mp.submodules import submodule_getter

__getattr__ = submodule_getter(__name__)
