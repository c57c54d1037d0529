"""The number of steps left in the episode."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gymnasium import spaces

from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.transformation import Batch, EnvState, Format

STEPS_LEFT = "steps_left"  # observation key


class Countdown(Format):
    """The horizon minus the steps taken."""

    def new_spaces(self) -> Mapping[str, spaces.Space[Any]]:
        return {STEPS_LEFT: spaces.Discrete(self.env_description.dynamics.horizon + 1)}

    def new_values(self, observations: Mapping[str, Batch], state: EnvState) -> Mapping[str, Batch]:
        return {STEPS_LEFT: self.env_description.dynamics.horizon - state.steps}


class StepsLeft(EnvWrapper[Countdown]):
    """Adds "steps_left", 0 .. horizon: a part of the Markov state that observations lack."""

    transformation_class = Countdown
