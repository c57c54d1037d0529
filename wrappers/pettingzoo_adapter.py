"""Applies a transformation to the proposer-verifier game: to observations and rewards of both agents, and to the
proposer's actions and masks.

Imported by `factory` only for PettingZoo environments, so that pettingzoo stays optional.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from gymnasium import spaces
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils import BaseParallelWrapper, BaseWrapper

from lilgym_mp.envs.proposer_verifier.engine import BaseGameEnv
from lilgym_mp.envs.proposer_verifier.observations import MASK, PARTS
from lilgym_mp.envs.proposer_verifier.protocols import AGENTS, Role
from lilgym_mp.envs.rules import State
from lilgym_mp.envs.single import UNCHANGED_REWARD
from lilgym_mp.scene.arrays import Int8Array
from lilgym_mp.wrappers.transformation import (
    Batch,
    EnvDescription,
    EnvState,
    Transformation,
    WrongEnvironment,
    change_tasks,
    stacked,
    to_python,
)

AgentObservation = Mapping[str, Any]
Info = dict[str, Any]
MakeTransformation = Callable[..., Transformation]  # called with an EnvDescription and the settings


def is_game(env: object) -> bool:
    """Whether `env` is a PettingZoo environment of the game."""
    return isinstance(env, AECEnv | ParallelEnv) and isinstance(env.unwrapped, BaseGameEnv)


def wrap_game(env: Any, name: str, transformation_class: MakeTransformation, settings: Mapping[str, Any]) -> Any:
    """Wraps the game `env` in the wrapper called `name`."""
    adapters = {agent: TransformedAgent(env, agent, name, transformation_class, settings) for agent in AGENTS}
    change_tasks(env, adapters[AGENTS[Role.PROPOSER]].transformation)
    return AECGameWrapper(env, name, adapters) if isinstance(env, AECEnv) else ParallelGameWrapper(env, name, adapters)


class TransformedAgent:
    """The effect on one agent. Actions and masks change only for the proposer, in its turn."""

    def __init__(
        self, env: Any, agent: str, name: str, transformation_class: MakeTransformation, settings: Mapping[str, Any]
    ) -> None:
        """Raises WrongEnvironment for array observations and for transformations that use MDP actions."""
        base: BaseGameEnv = env.unwrapped
        nested, actions = env.observation_space(agent), env.action_space(agent)
        if not isinstance(nested, spaces.Dict) or MASK not in nested.spaces:
            raise WrongEnvironment(f'{name} needs the game with observations="nested", not {nested}')
        description = EnvDescription(name, base.tasks, base.dynamics, nested[PARTS], actions)
        self.transformation = transformation_class(description, **settings)
        if self.transformation.uses_mdp_actions:
            raise WrongEnvironment(f"{name} uses the MDP's actions, but the game's agents have other action spaces")
        self.observation_space = spaces.Dict({PARTS: self.transformation.observation_space(), MASK: nested[MASK]})
        self._engine = base.engine
        self._role = Role(AGENTS.index(agent))
        self.entries: Info = {}  # info entries of the agent's last action

    def observation(self, observation: AgentObservation) -> dict[str, Any]:
        parts, mask = observation[PARTS], observation[MASK]
        state = self._state(mask)
        if self.transformation.changes_observations:
            parts = _first(self.transformation.observations(stacked([parts]), state))
        if self._proposes:
            narrowed = mask * self.transformation.action_masks(state)[0]
            mask = narrowed if narrowed.any() else mask
        return {PARTS: parts, MASK: mask}

    def info(self, info: Info, observe: Callable[[], Any]) -> Info:
        """The transformed info; `observe` returns the transformed observation."""
        info = {**info, **self.entries}
        if self.transformation.adds_infos:
            mask = observe()[MASK]
            added = self.transformation.added_infos(info, self._state(mask))
            info |= {name: mask if name == MASK else to_python(value[0]) for name, value in added.items()}
        return info

    def action(self, action: Any) -> Any:
        """The action for the wrapped game."""
        if action is None or not self.transformation.changes_actions or not self._proposes:
            self.entries = {}
            return action
        game = self._engine.game
        choice, message = divmod(int(action), game.message_sizes[self._role] + 1)
        choices, entries = self.transformation.actions(np.array([choice]), self._state(None))
        if int(choices[0]) not in game.choices[self._role]:  # a forced STOP, but only the verifier may stop
            return action
        self.entries = {name: to_python(value[0]) for name, value in entries.items()}
        return game.encode_action(self._role, int(choices[0]), message)

    @property
    def _proposes(self) -> bool:
        return self._role is Role.PROPOSER and Role.PROPOSER in self._engine.movers

    def _state(self, mask: Int8Array | None) -> EnvState:
        """`mask`: the agent's legal actions, None if not needed."""
        masks = None if mask is None else mask[None].astype(np.bool_)
        return EnvState(self.transformation.env_description, (self._engine.state.mdp,), masks)


def _first(batch: Batch) -> Any:
    """The first value of a batch. Scalars stay NumPy's, as PettingZoo's tests demand."""
    return {name: _first(part) for name, part in batch.items()} if isinstance(batch, dict) else batch[0]


class GameWrapper:
    """The common part of both wrappers, a base class before PettingZoo's."""

    env: Any

    def __init__(self, env: Any, name: str, adapters: Mapping[str, TransformedAgent]) -> None:
        super().__init__(env)  # pyright: ignore[reportCallIssue]
        self.name = name
        self.transformation = adapters[AGENTS[Role.PROPOSER]].transformation
        self.adapters = adapters  # by agent
        self._engine = env.unwrapped.engine
        self._mdp: State | None = None  # after the last turn; None after the end; used only to change rewards
        self._potential = np.zeros(1)
        self._games_started = 0
        self._has_restarted = False  # whether a wrapper such as MultiEpisodeEnv has reset the game in the last step

    def _start(self) -> None:
        """To be called when a game has started."""
        for adapter in self.adapters.values():
            adapter.entries = {}
        self._games_started = self._engine.games_started
        if self.transformation.changes_rewards:
            mdp = self._engine.state.mdp
            self._mdp, self._potential = mdp, self.transformation.potentials([mdp])

    def _changed_rewards(self, rewards: Sequence[float]) -> list[float]:
        """Both agents' rewards of the last turn, transformed if it changed the MDP or ended the game."""
        mdp, last, potential = self._engine.state.mdp, self._mdp, self._potential
        self._has_restarted = self._engine.games_started != self._games_started
        is_over = self._has_restarted or not self._engine.movers
        if self._has_restarted:
            self._start()
        elif last is not None and (is_over or mdp.steps != last.steps):
            self._mdp = None if is_over else mdp
            self._potential = np.zeros(1) if is_over else self.transformation.potentials([mdp])
        if last is None or (mdp.steps == last.steps and not is_over):
            return list(rewards)
        after, ones = 0.0 if is_over else self._potential, np.ones(len(rewards))
        return self.transformation.rewards(np.array(rewards, np.float64), potential * ones, after * ones).tolist()

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        return self.adapters[agent].observation_space

    def __str__(self) -> str:
        return f"{self.name}<{self.env}>"


class AECGameWrapper(GameWrapper, BaseWrapper[str, Any, Any]):
    """A wrapper of the AEC environment."""

    def __init__(self, env: AECEnv[str, Any, Any], name: str, adapters: Mapping[str, TransformedAgent]) -> None:
        super().__init__(env, name, adapters)
        self._infos: dict[str, Info] | None = None  # cache for this turn
        self._reward_change: dict[str, float] = {}  # added to each agent's reward of this turn
        self._cumulative_change: dict[str, float] = {}  # added to each agent's rewards since it last acted

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> None:
        super().reset(seed, options)
        self._infos = None
        self._reward_change = dict.fromkeys(map(str, AGENTS), 0.0)
        self._cumulative_change = dict.fromkeys(map(str, AGENTS), 0.0)
        self._start()

    def step(self, action: Any) -> None:
        agent = self.agent_selection if self.agents else None
        super().step(self.adapters[agent].action(action) if agent else action)
        self._infos = None
        if agent and self.transformation.changes_rewards:
            self._change_rewards(agent)

    def _change_rewards(self, actor: str) -> None:
        rewards = [self.env.rewards.get(agent, 0.0) for agent in AGENTS]
        self._cumulative_change[actor] = 0.0
        for agent, reward, changed in zip(AGENTS, rewards, self._changed_rewards(rewards), strict=True):
            self._reward_change[agent] = changed - reward
            total = self._cumulative_change[agent] + self._reward_change[agent]
            self._cumulative_change[agent] = 0.0 if self._has_restarted else total

    @property
    def rewards(self) -> dict[str, float]:
        return {agent: reward + self._reward_change.get(agent, 0.0) for agent, reward in self.env.rewards.items()}

    @property
    def _cumulative_rewards(self) -> dict[str, float]:
        rewards: Mapping[str, float] = self.env._cumulative_rewards
        return {agent: reward + self._cumulative_change.get(agent, 0.0) for agent, reward in rewards.items()}

    def observe(self, agent: str) -> Any:
        observation = super().observe(agent)
        return None if observation is None else self.adapters[agent].observation(observation)

    @property
    def infos(self) -> dict[str, Info]:
        if self._infos is None:
            self._infos = {
                agent: self.adapters[agent].info(info, partial(self.observe, agent))
                for agent, info in self.env.infos.items()
            }
            if self.transformation.changes_rewards:
                for agent, info in self._infos.items():
                    info[UNCHANGED_REWARD] = self.env.rewards[agent]
        return self._infos


class ParallelGameWrapper(GameWrapper, BaseParallelWrapper[str, Any, Any]):
    """A wrapper of the parallel environment."""

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Info]]:
        observations, infos = super().reset(seed, options)
        self._start()
        return self._transformed(observations, infos)

    def step(self, actions: Mapping[str, Any]) -> tuple[dict[str, Any], Any, Any, Any, dict[str, Info]]:
        if self.agents and actions.keys() == self.adapters.keys():  # otherwise the game raises
            actions = {agent: self.adapters[agent].action(action) for agent, action in actions.items()}
        observations, rewards, terminated, truncated, infos = super().step(dict(actions))
        observations, infos = self._transformed(observations, infos)
        if self.transformation.changes_rewards:
            for agent, info in infos.items():
                info[UNCHANGED_REWARD] = rewards[agent]
            changed = self._changed_rewards([rewards[agent] for agent in AGENTS])
            rewards = dict(zip(map(str, AGENTS), changed, strict=True))
        return observations, rewards, terminated, truncated, infos

    def _transformed(
        self, observations: Mapping[str, Any], infos: Mapping[str, Info]
    ) -> tuple[dict[str, Any], dict[str, Info]]:
        transformed = {agent: self.adapters[agent].observation(one) for agent, one in observations.items()}
        return transformed, {
            agent: self.adapters[agent].info(info, partial(transformed.get, agent)) for agent, info in infos.items()
        }
