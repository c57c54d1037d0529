"""Parse and plan: a small learned parser from statements to programs, and plans for its likely programs."""

from lilgym_mp.submodules import submodule_getter

__getattr__ = submodule_getter(__name__)
