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

MAX_SEATS = 300  # beyond that the least recently used seat is dropped


@dataclass(eq=False)
class LiveGame:
    """A game in progress: its engine, the two seats, and bookkeeping outside of the game state.

    Pairs are indexed by Role.
    """

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
        """Whether no agent is left to move."""
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
            while (movers := self.engine.movers) and all(self._choose(role) is not None for role in movers):
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
    """Seats in games by key, the least recently used first; limited in number."""

    def __init__(self) -> None:
        self.seats: dict[str, tuple[LiveGame, Role]] = {}
        self._lock = threading.Lock()

    def add(self, game: LiveGame, roles: Iterable[Role]) -> dict[Role, str]:
        """Adds a game, dropping old seats beyond the limit; returns a new key for each of the roles."""
        keys = {role: secrets.token_urlsafe(18) for role in roles}
        with self._lock:
            self.seats |= {key: (game, role) for role, key in keys.items()}
            for dropped in list(self.seats)[:-MAX_SEATS]:
                del self.seats[dropped]
        return keys

    def find(self, key: str) -> tuple[LiveGame, Role]:
        """The game and role of a seat. Responds with 404 for an unknown key."""
        with self._lock:
            if key not in self.seats:
                raise HTTPException(404, "there is no such seat: its game is too old, or the server was restarted")
            seat = self.seats[key] = self.seats.pop(key)
            return seat
