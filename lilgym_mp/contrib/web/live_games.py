"""Proposer-verifier games with people in one or both seats, kept in memory."""

from __future__ import annotations

import secrets
import threading
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from fastapi import HTTPException

from lilgym_mp.envs.proposer_verifier import Partner, PartnerError, PartnerTurn, Role
from lilgym_mp.envs.proposer_verifier.engine import GameEngine
from lilgym_mp.envs.proposer_verifier.partners import partner_action

MAX_GAMES = 300  # beyond that the least recently used game is dropped
MAX_GAMES_PER_VISITOR = 10
MAX_PARTNER_TURNS = 500  # turns in a row without a person's action


@dataclass(eq=False)
class LiveGame:
    """A game in progress: its engine, the two seats, and bookkeeping outside of the game state.

    Pairs are indexed by Role.
    """

    visitor: str  # who started it
    engine: GameEngine
    partners: tuple[Partner | None, Partner | None]  # None: a person
    opposite: tuple[str, str]  # name of the other seat's player
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(secrets.randbits(64)))
    chosen: list[int | None] = field(default_factory=lambda: [None, None])  # actions of the turn under way
    own_actions: tuple[list[str], list[str]] = field(default_factory=lambda: ([], []))
    rewards: list[float] = field(default_factory=lambda: [0.0, 0.0])  # summed over the game
    lock: threading.Lock = field(default_factory=threading.Lock)

    @property
    def over(self) -> bool:
        return not self.engine.movers

    def legal(self, role: Role) -> list[int]:
        """Indices of the agent's legal actions except "wait"; empty if it has chosen or the game is over."""
        if self.over or self.chosen[role] is not None:
            return []
        wait = self.engine.game.wait_actions[role]
        return [index for index in np.flatnonzero(self.engine.observe(role)["action_mask"]).tolist() if index != wait]

    def advance(self) -> None:
        """Plays turns until a person must act or the game is over. Responds with 422 if a partner cannot play."""
        try:
            for _ in range(MAX_PARTNER_TURNS):
                movers = self.engine.movers
                if not movers or any(self._choose(role) is None for role in movers):
                    return
                proposer, verifier = (self.chosen[role] if role in movers else None for role in Role)
                result = self.engine.step(proposer, verifier)
                self.chosen = [None, None]
                self.rewards = [total + reward for total, reward in zip(self.rewards, result.rewards, strict=True)]
        except (PartnerError, ValueError) as fault:
            raise HTTPException(422, f"the partner cannot play this game: {fault}") from None

    def _choose(self, role: Role) -> int | None:
        """The role's action in this turn, asking its partner if necessary; None if a person has yet to choose."""
        partner = self.partners[role]
        if self.chosen[role] is None and partner is not None:
            self.chosen[role] = partner_action(partner, PartnerTurn(self.engine.games, role, self.rng))
        return self.chosen[role]


class LiveGames:
    """Games in progress, by seat key; limited in number."""

    def __init__(self) -> None:
        self._seats: dict[str, tuple[LiveGame, Role]] = {}
        self.games: dict[LiveGame, None] = {}  # the least recently used first
        self._lock = threading.Lock()

    def add(self, game: LiveGame, roles: Iterable[Role]) -> dict[Role, str]:
        """Adds a game, dropping old ones beyond the limits; returns a new key for each of the roles."""
        keys = {role: secrets.token_urlsafe(18) for role in roles}
        with self._lock:
            self.games[game] = None
            own = [other for other in self.games if other.visitor == game.visitor]
            for dropped in {*own[:-MAX_GAMES_PER_VISITOR], *list(self.games)[:-MAX_GAMES]}:
                del self.games[dropped]
            kept = {key: seat for key, seat in self._seats.items() if seat[0] in self.games}
            self._seats = kept | {key: (game, role) for role, key in keys.items()}
        return keys

    def find(self, key: str) -> tuple[LiveGame, Role]:
        """The game and role of a seat. Responds with 404 for an unknown key."""
        with self._lock:
            if key not in self._seats:
                raise HTTPException(404, "there is no such seat: its game is too old, or the server was restarted")
            game = self._seats[key][0]
            self.games[game] = self.games.pop(game)
            return self._seats[key]
