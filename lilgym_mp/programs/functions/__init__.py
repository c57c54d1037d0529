"""The words of the language, one decorated function each. Importing this package registers them all."""

from lilgym_mp.programs.functions import attributes, collections, items, logic, relations
from lilgym_mp.submodules import submodule_getter

__all__ = ["attributes", "collections", "items", "logic", "relations"]

__getattr__ = submodule_getter(__name__)
