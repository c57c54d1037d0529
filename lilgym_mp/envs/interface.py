"""What single environments and batches share beyond Gymnasium's interface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec

from lilgym_mp.corpus import TaskSet
from lilgym_mp.corpus.locations import fixed_keywords
from lilgym_mp.envs.rules import Dynamics, Outcome
from lilgym_mp.scene.actions import checked_index
from lilgym_mp.scene.appearances import Appearance, InvalidReason

if TYPE_CHECKING:
    from lilgym_mp.corpus import Vocabulary
    from lilgym_mp.corpus.statement_arrays import StatementArrays
    from lilgym_mp.envs.rendering import Renderer

RENDER_FPS = 4  # the same for every environment
RENDER_MODES = ("human", "rgb_array", "ansi")
RESET_OPTIONS = ("task",)
UNCHANGED_REWARD = "unshaped_reward"  # key in infos of the environment's own reward if a wrapper changed it


class TaskEnvironment:
    """Base class of single environments and batches: what they have beyond Gymnasium's interface."""

    dynamics: Dynamics
    tasks: TaskSet

    _arrays: StatementArrays | None
    _spec: EnvSpec | None = None

    @property
    def spec(self) -> EnvSpec | None:
        """What `gymnasium.make` or `make_vec` makes this environment from again, in any working directory."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = spec if spec is None else replace(spec, kwargs=fixed_keywords(spec.kwargs))

    @property
    def vocabulary(self) -> Vocabulary:
        """The vocabulary of token ids. Raises AttributeError if statements are texts."""
        if self._arrays is None:
            raise AttributeError('there is no vocabulary without observation="arrays" or TokenizedStatement(env)')
        return self._arrays.vocabulary

    @property
    def horizon(self) -> int:
        """Actions per episode. `spec.max_episode_steps` is None because the environment itself ends the episode;
        `gymnasium.make(env.spec)` would add a TimeLimit that sets other flags."""
        return self.dynamics.horizon

    def encode_action(self, action: Sequence[int]) -> int:
        """The index of an action in the released array form: [type, box, colour] for tower, [type, x, y, shape,
        colour, size] for scatter; unused slots are ignored. Raises ActionError."""
        return self.dynamics.appearance.encode(self.dynamics.appearance.from_array(action))

    def decode_action(self, index: int) -> list[int]:
        """The released array form of an action, -1 in unused slots. Raises ActionError."""
        appearance = self.dynamics.appearance
        return appearance.to_array(appearance.decode(checked_index(index, appearance.action_count)))

    def evaluation_tasks(self) -> tuple[str, ...]:
        """Every task id of the split, in file order."""
        return self.tasks.ids


def warn_of_no_mode(id: str) -> None:
    """Warns, as Gymnasium's environments do, that `render` was called without a render mode."""
    gym.logger.warn(
        f'render() does nothing without a render mode; give one when making the environment: "{id}",'
        ' render_mode="rgb_array"'
    )


def end_info(outcome: Outcome, invalid: InvalidReason | None) -> dict[str, Any]:
    """Infos of the action that ended an episode."""
    info: dict[str, Any] = {"outcome": str(outcome), "is_success": outcome is Outcome.SUCCESS}
    if invalid is not None:
        info["invalid_reason"] = str(invalid)
    return info


def make_renderer(
    mode: str | None, modes: Sequence[str] = RENDER_MODES, *, marked: Appearance | None = None
) -> Renderer | None:
    """The renderer for a render mode, imported only if there is one. Raises ValueError naming the modes."""
    if mode is None:
        return None
    from lilgym_mp.envs.rendering import Renderer

    return Renderer(mode, modes, marked=marked)
