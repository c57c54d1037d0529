"""Many games at once in one process, results equal to those of the parallel form."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NoReturn, overload

import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from numpy.typing import NDArray

from lilgym_mp.actions import ActionError
from lilgym_mp.arrays import Int64Array
from lilgym_mp.envs.buffers import refuse_copying
from lilgym_mp.envs.checks import checked_flag, checked_seed
from lilgym_mp.envs.draws import next_draws
from lilgym_mp.envs.proposer_verifier.game import TurnError
from lilgym_mp.envs.proposer_verifier.game_arrays import GameArrays
from lilgym_mp.envs.proposer_verifier.session import (
    AgentObservation,
    Info,
    agent_spaces,
    both_infos,
    chosen_intent,
    truth_info,
)
from lilgym_mp.envs.proposer_verifier.settings import Settings
from lilgym_mp.envs.proposer_verifier.states import AGENTS, Intent, Role
from lilgym_mp.envs.proposer_verifier.views import ImagePart, make_parts

BatchStep = tuple[
    dict[str, AgentObservation],
    dict[str, NDArray[np.float64]],  # (N,)
    NDArray[np.bool_],  # (N,) terminated
    NDArray[np.bool_],  # (N,) truncated
    dict[str, Any],
]


class BatchedGames:
    """N games of the parallel form; a game that ends starts anew in the same step.

    Observations as those of `parallel_env` with a leading axis of N. Rewards by agent; both agents end together.
    Infos: "turns", bool (N, 2), whose turn it is now; and where games ended, "final_observation" (LastObservations) and
    "final_info", sequences of N: None, or what the parallel form gives by agent.
    """

    def __init__(self, num_games: int, *, copy: bool = True, **settings: Any) -> None:
        """`copy=False`: images are the same array in every step, valid until the next.

        Raises ValueError for a number that is not positive, and as the other forms do.
        """
        if isinstance(num_games, bool) or not isinstance(num_games, int) or num_games < 1:
            raise ValueError(f"num_games must be a positive whole number, not {num_games!r}")
        setup = self._setup = Settings.of(**settings).setup()
        self.num_games = num_games
        self.possible_agents = list(AGENTS)
        self.single_observation_spaces: dict[str, spaces.Dict] = {}
        self.single_action_spaces: dict[str, spaces.Discrete] = {}
        self._parts = make_parts(setup)
        for agent, parts, count in zip(AGENTS, self._parts, setup.game.action_counts, strict=True):
            self.single_observation_spaces[agent], self.single_action_spaces[agent] = agent_spaces(parts, count)
        self._copies = checked_flag("copy", copy)
        self._games = GameArrays(setup, num_games)
        self._every = np.arange(num_games)
        self._is_started = False
        self._generators: list[np.random.Generator] = []  # none before the first reset
        self._draws: list[list[int]] = [[] for _ in range(num_games)]  # of tasks to come, the next one last

    def __reduce__(self) -> NoReturn:
        refuse_copying(self)

    def reset(
        self, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, AgentObservation], dict[str, Any]]:
        """Starts every game; game i is seeded with `seed` + i. `options` as those of the parallel form, for all."""
        seed = checked_seed(seed)
        if seed is not None or not self._generators:
            seeds = [None if seed is None else seed + number for number in range(self.num_games)]
            self._generators = [seeding.np_random(seed)[0] for seed in seeds]
            self._draws = [[] for _ in seeds]
        self._start(self._every, options or {})
        self._is_started = True
        return self._observations(), {"turns": self._games.moves.T.copy()}

    def _start(self, indices: Int64Array, options: Mapping[str, Any]) -> None:
        """Starts some games, each with a task and an intent of its own generator's, in this order."""
        setup = self._setup
        task = setup.tasks.number(options["task"]) if "task" in options else None
        intent = chosen_intent(options)
        if intent is None:
            intent = setup.usual_intent
        tasks = np.empty(len(indices), np.int64)
        intents = np.full(len(indices), 0 if intent is None else int(intent))
        for place, number in enumerate(indices.tolist()):
            tasks[place] = self._drawn_task(number) if task is None else task
            if intent is None:
                intents[place] = int(setup.drawn_intent(self._generators[number]))
        self._games.start(indices, tasks, intents)

    def _drawn_task(self, number: int) -> int:
        generator, setup = self._generators[number], self._setup
        if setup.usual_intent is None:  # tasks and intents come by turns
            return setup.drawn_task(generator)
        if not self._draws[number]:
            self._draws[number] = next_draws(generator, len(setup.tasks))
        return self._draws[number].pop()

    def step(self, actions: Mapping[str, NDArray[np.integer[Any]]]) -> BatchStep:
        """`actions`: (N,) whole numbers by agent. Errors as in the parallel form, and for arrays of another shape."""
        if not self._is_started:
            raise ResetNeeded("there are no games before the first reset; call reset first")
        games = self._games
        games.play(*self._checked(actions))
        rewards, terminated, truncated = games.rewards, games.terminated, games.truncated
        ended = np.flatnonzero(terminated | truncated)
        infos: dict[str, Any] = {}
        if len(ended):
            infos = self._final(ended)
            self._start(ended, {})
        infos["turns"] = games.moves.T.copy()
        return self._observations(), dict(zip(AGENTS, rewards, strict=True)), terminated, truncated, infos

    def _checked(self, actions: Mapping[str, NDArray[np.integer[Any]]]) -> list[Int64Array]:
        """Both agents' actions, by Role."""
        if set(actions) != set(AGENTS):
            raise TurnError(f"actions must be of {' and '.join(AGENTS)}, not of {', '.join(actions) or 'nobody'}")
        return [self._checked_row(role, np.asarray(actions[AGENTS[role]])) for role in Role]

    def _checked_row(self, role: Role, row: NDArray[Any]) -> Int64Array:
        if row.shape != (self.num_games,) or row.dtype.kind not in "iu":
            raise ActionError(
                f"actions of {AGENTS[role]} must be {self.num_games} whole numbers, not {row.dtype} {row.shape}"
            )
        game = self._setup.game
        if row.astype(np.uint64, copy=False).max() >= game.action_counts[role]:  # which negative numbers are as well
            for action in row.tolist():  # one of them is refused
                game.checked(role, action)
        return row.astype(np.int64, copy=False)

    def _observations(self) -> dict[str, AgentObservation]:
        return self._observed(self._every, copies_images=self._copies)

    def _observed(self, indices: Int64Array, *, copies_images: bool = True) -> dict[str, AgentObservation]:
        """What the agents see of games (k,): arrays (k, ...). What both see alike is encoded once."""
        games = self._games
        rows: dict[int, NDArray[Any]] = {}
        for part in (part for parts in self._parts for part in parts.values()):
            if isinstance(part, ImagePart) and not copies_images:
                rows[id(part)] = games.images
            elif id(part) not in rows:
                rows[id(part)] = part.rows(games, indices)
        return {
            AGENTS[role]: {
                "observation": {key: rows[id(part)] for key, part in self._parts[role].items()},
                "action_mask": games.masks(role, indices),
            }
            for role in Role
        }

    def _final(self, ended: Int64Array) -> dict[str, Any]:
        """What infos tell of the games (k,) that have just ended."""
        infos: list[dict[str, Info] | None] = [None] * self.num_games
        for number in ended.tolist():
            infos[number] = self._last_infos(number)
        observations = LastObservations(self.num_games, ended, self._observed(ended))
        return {"final_observation": observations, "final_info": tuple(infos)}

    def _last_infos(self, number: int) -> dict[str, Info]:
        """Both agents' infos of a game that has just ended."""
        setup, games = self._setup, self._games
        shared: Info = {}
        if setup.reveals_truth:
            intent = Intent(int(games.intents[number]))
            shared = truth_info(setup, games.mdp(number), intent, games.last_judgement(number))
        infos = both_infos(shared | games.last_end(number), games.last_illegal(number))
        return dict(zip(AGENTS, infos, strict=True))

    def close(self) -> None:
        """Nothing is held beside memory."""


class LastObservations(Sequence[dict[str, AgentObservation] | None]):
    """By game, what each agent saw last, as the parallel form gives it; None where a game goes on.

    Each is made when it is asked for, out of arrays of those that ended.
    """

    def __init__(self, num_games: int, ended: Int64Array, stacked: dict[str, AgentObservation]) -> None:
        self.numbers = ended  # (k,) of the games that ended
        self.stacked = stacked  # arrays (k, ...) of what their agents saw
        self._num_games = num_games

    def __len__(self) -> int:
        return self._num_games

    @overload
    def __getitem__(self, number: int) -> dict[str, AgentObservation] | None: ...
    @overload
    def __getitem__(self, number: slice) -> tuple[dict[str, AgentObservation] | None, ...]: ...
    def __getitem__(self, number: int | slice) -> Any:
        indices = range(self._num_games)[number]
        return self._of(indices) if isinstance(indices, int) else tuple(map(self._of, indices))

    def _of(self, number: int) -> dict[str, AgentObservation] | None:
        for place in (self.numbers == number).nonzero()[0].tolist():
            return {agent: _at(place, observation) for agent, observation in self.stacked.items()}
        return None


def _at(place: int, observation: AgentObservation) -> AgentObservation:
    return {
        "observation": {key: array[place] for key, array in observation["observation"].items()},
        "action_mask": observation["action_mask"][place],
    }
