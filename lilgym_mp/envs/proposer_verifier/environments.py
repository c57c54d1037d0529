"""The game as PettingZoo environments, with nested observations or others for SuperSuit and Stable-Baselines3."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, SupportsIndex

import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from gymnasium.spaces.utils import flatten, flatten_space
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils.wrappers import BaseParallelWrapper, BaseWrapper, OrderEnforcingWrapper

from lilgym_mp.choices import choose
from lilgym_mp.envs.proposer_verifier.engine import AgentObservation, BaseGameEnv, Info, role_of
from lilgym_mp.envs.proposer_verifier.game import GameStep, TurnError
from lilgym_mp.envs.proposer_verifier.protocols import AGENTS, Role
from lilgym_mp.envs.proposer_verifier.settings import GameSettings

PROPOSER_NAME, VERIFIER_NAME = AGENTS
PARTS, MASK, IMAGE = "observation", "action_mask", "image"  # keys of nested observations
NESTED = "nested"

ParallelStep = tuple[dict[str, AgentObservation], dict[str, float], dict[str, bool], dict[str, bool], dict[str, Info]]
Convert = Callable[[Mapping[str, Any]], Any]
Form = Callable[[spaces.Dict], tuple[spaces.Space[Any], Convert]]  # from the space of an agent's parts


class ProposerVerifierAEC(BaseGameEnv, AECEnv[str, AgentObservation, SupportsIndex | None]):
    """A proposer and a verifier act on one MDP, one after the other.

    In the simultaneous protocol ("joint") the proposer's action is held back, unseen, until the verifier has acted.
    """

    _pending: int | None = None  # simultaneous protocol: the proposer's action, until the verifier acts

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> None:
        """`options`: "task", an id of the split; "intent", "helpful" or "sneaky". Others are ignored."""
        infos = self.engine.reset(seed, options)
        self.agents = list(AGENTS)
        self.rewards = dict.fromkeys(AGENTS, 0.0)
        self._cumulative_rewards = dict.fromkeys(AGENTS, 0.0)
        self.terminations = dict.fromkeys(AGENTS, False)
        self.truncations = dict.fromkeys(AGENTS, False)
        self.infos = dict(zip(AGENTS, infos, strict=True))
        self.agent_selection = AGENTS[Role.PROPOSER]
        self._pending = None
        self._skip_agent_selection = None

    def observe(self, agent: str) -> AgentObservation:
        return self.engine.observe(role_of(agent))

    def step(self, action: SupportsIndex | None) -> None:
        """Raises ActionError for an action outside the action space, ResetNeeded before reset and after the end."""
        if not self.agents:
            raise ResetNeeded("no agent is active; call reset before step")
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        self._cumulative_rewards[agent] = 0.0
        if agent == AGENTS[Role.VERIFIER]:
            self._update(self.engine.step(self._pending, action))
            self._pending = None
        elif action is not None and not self.engine.game.turn_based:
            self._pending = self.engine.game.checked_action(Role.PROPOSER, action)
            self._clear_rewards()
            self.agent_selection = AGENTS[Role.VERIFIER]
        else:
            self._update(self.engine.step(action, None))

    def _update(self, step: GameStep) -> None:
        """Sets rewards, flags, infos and the next agent after a turn."""
        infos = self.engine.infos(step)
        self.rewards = {PROPOSER_NAME: step.rewards[0], VERIFIER_NAME: step.rewards[1]}
        self._accumulate_rewards()
        self.terminations = dict.fromkeys(AGENTS, step.terminated)
        self.truncations = dict.fromkeys(AGENTS, step.truncated)
        self.infos = {PROPOSER_NAME: infos[0], VERIFIER_NAME: infos[1]}
        self.agent_selection = AGENTS[step.state.movers[0] if step.state.movers else Role.PROPOSER]


class StrictOrderEnforcing(OrderEnforcingWrapper[str, AgentObservation, SupportsIndex | None]):
    """PettingZoo's checks of the order of calls, but a step after the end raises instead of logging a warning."""

    adapters: ClassVar[Mapping[str, Any]] = {}  # for SingleAgentView: observations and actions stay unchanged

    def step(self, action: SupportsIndex | None) -> None:
        if self._has_reset and not self.agents:
            raise ResetNeeded("no agent is active; call reset before step")
        super().step(action)


class ProposerVerifierParallel(BaseGameEnv, ParallelEnv[str, AgentObservation, SupportsIndex]):
    """A proposer and a verifier act on one MDP; each step takes an action from both.

    In turn-based protocols a step is one turn: the agent out of turn has one legal action, "wait", and any other is
    ignored. Both agents' observations share the arrays of parts that both see.
    """

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, AgentObservation], dict[str, Info]]:
        """`options`: "task", an id of the split; "intent", "helpful" or "sneaky". Others are ignored."""
        infos = self.engine.reset(seed, options)
        self.agents = list(AGENTS)
        proposer, verifier = self.engine.observe_both()
        return (
            {PROPOSER_NAME: proposer, VERIFIER_NAME: verifier},
            {PROPOSER_NAME: infos[0], VERIFIER_NAME: infos[1]},
        )

    def step(self, actions: Mapping[str, SupportsIndex]) -> ParallelStep:
        """Raises ActionError for an action outside the action space, TurnError unless exactly both agents act,
        ResetNeeded before reset and after the end."""
        if not self.agents:
            raise ResetNeeded("no agent is active; call reset before step")
        if len(actions) != len(AGENTS) or PROPOSER_NAME not in actions or VERIFIER_NAME not in actions:
            raise TurnError(f"actions must be for {' and '.join(AGENTS)}, not for {', '.join(actions) or 'no agent'}")
        step, infos = self.engine.step_both(actions[PROPOSER_NAME], actions[VERIFIER_NAME])
        _, rewards, terminated, truncated, _, _, _, _ = step
        if terminated or truncated:
            self.agents = []
        proposer, verifier = self.engine.observe_both()
        return (
            {PROPOSER_NAME: proposer, VERIFIER_NAME: verifier},
            {PROPOSER_NAME: rewards[0], VERIFIER_NAME: rewards[1]},
            {PROPOSER_NAME: terminated, VERIFIER_NAME: terminated},
            {PROPOSER_NAME: truncated, VERIFIER_NAME: truncated},
            {PROPOSER_NAME: infos[0], VERIFIER_NAME: infos[1]},
        )


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


def _parts(space: spaces.Dict) -> tuple[spaces.Dict, Convert]:
    """The parts without the mask: a flat dictionary, as Stable-Baselines3 accepts."""
    return space, dict


FORMS: Mapping[str, Form | None] = {NESTED: None, "parts": _parts, "vector": _vector, "image": _image}


def _converters(env: Any, form: Form) -> dict[str, tuple[spaces.Space[Any], Convert]]:
    """By agent."""
    return {agent: form(env.observation_space(agent)[PARTS]) for agent in AGENTS}


class ArrayObservationAEC(BaseWrapper[str, Any, Any]):
    """The AEC environment with arrays as observations and "action_mask" in infos."""

    def __init__(self, env: Any, form: Form) -> None:
        super().__init__(env)
        self._converters = _converters(env, form)
        self._infos: dict[str, Any] | None = None  # cache for this turn

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        return self._converters[agent][0]

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> None:
        super().reset(seed, options)
        self._infos = None

    def step(self, action: Any) -> None:
        super().step(action)
        self._infos = None

    def observe(self, agent: str) -> Any:
        observation = super().observe(agent)
        return None if observation is None else self._converters[agent][1](observation[PARTS])

    @property
    def infos(self) -> dict[str, Any]:
        if self._infos is None:
            nested: Any = self.env
            self._infos = {agent: {**info, MASK: nested.observe(agent)[MASK]} for agent, info in nested.infos.items()}
        return self._infos


class ArrayObservationParallel(BaseParallelWrapper[str, Any, Any]):
    """The parallel environment with arrays as observations and "action_mask" in infos."""

    def __init__(self, env: Any, form: Form) -> None:
        super().__init__(env)
        self._converters = _converters(env, form)

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        return self._converters[agent][0]

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, Any]:
        return self._converted(*super().reset(seed, options))

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, Any]:
        observations, rewards, terminated, truncated, infos = super().step(actions)
        observations, infos = self._converted(observations, infos)
        return observations, rewards, terminated, truncated, infos

    def _converted(self, observations: Mapping[str, Any], infos: Mapping[str, Any]) -> tuple[Any, Any]:
        arrays = {agent: self._converters[agent][1](nested[PARTS]) for agent, nested in observations.items()}
        return arrays, {agent: {**info, MASK: observations[agent][MASK]} for agent, info in infos.items()}


def _with_observations(env: Any, observations: str) -> Any:
    """The game with observations in the form named `observations`. Raises ValueError naming the choices."""
    form = choose("observations", observations, FORMS)
    if form is None:
        return env
    return ArrayObservationAEC(env, form) if isinstance(env, AECEnv) else ArrayObservationParallel(env, form)


def raw_env(*, render_mode: str | None = None, **settings: Any) -> ProposerVerifierAEC:
    """The game as a PettingZoo AEC environment; keywords are the fields of GameSettings."""
    return ProposerVerifierAEC(GameSettings.of(**settings), render_mode)


def env(*, render_mode: str | None = None, observations: str = NESTED, **settings: Any) -> StrictOrderEnforcing:
    """`raw_env` with checks of the order of calls. `observations`: as for `parallel_env`."""
    return StrictOrderEnforcing(_with_observations(raw_env(render_mode=render_mode, **settings), observations))


def parallel_env(
    *, render_mode: str | None = None, observations: str = NESTED, **settings: Any
) -> ProposerVerifierParallel:
    """The game as a PettingZoo parallel environment; keywords are the fields of GameSettings.

    `observations`: "nested", {"observation": parts, "action_mask"}; or, for SuperSuit and Stable-Baselines3, with masks
    in infos: "parts", the dictionary of parts alone, "vector", all parts flattened to float32 (N,), or "image", only
    the image.
    """
    return _with_observations(ProposerVerifierParallel(GameSettings.of(**settings), render_mode), observations)
