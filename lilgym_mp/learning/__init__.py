"""Policies, models and training loops; torch only from here on."""

from lilgym_mp.submodules import submodule_getter

__getattr__ = submodule_getter(__name__)
