"""A transformation on the proposer-verifier game: on what each agent sees and earns, and on what the proposer may do.

`factory` imports this when it is given a PettingZoo environment, so that nothing else needs pettingzoo.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from gymnasium import spaces
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils import BaseParallelWrapper, BaseWrapper

from lilgym_mp.arrays import BoolArray, Int8Array
from lilgym_mp.envs.proposer_verifier.base import BaseGameEnv
from lilgym_mp.envs.proposer_verifier.types import AGENTS, Role
from lilgym_mp.envs.single import UNCHANGED_REWARD
from lilgym_mp.rules import State
from lilgym_mp.wrappers.env_state import EnvDescription, StatesOf, WrongEnvironment
from lilgym_mp.wrappers.gymnasium_adapter import batch_of_one, plain
from lilgym_mp.wrappers.transformation import (
    Batch,
    TaskChange,
    Transformation,
    refuse_above_others,
)

SEEN, MASK = "observation", "action_mask"  # the parts of an agent's observation

AgentObservation = Mapping[str, Any]
Info = dict[str, Any]
Does = Callable[..., Transformation]


def is_game(env: object) -> bool:
    """Whether `env` is the game in one of PettingZoo's forms."""
    return isinstance(env, AECEnv | ParallelEnv) and isinstance(env.unwrapped, BaseGameEnv)


def lifted(env: Any, name: str, transformation_class: Does, settings: Mapping[str, Any]) -> Any:
    """The game `env` behind the wrapper called `name`, in the same form."""
    adapters = {agent: TransformedAgent(env, agent, name, transformation_class, settings) for agent in AGENTS}
    transformation = adapters[AGENTS[Role.PROPOSER]].transformation
    if isinstance(transformation, TaskChange):
        refuse_above_others(name, env)
        env.unwrapped.change_tasks(transformation.change)
    return AECGameWrapper(env, name, adapters) if isinstance(env, AECEnv) else ParallelGameWrapper(env, name, adapters)


class TransformedRewards:
    """How a wrapper changes both agents' rewards: whenever a turn changes the MDP or ends the game."""

    def __init__(self, transformation: Transformation, engine: Any) -> None:
        self._transformation = transformation
        self._engine = engine
        self._mdp: State | None = None  # as it was after the last turn; None when the game was over
        self._value = np.zeros(1)

    def reset(self) -> None:
        mdp: State = self._engine.state.mdp
        self._mdp = mdp
        self._value = self._transformation.values([mdp])

    def transform(self, rewards: Sequence[float]) -> list[float]:
        """The rewards of the turn that was just played, after the change."""
        state = self._engine.state
        over = not state.movers
        if self._mdp is None or (state.mdp is self._mdp and not over):
            return list(rewards)
        before = self._value
        self._mdp = None if over else state.mdp
        self._value = np.zeros(1) if over else self._transformation.values([state.mdp])
        both = np.full(len(rewards), 1.0)
        return self._transformation.rewards(np.array(rewards, np.float64), before * both, self._value * both).tolist()


class TransformedAgent:
    """A wrapper from one agent's side. What it does to actions and masks concerns the proposer, in its turn."""

    def __init__(
        self, env: Any, agent: str, name: str, transformation_class: Does, settings: Mapping[str, Any]
    ) -> None:
        """Raises WrongEnvironment for a wrapper that speaks of the MDP's own actions."""
        base: BaseGameEnv = env.unwrapped
        both, actions = env.observation_space(agent), env.action_space(agent)
        if not isinstance(both, spaces.Dict):
            raise WrongEnvironment(f'{name} needs the game with observations="nested", not {both}')
        description = EnvDescription(name, base.tasks, base.dynamics, both[SEEN], actions)
        self.transformation = transformation_class(description, **settings)
        if self.transformation.concerns_actions:
            raise WrongEnvironment(f"{name} speaks of the MDP's actions; the agents of this game have others")
        self.observation_space = spaces.Dict({SEEN: self.transformation.observation_space(), MASK: both[MASK]})
        self._engine = base.engine
        self.rewards = (
            TransformedRewards(self.transformation, base.engine) if self.transformation.changes_rewards else None
        )
        self._role = Role(AGENTS.index(agent))
        self._entries: Info = {}  # what became of the agent's last action

    def reset(self) -> None:
        self._entries = {}
        if self.rewards is not None:
            self.rewards.reset()

    def observation(self, observation: AgentObservation) -> dict[str, Any]:
        seen, mask = observation[SEEN], observation[MASK]
        state = self._state(mask)
        if self.transformation.changes_observations:
            seen = _first(self.transformation.observations(batch_of_one(seen), state))
        if self._proposes:
            narrowed = mask * self.transformation.legal(state)[0]
            mask = narrowed if narrowed.any() else mask
        return {SEEN: seen, MASK: mask}

    def info(self, info: Info, observe: Callable[[], Any]) -> Info:
        """The agent's info; `observe` returns its observation after this wrapper."""
        info = {**info, **self._entries}
        if self.transformation.adds_infos:
            mask = observe()[MASK]
            told = self.transformation.added_infos(info, self._state(mask))
            info |= {name: mask if name == MASK else plain(value[0]) for name, value in told.items()}
        return info

    def action(self, action: Any) -> Any:
        """The action to take in the game."""
        if action is None or not self.transformation.changes_actions or not self._proposes:
            self._entries = {}
            return action
        game = self._engine.game
        choice, word = divmod(int(action), game.message_sizes[self._role] + 1)
        choices, entries = self.transformation.actions(np.array([choice]), self._state(None))
        if int(choices[0]) not in game.choices[self._role]:  # where the verifier alone may stop
            return action
        self._entries = {name: plain(value[0]) for name, value in entries.items()}
        return game.encode_action(self._role, int(choices[0]), word)

    @property
    def _proposes(self) -> bool:
        return self._role is Role.PROPOSER and Role.PROPOSER in self._engine.state.movers

    def _state(self, mask: Int8Array | None) -> GameEnvState:
        return GameEnvState(self.transformation.env_description, self._engine, mask)


def _first(batch: Batch) -> Any:
    """The one value of a batch. Numbers stay NumPy's, as PettingZoo's tests demand."""
    return {name: _first(part) for name, part in batch.items()} if isinstance(batch, dict) else batch[0]


class GameEnvState(StatesOf):
    """The `EnvState` of a game for one agent; `mask`: its legal actions, None when nobody asks."""

    def __init__(self, description: EnvDescription, engine: Any, mask: Int8Array | None) -> None:
        super().__init__(description, (engine.state.mdp,))
        self._mask = mask

    def legal(self) -> BoolArray:
        assert self._mask is not None
        return self._mask[None].astype(np.bool_)


class AECGameWrapper(BaseWrapper[str, Any, Any]):
    """The turn-by-turn form behind a wrapper."""

    def __init__(self, env: AECEnv[str, Any, Any], name: str, adapters: Mapping[str, TransformedAgent]) -> None:
        super().__init__(env)
        self.name = name
        self.transformation = adapters[AGENTS[Role.PROPOSER]].transformation
        self.adapters = adapters  # by agent; SingleAgentView plays through them
        self._told: dict[str, Info] | None = None  # this turn's infos, once somebody has asked for them
        self._added: dict[str, float] = {}  # to each agent's reward of this turn
        self._all_added: dict[str, float] = {}  # and to its rewards since it last acted

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        return self.adapters[agent].observation_space

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> None:
        super().reset(seed, options)
        self._told = None
        self._added = dict.fromkeys(map(str, AGENTS), 0.0)
        self._all_added = dict.fromkeys(map(str, AGENTS), 0.0)
        for adapter in self.adapters.values():
            adapter.reset()

    def step(self, action: Any) -> None:
        agent = self.agent_selection if self.agents else None
        super().step(self.adapters[agent].action(action) if agent else action)
        self._told = None
        if agent and self.transformation.changes_rewards:
            self._change_rewards(agent)

    def _change_rewards(self, actor: str) -> None:
        rewards = [self.env.rewards.get(agent, 0.0) for agent in AGENTS]
        self._all_added[actor] = 0.0
        for agent, role, reward in zip(AGENTS, Role, rewards, strict=True):
            change = self.adapters[agent].rewards
            assert change is not None
            self._added[agent] = change.transform(rewards)[role] - reward
            self._all_added[agent] += self._added[agent]

    @property
    def rewards(self) -> dict[str, float]:
        return {agent: reward + self._added.get(agent, 0.0) for agent, reward in self.env.rewards.items()}

    @property
    def _cumulative_rewards(self) -> dict[str, float]:
        beneath: Mapping[str, float] = self.env._cumulative_rewards
        return {agent: reward + self._all_added.get(agent, 0.0) for agent, reward in beneath.items()}

    def observe(self, agent: str) -> Any:
        observation = super().observe(agent)
        return None if observation is None else self.adapters[agent].observation(observation)

    @property
    def infos(self) -> dict[str, Info]:
        if self._told is None:
            look = {agent: partial(self.observe, agent) for agent in self.env.infos}
            self._told = {agent: self.adapters[agent].info(info, look[agent]) for agent, info in self.env.infos.items()}
            if self.transformation.changes_rewards:
                for agent, info in self._told.items():
                    info[UNCHANGED_REWARD] = self.env.rewards[agent]
        return self._told

    def __str__(self) -> str:
        return f"{self.name}<{self.env}>"


class ParallelGameWrapper(BaseParallelWrapper[str, Any, Any]):
    """The form in which both agents act in every step, behind a wrapper."""

    def __init__(self, env: ParallelEnv[str, Any, Any], name: str, adapters: Mapping[str, TransformedAgent]) -> None:
        super().__init__(env)
        self.name = name
        self.transformation = adapters[AGENTS[Role.PROPOSER]].transformation
        self.adapters = adapters  # by agent; SingleAgentView plays through them

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        return self.adapters[agent].observation_space

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Info]]:
        observations, infos = super().reset(seed, options)
        for adapter in self.adapters.values():
            adapter.reset()
        return self._shown(observations, infos)

    def step(self, actions: Mapping[str, Any]) -> tuple[dict[str, Any], Any, Any, Any, dict[str, Info]]:
        if self.agents and actions.keys() == self.adapters.keys():  # else the game itself says what is wrong
            actions = {agent: self.adapters[agent].action(action) for agent, action in actions.items()}
        observations, rewards, terminated, truncated, infos = super().step(dict(actions))
        shown, told = self._shown(observations, infos)
        if self.transformation.changes_rewards:
            for agent, info in told.items():
                info[UNCHANGED_REWARD] = rewards[agent]
            rewards = self._changed(rewards)
        return shown, rewards, terminated, truncated, told

    def _changed(self, rewards: Mapping[str, float]) -> dict[str, float]:
        both = [rewards[agent] for agent in AGENTS]
        changes = {agent: self.adapters[agent].rewards for agent in AGENTS}
        return {agent: change.transform(both)[Role(AGENTS.index(agent))] for agent, change in changes.items() if change}

    def _shown(
        self, observations: Mapping[str, Any], infos: Mapping[str, Info]
    ) -> tuple[dict[str, Any], dict[str, Info]]:
        shown = {agent: self.adapters[agent].observation(observation) for agent, observation in observations.items()}
        return shown, {
            agent: self.adapters[agent].info(info, partial(shown.get, agent)) for agent, info in infos.items()
        }

    def __str__(self) -> str:
        return f"{self.name}<{self.env}>"
