"""A batch of games in one process, with the same results as single parallel environments."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NoReturn

import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from numpy.typing import NDArray

from lilgym_mp.corpus import TaskSet
from lilgym_mp.envs.buffers import refuse_copying
from lilgym_mp.envs.checks import check_open, checked_flag, checked_seed
from lilgym_mp.envs.proposer_verifier.engine import agent_spaces, reset_options
from lilgym_mp.envs.proposer_verifier.game import Game, TurnError
from lilgym_mp.envs.proposer_verifier.game_arrays import Info
from lilgym_mp.envs.proposer_verifier.observations import MASK, PARTS, AgentObservation, ObservedGames
from lilgym_mp.envs.proposer_verifier.protocols import AGENTS, Role
from lilgym_mp.envs.proposer_verifier.rewards import Intent
from lilgym_mp.envs.proposer_verifier.settings import GameSettings
from lilgym_mp.scene.actions import ActionError
from lilgym_mp.scene.arrays import AnyDict, AnyMapping, BoolArray, Float64Array, Int64Array, Rng
from lilgym_mp.scene.choices import checked_count

BatchStep = tuple[
    dict[str, AgentObservation],
    dict[str, Float64Array],  # (N,)
    BoolArray,  # (N,) terminated
    BoolArray,  # (N,) truncated
    AnyDict,
]


# A function of the indices (k,) of the games that start, which returns the indices (k,) of their tasks.
TaskSampler = Callable[[Int64Array], NDArray[np.integer[Any]]]


class BatchedGames:
    """N games stepped together; a game that ends is reset in the same step.

    Observations as from `parallel_env` with a leading axis (N,). Rewards by agent; both agents end together. Infos,
    of the games now in play:
    - "turns", bool (N, 2): which agents are to move;
    - "task_index", int (N,): index in `tasks`, `len(tasks)` for a `Task` of the caller;
    - "proposal", int (N,): the pending proposal, an action index of the MDP, -1 if there is none;
    - "goal_reached", bool (N,), only with `reveal_truth`: whether the statement has the target value.
    Of the turn just played:
    - "own_turn_rewards", float (N, 2): each agent's rewards since its last own turn, complete where it is to move again
      or the game ended;
    - "verdict", int (N,): 1 where the verifier accepted a claim, 0 where it rejected one, otherwise -1;
    - "holds", bool (N,), only with `reveal_truth`: whether the judged claim holds;
    - "is_success", bool (N,): whether the game ended in success;
    - if any game ended, "final_observation" and "final_info", tuples of N with None for games that go on, otherwise the
      last observations or infos by agent, as from `parallel_env`.
    """

    def __init__(
        self,
        num_games: int,
        *,
        tasks: TaskSet | None = None,
        sampler: TaskSampler | None = None,
        copy: bool = True,
        **settings: Any,
    ) -> None:
        """Makes all games; `reset` starts them.

        Args:
            num_games: The number of games, N.
            tasks: Played instead of the split's, such as augmented or held-out ones.
            sampler: Chooses the tasks of games that start; None: uniformly, each game with its own generator.
            copy: False: the image array is reused, so valid only until the next step.
            settings: The fields of GameSettings.

        Raises:
            ValueError: Unless `num_games` is positive, for bad settings, and for tasks of another appearance.
        """
        game = Game(GameSettings.of(settings))
        self._game = game = game if tasks is None else game.with_tasks(tasks)
        self._sampler = sampler
        self.num_games = num_games = checked_count("num_games", num_games)
        self.possible_agents = list(AGENTS)
        self.single_observation_spaces: dict[str, spaces.Dict] = {}
        self.single_action_spaces: dict[str, spaces.Discrete] = {}
        self._games = ObservedGames(game, num_games)
        for agent, parts, count in zip(AGENTS, self._games.parts, game.action_counts, strict=True):
            self.single_observation_spaces[agent], self.single_action_spaces[agent] = agent_spaces(parts, count)
        self._copies = checked_flag("copy", copy)
        self._all = np.arange(num_games)
        self._own_turn_rewards = np.zeros((len(Role), num_games))
        self._is_started = self._is_closed = False
        self._generators: list[Rng] = []  # empty before the first reset

    def __reduce__(self) -> NoReturn:
        refuse_copying(self)

    def reset(
        self, seed: int | None = None, options: AnyMapping | None = None
    ) -> tuple[dict[str, AgentObservation], AnyDict]:
        """Starts every game.

        Args:
            seed: Game i is seeded with `seed` + i; None keeps the generators.
            options: As for `parallel_env`, for all games.

        Returns:
            Observations by agent, and infos.
        """
        check_open(closed=self._is_closed)
        seed = checked_seed(seed)
        choice, intent = reset_options(options)
        task = None if choice is None else self._games.index_of(choice)
        if seed is not None or not self._generators:
            seeds = [None if seed is None else seed + index for index in range(self.num_games)]
            self._generators = [seeding.np_random(seed)[0] for seed in seeds]
        self._start(self._all, task, intent)
        self._is_started = True
        return self._observations(), self._infos()

    @property
    def tasks(self) -> TaskSet:
        """The tasks played; "task_index" in infos is an index of it."""
        return self._game.tasks

    def _start(self, indices: Int64Array, task: int | None = None, intent: Intent | None = None) -> None:
        """Starts games (k,); each draws a task and an intent that are None, in that order, from its own generator."""
        game = self._game
        generators = [self._generators[index] for index in indices.tolist()]
        if task is None and self._sampler is not None:
            tasks = self._sampled(indices)
        else:
            tasks = np.array([game.sample_task_index(rng) if task is None else task for rng in generators])
        intents = np.array([game.sample_intent(rng) if intent is None else intent for rng in generators])
        self._own_turn_rewards[:, indices] = 0
        self._games.start(indices, tasks, intents)

    def _sampled(self, indices: Int64Array) -> Int64Array:
        """(k,) the sampler's tasks for games (k,). Raises ValueError for anything but k task indices."""
        assert self._sampler is not None
        tasks = np.asarray(self._sampler(indices))
        count = len(self.tasks)
        if tasks.shape != indices.shape or tasks.dtype.kind not in "iu" or ((tasks < 0) | (tasks >= count)).any():
            raise ValueError(f"the sampler must return {len(indices)} task indices 0 .. {count - 1}, not {tasks!r}")
        return tasks.astype(np.int64, copy=False)

    def step(self, actions: Mapping[str, NDArray[np.integer[Any]]]) -> BatchStep:
        """Takes one action of each agent in each game.

        Args:
            actions: Integers (N,) by agent.

        Returns:
            Observations, rewards, terminated, truncated and infos.

        Raises:
            ActionError: For a wrong shape or type; other errors as for `parallel_env`.
        """
        if not self._is_started or self._is_closed:
            check_open(closed=self._is_closed)
            raise ResetNeeded("call reset first")
        games = self._games
        proposers, verifiers = self._checked_actions(actions)
        moved = games.movers.copy()
        games.step(proposers, verifiers)
        self._own_turn_rewards = np.where(moved, 0.0, self._own_turn_rewards) + games.rewards
        rewards: dict[str, Float64Array] = dict(zip(AGENTS, games.rewards.copy(), strict=True))
        terminated = games.terminated.copy()
        truncated = games.truncated.copy()
        ended = np.flatnonzero(terminated | truncated)
        infos: AnyDict = {
            "own_turn_rewards": self._own_turn_rewards.T.copy(),
            "verdict": games.verdicts,
            "is_success": games.successes,
        }
        if self._game.reveals_truth:
            infos["holds"] = games.holds
        if len(ended):
            infos |= self._final_infos(ended)
            self._start(ended)
        infos |= self._infos()
        return self._observations(), rewards, terminated, truncated, infos

    def _infos(self) -> AnyDict:
        """The info entries of the games now in play."""
        games = self._games
        infos = {"turns": games.movers.T.copy(), "task_index": games.tasks.copy(), "proposal": games.proposals.copy()}
        if self._game.reveals_truth:
            infos["goal_reached"] = games.goals_reached().copy()
        return infos

    def _checked_actions(self, actions: Mapping[str, NDArray[np.integer[Any]]]) -> list[Int64Array]:
        """Both agents' actions, indexed by role."""
        if set(actions) != set(AGENTS):
            raise TurnError(f"actions must be for {' and '.join(AGENTS)}, not for {', '.join(actions) or 'no agent'}")
        return [self._checked_array(role, np.asarray(actions[AGENTS[role]])) for role in Role]

    def _checked_array(self, role: Role, array: NDArray[Any]) -> Int64Array:
        if array.shape != (self.num_games,) or array.dtype.kind not in "iu":
            raise ActionError(
                f"actions of {AGENTS[role]} must be {self.num_games} whole numbers, not {array.dtype} {array.shape}"
            )
        game = self._game
        if array.astype(np.uint64, copy=False).max() >= game.action_counts[role]:  # negative ones wrap around to large
            for action in array.tolist():  # raises for the first bad one
                game.checked_action(role, action)
        return array.astype(np.int64, copy=False)

    def _observations(self) -> dict[str, AgentObservation]:
        return self._games.observe_both(self._all, copy=self._copies)

    def _final_infos(self, ended: Int64Array) -> AnyDict:
        """The info entries for games (k,) that have just ended."""
        observations: list[dict[str, AgentObservation] | None] = [None] * self.num_games
        infos: list[dict[str, Info] | None] = [None] * self.num_games
        stacked = self._games.observe_both(ended)
        for row, index in enumerate(ended.tolist()):
            infos[index] = dict(zip(AGENTS, self._games.infos(index), strict=True))
            observations[index] = {
                agent: {PARTS: {key: part[row] for key, part in seen[PARTS].items()}, MASK: seen[MASK][row]}
                for agent, seen in stacked.items()
            }
        return {"final_observation": tuple(observations), "final_info": tuple(infos)}

    def close(self) -> None:
        """Afterwards `reset` and `step` raise ClosedEnvironmentError."""
        self._is_closed = True
