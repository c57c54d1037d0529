"""Each agent's observation as one array, with masks in infos: what SuperSuit's wrappers and plain networks take."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.spaces.utils import flatten, flatten_space
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils.wrappers import BaseParallelWrapper, BaseWrapper

from lilgym_mp.choices import choose
from lilgym_mp.envs.proposer_verifier.states import AGENTS

SEEN, MASK, IMAGE = "observation", "action_mask", "image"  # keys of the game's own observations
NESTED = "nested"

Convert = Callable[[Mapping[str, Any]], np.ndarray]
Game = AECEnv[str, Any, Any] | ParallelEnv[str, Any, Any]


def _vector(space: spaces.Dict) -> tuple[spaces.Box, Convert]:
    """All parts in one float32 vector, in alphabetical order."""
    flat = flatten_space(space)
    assert isinstance(flat, spaces.Box)
    box = spaces.Box(flat.low.astype(np.float32), flat.high.astype(np.float32), dtype=np.float32)
    return box, lambda parts: np.asarray(flatten(space, dict(parts)), np.float32)


def _image(space: spaces.Dict) -> tuple[spaces.Box, Convert]:
    """The image alone."""
    image = space.spaces.get(IMAGE)
    if not isinstance(image, spaces.Box):
        raise ValueError(f'observations="image" needs views with a scene as "image"; there is {", ".join(space)}')
    return image, lambda parts: parts[IMAGE]


FORMS: Mapping[str, Callable[[spaces.Dict], tuple[spaces.Box, Convert]] | None] = {
    NESTED: None,
    "vector": _vector,
    "image": _image,
}


class _Boxes:
    """By agent, the space and how an observation becomes one of it."""

    def __init__(self, env: Game, form: Callable[[spaces.Dict], tuple[spaces.Box, Convert]]) -> None:
        self.spaces: dict[str, spaces.Box] = {}
        self._convert: dict[str, Convert] = {}
        for agent in AGENTS:
            both: Any = env.observation_space(agent)
            self.spaces[agent], self._convert[agent] = form(both[SEEN])

    def observation(self, agent: str, observation: Mapping[str, Any]) -> np.ndarray:
        return self._convert[agent](observation[SEEN])


class BoxTurns(BaseWrapper[str, Any, Any]):
    """The turn-by-turn form with observations as arrays; `infos` have "action_mask"."""

    def __init__(self, env: Any, form: Any) -> None:
        super().__init__(env)
        self._boxes = _Boxes(env, form)
        self._told: dict[str, Any] | None = None  # this turn's infos, once somebody has asked for them

    def observation_space(self, agent: str) -> spaces.Box:
        return self._boxes.spaces[agent]

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> None:
        super().reset(seed, options)
        self._told = None

    def step(self, action: Any) -> None:
        super().step(action)
        self._told = None

    def observe(self, agent: str) -> Any:
        observation = super().observe(agent)
        return None if observation is None else self._boxes.observation(agent, observation)

    @property
    def infos(self) -> dict[str, Any]:
        if self._told is None:
            nested: Any = self.env
            self._told = {agent: {**info, MASK: nested.observe(agent)[MASK]} for agent, info in nested.infos.items()}
        return self._told


class BoxTogether(BaseParallelWrapper[str, Any, Any]):
    """The form in which both act in every step, with observations as arrays; infos have "action_mask"."""

    def __init__(self, env: Any, form: Any) -> None:
        super().__init__(env)
        self._boxes = _Boxes(env, form)

    def observation_space(self, agent: str) -> spaces.Box:
        return self._boxes.spaces[agent]

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, Any]:
        return self._shown(*super().reset(seed, options))

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, Any]:
        observations, rewards, terminated, truncated, infos = super().step(actions)
        shown, told = self._shown(observations, infos)
        return shown, rewards, terminated, truncated, told

    def _shown(self, observations: Mapping[str, Any], infos: Mapping[str, Any]) -> tuple[Any, Any]:
        shown = {agent: self._boxes.observation(agent, seen) for agent, seen in observations.items()}
        return shown, {agent: {**info, MASK: observations[agent][MASK]} for agent, info in infos.items()}


def shown_as(env: Any, observations: str) -> Any:
    """The game with observations in that form. Raises ValueError naming the choices."""
    form = choose("observations", observations, FORMS)
    if form is None:
        return env
    return BoxTurns(env, form) if isinstance(env, AECEnv) else BoxTogether(env, form)
