"""A reward model of statements, learnt from the outcomes of STOPs, and search for scenes where it is sure."""

from lilgym_mp.submodules import submodule_getter

__getattr__ = submodule_getter(__name__)
