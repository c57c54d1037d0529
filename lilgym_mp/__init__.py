"""Natural-language visual reasoning with reinforcement learning: one fast core, many environments."""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lilgym_mp.learning.common.agents import Agent

__all__ = ["action_masks", "load_agent"]
__version__ = "0.1.0"

# In a checkout `wrappers` and `data` lie beside the package, not in it (pyproject.toml: package-dir).
if not Path(__file__).with_name("wrappers").is_dir():
    __path__.append(str(Path(__file__).resolve().parents[1]))

from lilgym_mp.envs.masks import action_masks
from lilgym_mp.envs.registration import register_all
from lilgym_mp.scene.choices import load_extensions

register_all()


class _Package(ModuleType):
    """A package whose modules are imported on first use, such as `lilgym_mp.envs.workers` after `import lilgym_mp`."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or find_spec(f"{self.__name__}.{name}") is None:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        return import_module(f"{self.__name__}.{name}")

    def __setattr__(self, name: str, value: Any) -> None:
        """Python calls this with each module of the package that it has imported."""
        super().__setattr__(name, value)
        if isinstance(value, ModuleType) and hasattr(value, "__path__") and value.__name__ == f"{self.__name__}.{name}":
            _import_lazily(value)


def _import_lazily(package: ModuleType) -> None:
    """Makes a package, and those of its packages that have been imported, a `_Package`."""
    package.__class__ = _Package
    for name, part in list(vars(package).items()):
        setattr(package, name, part)


_import_lazily(sys.modules[__name__])


def load_agent(name: str, device: str = "auto") -> Agent:
    """A trained agent that comes with the package, such as "parse-and-plan"; needs the extra `train`.

    `agent.policy(Settings("TowerFlipIt"))` plays; `device`: auto, cpu or cuda. Raises ValueError naming the choices.
    """
    from lilgym_mp.learning.common import agents

    return agents.load_agent(name, device)


# Gymnasium refuses unknown ids without asking this package, so what other packages register must be there by now.
load_extensions()
