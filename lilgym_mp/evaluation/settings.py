"""The settings that identify an environment, except its split."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, cast

import gymnasium as gym
from gymnasium.vector import AutoresetMode

from lilgym_mp.envs.batched import BatchedEnv
from lilgym_mp.envs.registration import CONFIGURATIONS, environment_id
from lilgym_mp.envs.rules import Dynamics, make_dynamics
from lilgym_mp.envs.single import LilGymEnv
from lilgym_mp.scene.appearances import RELEASED_GRID, make_appearance
from lilgym_mp.scene.choices import choose


@dataclass(frozen=True, slots=True)
class Settings:
    """The arguments of `gymnasium.make` for training and evaluation; as JSON, part of a run's identity."""

    configuration: str
    corpus: str = "builtin"
    rules: str = "paper"
    horizon: int | None = None
    grid: tuple[int, int] | str = RELEASED_GRID

    def __post_init__(self) -> None:
        """Raises ValueError naming the choices for an unknown configuration; `make` checks the rest."""
        choose("configuration", self.configuration, CONFIGURATIONS)

    @property
    def appearance(self) -> str:
        return CONFIGURATIONS[self.configuration][0]

    @property
    def start(self) -> str:
        return CONFIGURATIONS[self.configuration][1]

    @property
    def id(self) -> str:
        """The Gymnasium id, such as "lilgym_mp/TowerScratch-v0"."""
        return environment_id(self.appearance, self.start)

    def dynamics(self) -> Dynamics:
        """The MDP's rules, without its tasks. Raises ValueError naming the value and the choices."""
        return make_dynamics(make_appearance(self.appearance, self.grid), self.rules, self.horizon)

    def arguments(self, split: str) -> dict[str, Any]:
        """The keyword arguments of `gymnasium.make`."""
        return {**{name: value for name, value in asdict(self).items() if name != "configuration"}, "split": split}

    def make(self, split: str) -> LilGymEnv:
        """A new environment, without Gymnasium's own wrappers.

        Raises ValueError naming the value and the choices, CorpusError for unusable data.
        """
        env = gym.make(self.id, disable_env_checker=True, **self.arguments(split))
        return cast("LilGymEnv", env.unwrapped)

    def make_batch(self, split: str, num_envs: int) -> BatchedEnv:
        """Batched environments without autoreset, whose images are valid until the next step.

        Raises as `make` does.
        """
        return cast(
            "BatchedEnv",
            gym.make_vec(
                self.id, num_envs=num_envs, copy=False, autoreset_mode=AutoresetMode.DISABLED, **self.arguments(split)
            ),
        )

    def to_json(self) -> dict[str, Any]:
        grid = self.grid if isinstance(self.grid, str) else list(self.grid)
        return {**asdict(self), "grid": grid}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Settings:
        """Inverse of `to_json`. Raises ValueError, TypeError or KeyError for unknown or missing keys, or types."""
        for name in ("configuration", "corpus", "rules"):
            if not isinstance(data.get(name, ""), str):
                raise ValueError(f"{name} must be a string, not {data[name]!r:.80}")
        if not isinstance(data.get("horizon"), int | None):
            raise ValueError(f"horizon must be a whole number or null, not {data['horizon']!r:.80}")
        grid = data["grid"]
        return cls(**{**data, "grid": grid if isinstance(grid, str) else tuple(grid)})
