"""The two-agent game as a Stable-Baselines3 `VecEnv`: one seat against a partner, or both seats for one policy."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, cast

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper, VecMonitor
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvObs, VecEnvStepReturn

from lilgym_mp.envs.proposer_verifier.engine import ROLES, agent_spaces, reset_options
from lilgym_mp.envs.proposer_verifier.game import Game
from lilgym_mp.envs.proposer_verifier.observations import MASK, PARTS, ObservedGames
from lilgym_mp.envs.proposer_verifier.partners import BatchTurn, Partner, batch_actions, checked_partner
from lilgym_mp.envs.proposer_verifier.protocols import AGENTS, Role
from lilgym_mp.envs.proposer_verifier.settings import GameSettings
from lilgym_mp.envs.proposer_verifier.single_agent import MAX_RESETS
from lilgym_mp.scene.arrays import AnyDict, Int64Array, Rng
from lilgym_mp.scene.choices import checked_count, choose

BOTH = "both"
SEATS = {**{agent: (role,) for agent, role in ROLES.items()}, BOTH: tuple(Role)}


class GameVecEnv(VecEnv):
    """N games stepped together. A seat's rows are what `SingleAgentView` gives; of both seats, rows 2 i and 2 i + 1 are
    the proposer and the verifier of game i, in steps of one turn.

    Infos have "agent", and at the end of a game "terminal_observation", "TimeLimit.truncated" and the game's outcome.
    """

    def __init__(self, num_games: int, agent: str, partner: Partner | str | None, **settings: Any) -> None:
        """Arguments as for `make_game_vec_env`."""
        self._roles = choose("agent", agent, SEATS)
        if (agent == BOTH) != (partner is None):
            needed = "takes no partner" if agent == BOTH else "needs a partner for the other seat"
            raise ValueError(f"agent={agent!r} {needed}, not partner={partner!r}")
        self._partner = None if partner is None else checked_partner(partner)
        if agent == BOTH:
            settings = {**settings, "homogeneous": True}
        self._num_games = checked_count("n_envs", num_games)
        game = Game(GameSettings.of(settings))
        self._games = games = ObservedGames(game, num_games)
        first = self._roles[0]
        nested, actions = agent_spaces(games.parts[first], game.action_counts[first])
        self._all = np.arange(num_games)
        self._episodes = np.zeros(num_games, np.int64)
        self._generators: list[Rng] = []
        self._actions = np.zeros((len(Role), num_games), np.int64)  # indexed by role, like the next
        self._returns = np.zeros((len(Role), num_games))  # of this step
        self._infos: list[AnyDict] = []  # of this step, by row
        super().__init__(num_games * len(self._roles), cast("spaces.Dict", nested[PARTS]), actions)

    def reset(self) -> VecEnvObs:
        """Options "task" and "intent", as for the game, hold for the next games. Game i is seeded with `seed` + i."""
        seed, *_ = self._seeds
        if seed is not None or not self._generators:
            seeds = [None if seed is None else seed + index for index in range(self._num_games)]
            self._generators = [seeding.np_random(each)[0] for each in seeds]
        self._start(self._all, self._options[:: len(self._roles)])
        self._reset_seeds()
        self._reset_options()
        return self._observations(self._all)

    def step_async(self, actions: np.ndarray) -> None:
        """`actions` (rows,). Raises ActionError for one outside the action space."""
        given = np.asarray(actions).reshape(self._num_games, len(self._roles))
        for role, column in zip(self._roles, given.T, strict=True):
            for action in np.unique(column).tolist():
                self._games.game.checked_action(role, action)
            self._actions[role] = column

    def step_wait(self) -> VecEnvStepReturn:
        self._begin()
        movers = self._games.movers
        if self._partner is not None:
            self._choose(np.flatnonzero(movers[self._other]))
        self._play(self._all)
        self._play_partner(self._all)
        over = ~movers.any(0)
        infos = self._infos
        rewards = self._rows([self._returns[role] for role in self._roles]).astype(np.float32)
        if over.any():
            self._end(np.flatnonzero(over), infos)
        return self._observations(self._all), rewards, np.repeat(over, len(self._roles)), infos

    def _begin(self) -> None:
        """Forgets the rewards and infos of the last step."""
        self._returns[:] = 0
        self._infos = [{"agent": agent} for agent in self.get_attr("agent")]

    def _end(self, ended: Int64Array, infos: list[AnyDict]) -> None:
        """Completes the infos of games (k,) that have just ended, and starts others."""
        last = self._observations(ended)
        rows = self._rows_of(ended)
        for place, row in enumerate(rows):
            infos[row]["terminal_observation"] = {key: part[place] for key, part in last.items()}
            infos[row]["TimeLimit.truncated"] = not self._games.terminated[row // len(self._roles)]
        self._start(ended)

    def _start(self, indices: Int64Array, options: Sequence[Any] | None = None) -> None:
        """Starts games (k,), again where one ends before a seat that learns has had a turn."""
        self._begin()
        rows = self._rows_of(indices)
        game = self._games.game
        for _ in range(MAX_RESETS):
            chosen = [reset_options(options[index] if options else None) for index in indices.tolist()]
            drawn: list[tuple[int, int]] = []
            for index, (choice, intent) in zip(indices.tolist(), chosen, strict=True):
                rng = self._generators[index]
                task = game.sample_task_index(rng) if choice is None else self._games.index_of(choice)
                drawn.append((task, int(game.sample_intent(rng) if intent is None else intent)))
            self._games.start(indices, *np.array(drawn, np.int64).T)
            self._episodes[indices] = self._episodes.max() + 1 + np.arange(len(indices))
            self._play_partner(indices)
            indices = indices[~self._games.movers[:, indices].any(0)]
            if not len(indices):
                break
        else:
            partner = self._partner
            agent = AGENTS[self._roles[0]]
            raise RuntimeError(f"{agent} had no turn in {MAX_RESETS} games with partner {partner!r}")
        for row in rows:
            self.reset_infos[row] = self._infos[row]

    def _play_partner(self, indices: Int64Array) -> None:
        """The partner plays in those of games (k,) where it alone is to move, until it no longer is."""
        seat = self._roles[0]
        wait = self._games.game.wait_actions[seat]
        while self._partner is not None:
            movers = self._games.movers[:, indices]
            indices = indices[movers[self._other] & ~movers[seat]]
            if not len(indices):
                return
            self._choose(indices)
            if wait is not None:
                self._actions[seat, indices] = wait
            self._play(indices)

    @property
    def _other(self) -> Role:
        """The partner's."""
        return self._roles[0].other

    def _choose(self, indices: Int64Array) -> None:
        """The partner chooses its actions in games (k,)."""
        if not len(indices):
            return
        assert self._partner is not None
        rngs = [self._generators[index] for index in indices.tolist()]
        turn = BatchTurn(self._games, self._other, indices, self._episodes[indices], rngs)
        self._actions[self._other, indices] = batch_actions(self._partner, turn)

    def _play(self, indices: Int64Array) -> None:
        """Plays a turn of games (k,) with the actions chosen, and adds up rewards and infos."""
        games = self._games
        proposers, verifiers = self._actions
        games.step(proposers, verifiers, None if len(indices) == self._num_games else indices)
        self._returns[:, indices] += games.rewards[:, indices]
        for index in indices[games.have_infos[indices]].tolist():
            infos = games.infos(index)
            for row, role in zip(self._rows_of(np.array([index])), self._roles, strict=True):
                self._infos[row] |= infos[role]

    def _rows_of(self, indices: Int64Array) -> list[int]:
        """The rows of games (k,)."""
        count = len(self._roles)
        return (indices[:, None] * count + np.arange(count)).ravel().tolist()

    def _rows(self, columns: Sequence[np.ndarray]) -> np.ndarray:
        """(k * seats, ...) from one array (k, ...) for each seat."""
        return np.stack(columns, 1).reshape(-1, *columns[0].shape[1:])

    def _observations(self, indices: Int64Array) -> dict[str, np.ndarray]:
        seen = [self._games.observe(role, indices)[PARTS] for role in self._roles]
        return {key: self._rows([parts[key] for parts in seen]) for key in seen[0]}

    def action_masks(self) -> np.ndarray:
        """(rows, actions) bool: the legal actions; out of turn "wait" alone."""
        return self._rows([self._games.masks(role, self._all) for role in self._roles]).astype(bool)

    def env_method(self, method_name: str, *args: Any, indices: VecEnvIndices = None, **kwargs: Any) -> Any:
        """The rows' "action_masks". Raises AttributeError for another method."""
        return [method(*args, **kwargs) for method in self.get_attr(method_name, indices)]

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """The rows' "agent" or "action_masks". Raises AttributeError for others."""
        rows = list(self._get_indices(indices))
        if attr_name == "render_mode":
            return [None for _ in rows]
        if attr_name == "agent":
            return [AGENTS[self._roles[row % len(self._roles)]] for row in rows]
        if attr_name != "action_masks":
            raise AttributeError(f"games in a batch have no {attr_name!r}; choose from action_masks, agent")
        masks = self.action_masks()
        return [partial(masks.__getitem__, row) for row in rows]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        raise AttributeError(f"cannot set {attr_name!r} of games in a batch")

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: VecEnvIndices = None) -> list[bool]:
        return [False for _ in self._get_indices(indices)]

    def close(self) -> None:
        """Nothing is open."""


def make_game_vec_env(
    n_envs: int,
    agent: str = BOTH,
    partner: Partner | str | None = None,
    *,
    seed: int | None = None,
    monitor: bool = True,
    **settings: Any,
) -> VecEnv:
    """`n_envs` games in one process, for MaskablePPO.

    Args:
        n_envs: The number of games.
        agent: The seat that learns, with a row for each game; or "both", for one policy, with two rows for each game.
        partner: Who plays the other seat: a name such as "oracle", a function of a `PartnerTurn`, or the partner of a
            trained agent. None with "both".
        seed: Game i is seeded with `seed` + i.
        monitor: Whether infos report each row's returns and lengths at the end of a game.
        settings: As for `GameSettings`. With "both", spaces are homogeneous.

    Raises ValueError naming the choices, TypeError for a partner that cannot be called.
    """
    env = GameVecEnv(n_envs, agent, partner, **settings)
    if seed is not None:
        env.seed(seed)
    return VecMonitor(env) if monitor else env


class InfoMasks(VecEnvWrapper):
    """Masks from infos, where SuperSuit's vector environments of the game with `observations="vector"` have them:
    MaskablePPO finds them around `concat_vec_envs_v1(..., base_class="stable_baselines3")`."""

    def __init__(self, venv: Any) -> None:
        super().__init__(venv)
        self._masks: list[np.ndarray] = []

    def reset(self) -> VecEnvObs:
        observations = self.venv.reset()
        self._masks = [info[MASK] for info in self.venv.reset_infos]
        return observations

    def step_wait(self) -> VecEnvStepReturn:
        observations, rewards, dones, infos = self.venv.step_wait()
        self._masks = [info[MASK] for info in infos]  # after a game's end, of the next game
        return observations, rewards, dones, infos

    def has_attr(self, attr_name: str) -> bool:
        return attr_name == "action_masks" or self.venv.has_attr(attr_name)

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """As that of `venv`, whose environments SuperSuit does not ask for "render_mode"."""
        return self.venv.get_attr(attr_name, indices) if attr_name != "render_mode" else [None] * self.num_envs

    def env_method(self, method_name: str, *args: Any, indices: VecEnvIndices = None, **kwargs: Any) -> Any:
        """The rows' "action_masks", or another method of `venv`."""
        if method_name == "action_masks":
            return [self._masks[row].astype(bool) for row in self._get_indices(indices)]
        return self.venv.env_method(method_name, *args, indices=indices, **kwargs)
