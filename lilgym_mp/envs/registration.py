"""The configurations, each an appearance with a kind of start, as Gymnasium ids."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NoReturn

import gymnasium as gym

from lilgym_mp.scene.appearances import APPEARANCES
from lilgym_mp.scene.choices import choose

START_TITLES = {"scratch": "Scratch", "flipit": "FlipIt"}


def configuration_name(appearance: str, start: str) -> str:
    """Such as "TowerFlipIt"."""
    return f"{appearance.capitalize()}{START_TITLES[start]}"


CONFIGURATIONS: Mapping[str, tuple[str, str]] = {  # by name: appearance and start
    configuration_name(appearance, start): (appearance, start) for appearance in APPEARANCES for start in START_TITLES
}


def read_configuration(name: str) -> tuple[str, str]:
    """Appearance and start of a configuration, by its name or Gymnasium id. Raises ValueError naming the choices."""
    return choose("configuration", name.removeprefix("lilgym_mp/").removesuffix("-v0"), CONFIGURATIONS)


def environment_id(appearance: str, start: str) -> str:
    """The Gymnasium id, such as "lilgym_mp/TowerFlipIt-v0"."""
    return f"lilgym_mp/{configuration_name(appearance, start)}-v0"


def refuse_old_id(new_id: str, **_: Any) -> NoReturn:
    """Raises NameNotFound naming the id that replaces one of the release."""
    raise gym.error.NameNotFound(f"this environment's id is {new_id!r}; the ids of the release are not used")


def register_all() -> None:
    """Makes every configuration known to `gymnasium.make`, and the new id of each of the release's; does nothing the
    second time."""
    for appearance in APPEARANCES:
        for start in START_TITLES:
            name = environment_id(appearance, start)
            if name not in gym.registry:
                gym.register(
                    id=name,
                    entry_point="lilgym_mp.envs.single:LilGymEnv",
                    vector_entry_point="lilgym_mp.envs.batched:BatchedEnv",
                    kwargs={"appearance": appearance, "start": start},
                    # Gymnasium's wrappers would take a twelfth of a Tower step. The environment itself raises
                    # ResetNeeded, and its tests run Gymnasium's checker, which `gym.make` can also enable.
                    order_enforce=False,
                    disable_env_checker=True,
                )
                refuse = f"{__name__}:refuse_old_id"
                old_id = f"{configuration_name(appearance, start)}-v0"
                gym.register(old_id, refuse, vector_entry_point=refuse, kwargs={"new_id": name})
