"""Actions by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces

from lilgym_mp.actions import ActionError, describe, named
from lilgym_mp.appearances import Appearance
from lilgym_mp.arrays import BoolArray
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.transformation import Batch, EnvDescription, EnvState, Transformation


class ActionNames(spaces.Space[str]):
    """The names of an appearance's actions, such as "ADD(LEFT, BLUE)"."""

    def __init__(self, appearance: Appearance, seed: int | np.random.Generator | None = None) -> None:
        super().__init__(shape=None, dtype=None, seed=seed)
        self.appearance = appearance

    def sample(self, mask: Any | None = None, probability: Any | None = None) -> str:
        """The name of a random action; `mask` and `probability` as for `Discrete`, by action index."""
        indices = spaces.Discrete(self.appearance.action_count, seed=self.np_random)
        return describe(self.appearance.decode(int(indices.sample(mask, probability))))

    def contains(self, x: Any) -> bool:
        try:
            return isinstance(x, str) and self.index(x) >= 0
        except ActionError:
            return False

    def index(self, name: str) -> int:
        """The index of the action called `name`. Raises ActionError."""
        if not isinstance(name, str):
            raise ActionError(f"an action must be given by name, not {name!r}")
        return self.appearance.encode(named(name))

    @property
    def is_np_flattenable(self) -> bool:
        return False

    def __repr__(self) -> str:
        return f"ActionNames({self.appearance!r})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ActionNames) and self.appearance == other.appearance

    __hash__ = None  # pyright: ignore[reportAssignmentType]  # as for other spaces


class NameDecoding(Transformation):
    """Decodes action names to action indices."""

    changes_actions = True
    uses_mdp_actions = True

    def __init__(self, description: EnvDescription) -> None:
        super().__init__(description)
        description.require_discrete_actions()
        self._space = ActionNames(description.dynamics.appearance)

    def action_space(self) -> ActionNames:
        return self._space

    def actions(self, actions: Batch, state: EnvState) -> tuple[Batch, Mapping[str, BoolArray]]:
        """Raises ActionError for an unknown name."""
        return np.array([self._space.index(name) for name in actions]), {}


class NamedActions(EnvWrapper[NameDecoding]):
    """Takes actions by name: "STOP", "ADD(LEFT, BLUE)", "REMOVE(LEFT)"; in Scatter "ADD(3, 4, CIRCLE, BLUE, SMALL)"
    and "REMOVE(3, 4)" with the grid's column and row. Case and spacing do not matter.

    Raises ActionError in `step` for an unknown name.
    """

    transformation_class = NameDecoding
