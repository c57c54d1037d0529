"""Natural-language visual reasoning with reinforcement learning: one fast core, many environments."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lilgym_mp.learning.common.agents import Agent

# A checkout has `wrappers` and `data` beside the package; installing it links them (scripts/build_backend.py).
if not Path(__file__).with_name("wrappers").is_dir():
    checkout = Path(__file__).resolve().parents[1]
    raise ImportError(
        f"lilgym_mp is not installed from the checkout {checkout}: run `pip install -e .` or `make install` there"
        " (or start Python in another directory, to use an installed copy)"
    )

from lilgym_mp.envs.masks import action_masks
from lilgym_mp.envs.registration import register_all
from lilgym_mp.scene.choices import load_extensions
from lilgym_mp.submodules import submodule_getter

__all__ = ["action_masks", "load_agent"]
__version__ = "0.1.0"

PUBLIC_MODULES = (
    "contrib",
    "corpus",
    "envs",
    "evaluation",
    "learning",
    "perception",
    "programs",
    "sb3",
    "scene",
    "solver",
    "testing",
    "wrappers",
)

register_all()
__getattr__ = submodule_getter(__name__)


def __dir__() -> list[str]:
    return sorted([*__all__, *PUBLIC_MODULES, "__version__"])


def load_agent(name: str, device: str = "auto") -> Agent:
    """A trained agent that comes with the package; needs the extra `train`.

    `agent.policy(Settings("TowerFlipIt"))`, with `Settings` of `lilgym_mp.evaluation`, gives its policy.

    Args:
        name: The agent's name, such as "parse-and-plan".
        device: "auto", "cpu" or "cuda".

    Returns:
        The agent, with its network on the device.

    Raises:
        ValueError: For an unknown agent or device; the message names the choices.
        ModuleNotFoundError: Without torch; the message says how to install it.
    """
    try:
        from lilgym_mp.learning.common import agents
    except ModuleNotFoundError as error:
        from lilgym_mp.corpus.extras import install

        raise ModuleNotFoundError(f"load_agent needs {error.name}: {install('train')}", name=error.name) from None

    return agents.load_agent(name, device)


# Gymnasium refuses unknown ids without asking this package, so what other packages register must be there by now.
load_extensions()
