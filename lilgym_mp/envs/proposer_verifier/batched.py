"""Many games at once in one process, results equal to those of the parallel form."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from lilgym_mp.actions import ActionError
from lilgym_mp.envs.proposer_verifier.game import TurnError
from lilgym_mp.envs.proposer_verifier.session import AgentObservation, Info, Session
from lilgym_mp.envs.proposer_verifier.settings import Settings
from lilgym_mp.envs.proposer_verifier.states import (
    AGENTS,
    BOTH_MOVE,
    PROPOSER,
    PROPOSER_MOVES,
    VERIFIER,
    VERIFIER_MOVES,
    GameState,
    Role,
)
from lilgym_mp.envs.proposer_verifier.views import Part, SharedPart, Value
from lilgym_mp.render import image_shape

BatchStep = tuple[
    dict[str, AgentObservation],
    dict[str, NDArray[np.float64]],  # (N,)
    NDArray[np.bool_],  # (N,) terminated
    NDArray[np.bool_],  # (N,) truncated
    dict[str, Any],
]

_TURNS = {movers: tuple(role in movers for role in Role) for movers in (PROPOSER_MOVES, VERIFIER_MOVES, BOTH_MOVE)}


class _Writer(NamedTuple):
    """One part of one game's observations."""

    encode: Callable[[GameState], Value]
    rows: NDArray[Any] | None  # (N, ...); None for pictures, which are drawn where they lie


class BatchedGames:
    """N games of the parallel form; a game that ends starts anew in the same step.

    Observations as those of `parallel_env` with a leading axis of N. Rewards by agent; both agents end together.
    Infos: "turns", bool (N, 2), whose turn it is now; and where games ended, "final_observation" and "final_info",
    tuples of N, None or what the parallel form gave by agent.
    """

    def __init__(self, num_games: int, *, copy: bool = True, **settings: Any) -> None:
        """`copy=False`: observations are the same arrays in every step, valid until the next.

        Raises ValueError for a number that is not positive, and as the other forms do.
        """
        if isinstance(num_games, bool) or not isinstance(num_games, int) or num_games < 1:
            raise ValueError(f"num_games must be a positive whole number, not {num_games!r}")
        world = Settings.of(**settings).world()
        self.num_games = num_games
        self.possible_agents = list(AGENTS)
        self._copies = copy
        self._images = np.zeros((num_games, *image_shape(world.image_size)), np.uint8)
        self.sessions = [Session(world, pixels=pixels) for pixels in self._images]
        spaces_of = [self.sessions[0].spaces(role) for role in Role]
        self.single_observation_spaces = {agent: of[0] for agent, of in zip(AGENTS, spaces_of, strict=True)}
        self.single_action_spaces = {agent: of[1] for agent, of in zip(AGENTS, spaces_of, strict=True)}
        self._parts = [self._part_arrays(role) for role in Role]
        self._writers = [self._writers_of(session) for session in self.sessions]
        self._masks = [np.zeros((num_games, count), np.int8) for count in world.game.action_counts]
        self._turns = np.zeros((num_games, len(Role)), np.bool_)
        self._has_started = False

    def _part_arrays(self, role: Role) -> dict[str, NDArray[Any]]:
        """(N, ...) for each part. Pictures are drawn where they lie."""
        return {
            key: self._images if isinstance(part, SharedPart) and part.draws else self._rows(part)
            for key, part in self.sessions[0].parts[role].items()
        }

    def _rows(self, part: Part) -> NDArray[Any]:
        return np.zeros((self.num_games, *(part.space.shape or ())), part.space.dtype)

    def _writers_of(self, session: Session) -> tuple[list[_Writer], list[_Writer]]:
        """How to write what changes from turn to turn, and what only a new game changes."""
        changing: list[_Writer] = []
        lasting: list[_Writer] = []
        for role in Role:
            for key, part in session.parts[role].items():
                array = self._parts[role][key]
                writer = _Writer(part.encode, None if array is self._images else array)
                (lasting if part.lasts else changing).append(writer)
        return changing, lasting

    def reset(
        self, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, AgentObservation], dict[str, Any]]:
        """Starts every game; game i is seeded with `seed` + i. `options` as those of the parallel form, for all."""
        for number, session in enumerate(self.sessions):
            session.reset(None if seed is None else seed + number, options)
            self._write(number, is_new=True)
        self._has_started = True
        return self._observations(), {"turns": self._turns.copy()}

    def step(self, actions: Mapping[str, NDArray[np.integer[Any]]]) -> BatchStep:
        """`actions`: (N,) whole numbers by agent. Errors as in the parallel form, and for arrays of another shape."""
        if not self._has_started:
            raise ResetNeeded("there are no games before the first reset; call reset first")
        proposers, verifiers = self._checked(actions)
        rewards = np.zeros((len(Role), self.num_games))
        terminated, truncated = np.zeros((2, self.num_games), np.bool_)
        ended: dict[int, tuple[dict[str, AgentObservation], dict[str, Info]]] = {}
        for number, session in enumerate(self.sessions):
            step, infos = session.play_together(proposers[number], verifiers[number])
            rewards[:, number] = step.rewards
            is_over = not step.state.movers
            if is_over:
                terminated[number], truncated[number] = step.terminated, step.truncated
                ended[number] = self._last_observations(session), dict(zip(AGENTS, infos, strict=True))
                session.reset(None, None)
            self._write(number, is_new=is_over)
        infos = {"turns": self._turns.copy(), **self._final(ended)}
        return self._observations(), dict(zip(AGENTS, rewards, strict=True)), terminated, truncated, infos

    def _checked(self, actions: Mapping[str, NDArray[np.integer[Any]]]) -> tuple[list[int], list[int]]:
        if set(actions) != set(AGENTS):
            raise TurnError(f"actions must be of {' and '.join(AGENTS)}, not of {', '.join(actions) or 'nobody'}")
        arrays = [np.asarray(actions[agent]) for agent in AGENTS]
        for agent, array in zip(AGENTS, arrays, strict=True):
            if array.shape != (self.num_games,) or array.dtype.kind not in "iu":
                raise ActionError(
                    f"actions of {agent} must be {self.num_games} whole numbers, not {array.dtype} {array.shape}"
                )
        return arrays[0].tolist(), arrays[1].tolist()

    def _write(self, number: int, *, is_new: bool) -> None:
        """Puts a game's observations into its rows."""
        session = self.sessions[number]
        state, game = session.state, session.game
        changing, lasting = self._writers[number]
        for encode, rows in changing:
            value = encode(state)
            if rows is not None:
                rows[number] = value
        if is_new:
            for encode, rows in lasting:
                if rows is not None:
                    rows[number] = encode(state)
        self._masks[PROPOSER][number] = game.legal_mask(state, PROPOSER)
        self._masks[VERIFIER][number] = game.legal_mask(state, VERIFIER)
        self._turns[number] = _TURNS[state.movers]

    def _observations(self) -> dict[str, AgentObservation]:
        kept: dict[int, NDArray[Any]] = {}  # what both agents see is copied once

        def given(array: NDArray[Any]) -> NDArray[Any]:
            if not self._copies:
                return array
            if id(array) not in kept:
                kept[id(array)] = array.copy()
            return kept[id(array)]

        return {
            AGENTS[role]: {
                "observation": {key: given(array) for key, array in self._parts[role].items()},
                "action_mask": given(self._masks[role]),
            }
            for role in Role
        }

    def _last_observations(self, session: Session) -> dict[str, AgentObservation]:
        observations = {AGENTS[role]: session.observe(role) for role in Role}
        for observation in observations.values():
            parts = observation["observation"]
            if "image" in parts:
                parts["image"] = parts["image"].copy()
        return observations

    def _final(self, ended: Mapping[int, tuple[dict[str, AgentObservation], dict[str, Info]]]) -> dict[str, Any]:
        if not ended:
            return {}
        results = [ended.get(number, (None, None)) for number in range(self.num_games)]
        return {
            "final_observation": tuple(observation for observation, _ in results),
            "final_info": tuple(info for _, info in results),
        }

    def close(self) -> None:
        """Nothing is held beside memory."""
