"""Observations as single arrays, with masks in infos, for SuperSuit's wrappers and simple networks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.spaces.utils import flatten, flatten_space
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils.wrappers import BaseParallelWrapper, BaseWrapper

from lilgym_mp.choices import choose
from lilgym_mp.envs.proposer_verifier.types import AGENTS

PARTS, MASK, IMAGE = "observation", "action_mask", "image"  # keys of nested observations
NESTED = "nested"

Convert = Callable[[Mapping[str, Any]], np.ndarray]
Form = Callable[[spaces.Dict], tuple[spaces.Box, Convert]]  # from the space of nested observations
Game = AECEnv[str, Any, Any] | ParallelEnv[str, Any, Any]


def _vector(space: spaces.Dict) -> tuple[spaces.Box, Convert]:
    """All parts flattened to one float32 vector, in alphabetical order."""
    flat = flatten_space(space)
    assert isinstance(flat, spaces.Box)
    box = spaces.Box(flat.low.astype(np.float32), flat.high.astype(np.float32), dtype=np.float32)
    return box, lambda parts: np.asarray(flatten(space, dict(parts)), np.float32)


def _image(space: spaces.Dict) -> tuple[spaces.Box, Convert]:
    """Only the image."""
    image = space.spaces.get(IMAGE)
    if not isinstance(image, spaces.Box):
        raise ValueError(f'observations="image" needs views with scene="image"; the parts are {", ".join(space)}')
    return image, lambda parts: parts[IMAGE]


FORMS: Mapping[str, Form | None] = {
    NESTED: None,
    "vector": _vector,
    "image": _image,
}


class _Converters:
    """Each agent's space and conversion."""

    def __init__(self, env: Game, form: Form) -> None:
        self.spaces: dict[str, spaces.Box] = {}
        self._convert: dict[str, Convert] = {}
        for agent in AGENTS:
            nested: Any = env.observation_space(agent)
            self.spaces[agent], self._convert[agent] = form(nested[PARTS])

    def __call__(self, agent: str, observation: Mapping[str, Any]) -> np.ndarray:
        return self._convert[agent](observation[PARTS])


class ArrayObservationAEC(BaseWrapper[str, Any, Any]):
    """The AEC environment with arrays as observations and "action_mask" in infos."""

    def __init__(self, env: Any, form: Any) -> None:
        super().__init__(env)
        self._convert = _Converters(env, form)
        self._infos: dict[str, Any] | None = None  # cache for this turn

    def observation_space(self, agent: str) -> spaces.Box:
        return self._convert.spaces[agent]

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> None:
        super().reset(seed, options)
        self._infos = None

    def step(self, action: Any) -> None:
        super().step(action)
        self._infos = None

    def observe(self, agent: str) -> Any:
        observation = super().observe(agent)
        return None if observation is None else self._convert(agent, observation)

    @property
    def infos(self) -> dict[str, Any]:
        if self._infos is None:
            nested: Any = self.env
            self._infos = {agent: {**info, MASK: nested.observe(agent)[MASK]} for agent, info in nested.infos.items()}
        return self._infos


class ArrayObservationParallel(BaseParallelWrapper[str, Any, Any]):
    """The parallel environment with arrays as observations and "action_mask" in infos."""

    def __init__(self, env: Any, form: Any) -> None:
        super().__init__(env)
        self._convert = _Converters(env, form)

    def observation_space(self, agent: str) -> spaces.Box:
        return self._convert.spaces[agent]

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, Any]:
        return self._converted(*super().reset(seed, options))

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, Any]:
        observations, rewards, terminated, truncated, infos = super().step(actions)
        observations, infos = self._converted(observations, infos)
        return observations, rewards, terminated, truncated, infos

    def _converted(self, observations: Mapping[str, Any], infos: Mapping[str, Any]) -> tuple[Any, Any]:
        arrays = {agent: self._convert(agent, observation) for agent, observation in observations.items()}
        return arrays, {agent: {**info, MASK: observations[agent][MASK]} for agent, info in infos.items()}


def convert_observations(env: Any, observations: str) -> Any:
    """The game with observations in the form named `observations`. Raises ValueError naming the choices."""
    form = choose("observations", observations, FORMS)
    if form is None:
        return env
    return ArrayObservationAEC(env, form) if isinstance(env, AECEnv) else ArrayObservationParallel(env, form)
