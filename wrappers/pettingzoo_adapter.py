"""Applies a transformation to the proposer-verifier game, as a layer of its engine: to the observations of both agents,
and to the proposer's masks.

Imported by `factory` only for PettingZoo environments, so that pettingzoo stays optional.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from typing import Any

from gymnasium import spaces

from lilgym_mp.envs.observation import row_of
from lilgym_mp.envs.proposer_verifier.engine import BaseGameEnv
from lilgym_mp.envs.proposer_verifier.observations import MASK, PARTS, AgentObservation
from lilgym_mp.envs.proposer_verifier.protocols import AGENTS, PROPOSER, Role
from lilgym_mp.scene.arrays import AnyMapping
from lilgym_mp.wrappers.actions import MaskInfo
from lilgym_mp.wrappers.transformation import (
    EnvDescription,
    EnvState,
    Transformation,
    WrongEnvironment,
    change_tasks,
    stacked,
)

MakeTransformation = Callable[..., Transformation]  # called with an EnvDescription and the settings


def is_game(env: Any) -> bool:
    """Whether `env` is a PettingZoo environment of the game."""
    return isinstance(getattr(env, "unwrapped", None), BaseGameEnv)


def wrap_game(env: Any, name: str, transformation_class: MakeTransformation, settings: AnyMapping) -> Any:
    """A copy of the game `env` with the wrapper called `name`; `env` stays as it was, and is played on its own.

    Raises WrongEnvironment.
    """
    if any(env.observation_space(agent) != env.unwrapped.observation_space(agent) for agent in AGENTS):
        raise WrongEnvironment(f"{name} must be applied before {env}, which changes observations")
    game = env.unwrapped.engine.game
    env = deepcopy(env, {id(constant): constant for constant in (game, *game.tasks)})
    base: BaseGameEnv = env.unwrapped
    layer = GameLayer(base, name, transformation_class, settings)
    change_tasks(env, layer.transformation, [each.transformation for each in base.engine.layers])  # pyright: ignore[reportAttributeAccessIssue]
    base.engine.layers.append(layer)
    base.observation_spaces.update(zip(AGENTS, layer.observation_spaces, strict=True))
    base.masks_in_infos |= isinstance(layer.transformation, MaskInfo)
    return env


class GameLayer:
    """The effect of one wrapper on a game. Masks change only for the proposer, in its turn."""

    def __init__(
        self, base: BaseGameEnv, name: str, transformation_class: MakeTransformation, settings: AnyMapping
    ) -> None:
        """Raises WrongEnvironment for array observations and for transformations that use MDP actions."""
        self._engine = base.engine
        self._transformations: list[Transformation] = []  # indexed by role, like the spaces
        self.observation_spaces: list[spaces.Dict] = []
        for agent in AGENTS:
            nested = base.observation_space(agent)
            if not isinstance(nested, spaces.Dict) or MASK not in nested.spaces:
                raise WrongEnvironment(f'{name} needs the game with observations="nested", not {nested}')
            description = EnvDescription(name, base.tasks, base.dynamics, nested[PARTS], base.action_space(agent))
            transformation = transformation_class(description, **settings)
            if transformation.uses_mdp_actions or transformation.changes_actions:
                raise WrongEnvironment(f"{name} uses the MDP's actions, but the game's agents have other action spaces")
            if transformation.changes_rewards:
                raise WrongEnvironment(f"{name} changes the MDP's rewards; the game's own are a setting, rewards=...")
            self._transformations.append(transformation)
            self.observation_spaces.append(spaces.Dict({PARTS: transformation.observation_space(), MASK: nested[MASK]}))
        self.transformation = self._transformations[PROPOSER]

    def __call__(self, role: Role, observation: AgentObservation) -> AgentObservation:
        transformation = self._transformations[role]
        parts = observation[PARTS]
        mask = observation[MASK]
        legal = mask[None].astype(bool)
        state = EnvState(transformation.env_description, (self._engine.state.mdp,), legal)
        if transformation.changes_observations:
            batch = transformation.observations(stacked([parts]), state)
            parts = row_of(batch, 0)  # scalars stay NumPy's, as PettingZoo's tests demand
        if role is PROPOSER and PROPOSER in self._engine.movers:
            narrowed = mask * transformation.action_masks(state)[0]
            mask = narrowed if narrowed.any() else mask
        return {PARTS: parts, MASK: mask}
