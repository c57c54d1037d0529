"""Access to a package's modules as attributes, such as `lilgym_mp.envs.workers` after `import lilgym_mp`."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType


def submodule_getter(package: str) -> Callable[[str], ModuleType]:
    """The function `__getattr__` of a package, which imports the package's modules when they are first used.

    Args:
        package: The package's full name, its `__name__`.

    Returns:
        A function from the name of a module to the module. It raises AttributeError if there is no such module.
    """

    def get(name: str) -> ModuleType:
        full_name = f"{package}.{name}"
        if name.startswith("_") or find_spec(full_name) is None:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return import_module(full_name)

    return get
