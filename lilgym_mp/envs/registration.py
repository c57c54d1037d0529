"""The configurations, each an appearance with a kind of start, as Gymnasium ids."""

from __future__ import annotations

from itertools import product

import gymnasium as gym

from lilgym_mp.scene.appearances import APPEARANCES, Builder
from lilgym_mp.scene.choices import choose, register

START_TITLES = {"scratch": "Scratch", "flipit": "FlipIt"}


def configuration_name(appearance: str = "tower", start: str = "scratch") -> str:
    """Such as "TowerFlipIt". Raises ValueError naming the choices."""
    choose("appearance", appearance, APPEARANCES)
    return f"{appearance.capitalize()}{choose('start', start, START_TITLES)}"


# Appearance and start of every configuration, by its name; with those of registered appearances
CONFIGURATIONS = {configuration_name(*parts): parts for parts in product(APPEARANCES, START_TITLES)}
BUILTIN_CONFIGURATIONS = tuple(CONFIGURATIONS)  # of the package's own appearances


def read_configuration(name: str) -> tuple[str, str]:
    """Appearance and start of a configuration, by its name or Gymnasium id. Raises ValueError naming the choices."""
    bare = name
    if isinstance(name, str):
        bare = name.removeprefix("lilgym_mp:").removeprefix("lilgym_mp/").removesuffix("-v0")
    return choose("configuration", bare, CONFIGURATIONS)


def environment_id(appearance: str, start: str) -> str:
    """The Gymnasium id, such as "lilgym_mp/TowerFlipIt-v0"."""
    return f"lilgym_mp/{configuration_name(appearance, start)}-v0"


def register_appearance(name: str, build: str | Builder) -> None:
    """Adds an appearance, its configurations and their Gymnasium ids.

    `build`: a function of the grid that returns an Appearance, or "module:function", imported when first used.
    Raises ValueError for a name that is taken.
    """
    register("appearance", name, build, APPEARANCES)
    CONFIGURATIONS.update({configuration_name(name, start): (name, start) for start in START_TITLES})
    register_all()


def register_all() -> None:
    """Makes every configuration known to `gymnasium.make`, and the new id of each of the release's; does nothing the
    second time."""
    for configuration, parts in CONFIGURATIONS.items():
        name = environment_id(*parts)
        if name not in gym.registry:
            gym.register(
                id=name,
                entry_point="lilgym_mp.envs.single:LilGymEnv",
                vector_entry_point="lilgym_mp.envs.batched:BatchedEnv",
                kwargs={"configuration": configuration},
                # Gymnasium's wrappers would take a twelfth of a Tower step. The environment itself raises
                # ResetNeeded, and its tests run Gymnasium's checker, which `gym.make` can also enable.
                order_enforce=False,
                disable_env_checker=True,
            )
            refuse = "lilgym_mp.envs.keywords:refuse_old_id"
            gym.register(f"{configuration}-v0", refuse, vector_entry_point=refuse, kwargs={"new_id": name})
