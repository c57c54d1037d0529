"""Proposer-verifier games with people in one or both seats, kept in memory."""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from lilgym_mp.contrib.web.errors import http_error
from lilgym_mp.envs.proposer_verifier import Partner, PartnerError, PartnerTurn, Role
from lilgym_mp.envs.proposer_verifier.engine import GameEngine
from lilgym_mp.envs.proposer_verifier.partners import partner_action

MAX_GAMES = 300  # beyond that the least recently used game is evicted
MAX_GAMES_PER_VISITOR = 10
IDLE_SECONDS = 2 * 3600.0  # until an unused game is evicted
MAX_PARTNER_TURNS = 500  # turns in a row without a person's action


@dataclass(eq=False)
class LiveGame:
    """A game in progress: its engine, the two seats, and bookkeeping outside of the game state.

    Pairs are indexed by Role.
    """

    visitor: str  # who started it
    configuration: str
    engine: GameEngine
    views: tuple[str, str]  # names
    partners: tuple[Partner | None, Partner | None]  # None: a person
    opposite: tuple[str, str]  # name of the other seat's player
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(secrets.randbits(64)))
    last_used: float = field(default_factory=time.monotonic)
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
            raise http_error(422, f"the partner cannot play this game: {fault}") from None

    def _choose(self, role: Role) -> int | None:
        """The role's action in this turn, asking its partner if necessary; None if a person has yet to choose."""
        partner = self.partners[role]
        if self.chosen[role] is None and partner is not None:
            self.chosen[role] = partner_action(partner, PartnerTurn(self.engine, role, self.rng))
        return self.chosen[role]


class LiveGames:
    """All games in progress, by seat key; limited in number and idle time."""

    def __init__(self) -> None:
        self._seats: dict[str, tuple[LiveGame, Role]] = {}
        self._lock = threading.Lock()

    def add(self, game: LiveGame, roles: Iterable[Role]) -> dict[Role, str]:
        """Adds a game, evicting old ones; returns a new key for each of the roles."""
        keys = {role: secrets.token_urlsafe(18) for role in roles}
        with self._lock:
            self._evict(game.visitor)
            for role, key in keys.items():
                self._seats[key] = game, role
        return keys

    def find(self, key: str) -> tuple[LiveGame, Role]:
        """The game and role of a seat. Responds with 404 for an unknown or expired key."""
        with self._lock:
            found = self._seats.get(key)
            if found is None or time.monotonic() - found[0].last_used > IDLE_SECONDS:
                raise http_error(404, "there is no such seat: its game has expired, or the server was restarted")
            found[0].last_used = time.monotonic()
        return found

    def __len__(self) -> int:
        """The number of games, not of seats."""
        return len({game for game, _ in self._seats.values()})

    def _evict(self, visitor: str) -> None:
        """Drops idle games, then the least recently used beyond the limits, counting one to be added by the visitor."""
        now, own, kept = time.monotonic(), 1, set[LiveGame]()
        for game in sorted({game for game, _ in self._seats.values()}, key=lambda game: game.last_used, reverse=True):
            own += game.visitor == visitor
            is_surplus = len(kept) >= MAX_GAMES - 1 or (game.visitor == visitor and own > MAX_GAMES_PER_VISITOR)
            if now - game.last_used <= IDLE_SECONDS and not is_surplus:
                kept.add(game)
        self._seats = {key: seat for key, seat in self._seats.items() if seat[0] in kept}
