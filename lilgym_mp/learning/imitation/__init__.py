"""Imitation of sets of optimal actions by one network, from images and words. docs/imitation.md describes it."""

from lilgym_mp.submodules import submodule_getter

__getattr__ = submodule_getter(__name__)
