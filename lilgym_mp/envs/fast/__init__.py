"""Generated code for programs, which makes the core fast. The core plays without it."""

from lilgym_mp.submodules import submodule_getter

__getattr__ = submodule_getter(__name__)
