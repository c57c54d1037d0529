"""How many actions the episode still allows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
from gymnasium import spaces

from lilgym_mp.wrappers.factory import factory
from lilgym_mp.wrappers.gymnasium_lift import EnvWrapper
from lilgym_mp.wrappers.moment import Moment, World
from lilgym_mp.wrappers.transformation import Batch, Format

STEPS_LEFT = "steps_left"  # the observation's part


class Countdown(Format):
    """The horizon less the actions taken."""

    def __init__(self, world: World) -> None:
        super().__init__(world)
        world.parts()

    def new_spaces(self) -> Mapping[str, spaces.Space[Any]]:
        return {STEPS_LEFT: spaces.Discrete(self.world.dynamics.horizon + 1)}

    def new_values(self, observations: Mapping[str, Batch], moment: Moment) -> Mapping[str, Batch]:
        return {STEPS_LEFT: self.world.dynamics.horizon - moment.steps}


class StepsLeft(EnvWrapper[Countdown]):
    """Adds "steps_left": the actions left before the horizon, 0 .. horizon. The MDP's state includes it."""

    does = Countdown

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)


steps_left_v0 = factory(StepsLeft)
