"""Games of proposer and verifier with people in one seat or both, kept in memory while they are played.

What a seat is told comes from its agent's observation and action mask, from what it did itself and from the settings
that were chosen for the game; nothing of the environment's infos, of the other seat's view or of the task beyond the
view leaves this module. Rewards are told when the game is over, each seat its own.
"""

from __future__ import annotations

import secrets
import threading
import time
from collections import OrderedDict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from pydantic import BaseModel

from lilgym_mp.actions import ActionError, AddItem, describe, named
from lilgym_mp.appearances import Scatter
from lilgym_mp.corpus import CorpusError
from lilgym_mp.envs.proposer_verifier import (
    SCRIPTED,
    Partner,
    PartnerError,
    PartnerTurn,
    Role,
    Settings,
    View,
    read_text,
)
from lilgym_mp.envs.proposer_verifier.engine import GameEngine
from lilgym_mp.envs.proposer_verifier.partners import partner_action
from lilgym_mp.envs.proposer_verifier.types import AGENTS, NO_CHOICE, STOP_ACTION, Intent
from lilgym_mp.envs.proposer_verifier.views import GameSetup
from lilgym_mp.evaluation import Settings as Configuration
from lilgym_mp.web.errors import refusal
from lilgym_mp.web.scene_body import SceneBody, scene_body

PERSON = "person"
PROPOSERS = ("helpful", "sneaky", "by_intent", "random")  # scripts that can propose
VERIFIERS = ("oracle", "always_accept", "always_reject", "random")
REMEMBERED = 6  # turns that each seat sees of the past
WHOLE_VIEW = "everything"
VIEWS: Mapping[str, View] = {
    WHOLE_VIEW: View(scene="image", statement="text", target=True, proposal=True, history=REMEMBERED),
    "no picture": View(scene="none", statement="text", target=True, proposal=True, history=REMEMBERED),
    "no statement": View(scene="image", statement="none", target=True, proposal=True, history=REMEMBERED),
    "no target": View(scene="image", statement="text", target=False, proposal=True, history=REMEMBERED),
}
MOST_GAMES = 300  # in memory; the longest unused one makes room
MOST_OF_ONE = 10  # of one visitor
IDLE_SECONDS = 2 * 3600.0
MOST_TURNS = 500  # of partners after one action of a person


class PastTurnBody(BaseModel):
    """A turn as this seat remembers it; empty where nothing was done or said."""

    proposal: str | None
    answer: str | None
    proposer_word: int
    verifier_word: int


class SeatBody(BaseModel):
    """What the agent in this seat sees. Parts that its view lacks are null."""

    role: str
    protocol: str
    configuration: str
    horizon: int
    opposite: str  # who sits there: a person or a partner's name
    view: str
    over: bool
    your_turn: bool
    waiting_for_other: bool  # both move at once, and this seat has chosen
    own_actions: list[str]
    reward: float | None  # this seat's own, once the game is over
    grid: tuple[int, int] | None  # Scatter's columns and rows
    scene: SceneBody | None
    statement: str | None
    target: bool | None
    intent: str | None
    proposal: str | None
    message: int | None
    history: list[PastTurnBody]
    answers: list[str]  # what a verifier may answer now, by name
    may_stop: bool  # whether a proposer may propose STOP now


class LegalBody(BaseModel):
    """Names of legal actions."""

    actions: list[str]


class NewGameBody(BaseModel):
    """The keys of the seats that people take; whoever has a key sits there."""

    proposer: str | None
    verifier: str | None


@dataclass
class GameRoom:
    """One game: its engine, who sits where, and what happened that is not in the state."""

    visitor: str
    configuration: str
    engine: GameEngine
    views: tuple[str, str]  # names, by Role
    partners: tuple[Partner | None, Partner | None]  # by Role; None for a person
    opposite: tuple[str, str]  # what each is told of the other
    rng: np.random.Generator
    used: float = field(default_factory=time.monotonic)
    chosen: list[int | None] = field(default_factory=lambda: [None, None])  # where both move at once
    own_actions: tuple[list[str], list[str]] = field(default_factory=lambda: ([], []))
    rewards: list[float] = field(default_factory=lambda: [0.0, 0.0])
    lock: threading.Lock = field(default_factory=threading.Lock)

    @property
    def over(self) -> bool:
        return not self.engine.state.movers

    def legal(self, role: Role) -> list[int]:
        """Numbers of the agent's legal actions, "wait" left out."""
        wait = self.engine.game.wait_actions[role]
        return [index for index in np.flatnonzero(self.engine.observe(role)["action_mask"]).tolist() if index != wait]

    def take(self, role: Role, action: int) -> None:
        """A person's action, and all that partners do until a person must act. Raises PartnerError."""
        self.own_actions[role].append(self.engine.game.describe(role, action))
        self.chosen[role] = action
        self.proceed()

    def proceed(self) -> None:
        """Plays on until a person must act or the game is over. Raises PartnerError."""
        for _ in range(MOST_TURNS):
            movers = self.engine.state.movers
            if not movers or any(self._choice(role) is None for role in movers):
                return
            proposer, verifier = (self.chosen[role] if role in movers else None for role in Role)
            step = self.engine.step(proposer, verifier)
            self.chosen = [None, None]
            self.rewards = [total + reward for total, reward in zip(self.rewards, step.rewards, strict=True)]

    def _choice(self, role: Role) -> int | None:
        """What the role does in this turn; None where a person has not chosen yet."""
        partner = self.partners[role]
        if self.chosen[role] is None and partner is not None:
            self.chosen[role] = partner_action(partner, PartnerTurn(self.engine, role, self.rng))
        return self.chosen[role]


class Games:
    """Games by the keys of their seats, limited in number and age."""

    def __init__(self) -> None:
        self._rooms: OrderedDict[str, tuple[GameRoom, Role]] = OrderedDict()
        self._lock = threading.Lock()

    def add(self, room: GameRoom, roles: Iterable[Role]) -> dict[Role, str]:
        """A new key for each seat that a person takes. Old games make room."""
        keys = {role: secrets.token_urlsafe(18) for role in roles}
        with self._lock:
            self._forget(room.visitor)
            for role, key in keys.items():
                self._rooms[key] = room, role
        return keys

    def find(self, key: str) -> tuple[GameRoom, Role]:
        """Answers 404 for a key of no seat."""
        with self._lock:
            found = self._rooms.get(key)
            if found is None or time.monotonic() - found[0].used > IDLE_SECONDS:
                raise refusal(404, "there is no such seat: the game ended long ago, or the server began anew")
            found[0].used = time.monotonic()
        return found

    def __len__(self) -> int:
        """Games, not seats."""
        return len({id(room) for room, _ in self._rooms.values()})

    def _forget(self, visitor: str) -> None:
        """Drops games that are idle, then the longest unused of the visitor and of all that are too many."""
        now = time.monotonic()
        rooms = sorted({id(room): room for room, _ in self._rooms.values()}.values(), key=lambda room: room.used)
        alive = [room for room in rooms if now - room.used <= IDLE_SECONDS]
        own = [room for room in alive if room.visitor == visitor]
        dropped = {id(room) for room in rooms} - {id(room) for room in alive}
        dropped |= {id(room) for room in own[: max(0, len(own) - MOST_OF_ONE + 1)]}
        left = [room for room in alive if id(room) not in dropped]
        dropped |= {id(room) for room in left[: max(0, len(left) - MOST_GAMES + 1)]}
        for key in [key for key, (room, _) in self._rooms.items() if id(room) in dropped]:
            del self._rooms[key]


@lru_cache(maxsize=64)
def setup(
    corpus: str,
    configuration: str,
    split: str,
    protocol: str,
    rewards: str,
    verdict_bins: int | None,
    views: tuple[str, str],
) -> GameSetup:
    """Raises ValueError, CorpusError for what does not exist."""
    chosen = Configuration(configuration, corpus)
    return Settings(
        appearance=chosen.appearance,
        start=chosen.start,
        protocol=protocol,
        rewards=rewards,
        verdict_bins=verdict_bins,
        corpus=corpus,
        split=split,
        views={agent: VIEWS[view] for agent, view in zip(AGENTS, views, strict=True)},
        image_size="native",
    ).setup()


def new_room(
    visitor: str, corpus: str, chosen: Mapping[str, Any], names: tuple[str, str], partners: Mapping[str, Partner]
) -> GameRoom:
    """A game that has begun; `names`: a person or a partner, by Role.

    `chosen` has configuration, split, protocol, rewards, verdict_bins, proposer_view and verifier_view. Answers 404
    where there are no such tasks, 422 where the settings do not go together.
    """
    views = chosen["proposer_view"], chosen["verifier_view"]
    try:
        told = ("configuration", "split", "protocol", "rewards", "verdict_bins")
        made = setup(corpus, *(chosen[name] for name in told), views)
    except CorpusError as fault:
        raise refusal(404, str(fault)) from None
    except ValueError as fault:
        raise refusal(422, str(fault)) from None
    engine = GameEngine(made)
    engine.reset(secrets.randbelow(2**31), None)
    room = GameRoom(
        visitor,
        chosen["configuration"],
        engine,
        views,
        tuple(None if name == PERSON else partners[name] for name in names),  # pyright: ignore[reportArgumentType]
        (names[1], names[0]),
        np.random.default_rng(secrets.randbits(64)),
    )
    _proceed(room.proceed)
    return room


def _proceed(step: Any, *arguments: Any) -> None:
    try:
        step(*arguments)
    except (PartnerError, ValueError) as fault:
        raise refusal(422, f"the partner cannot play this game: {fault}") from None


def scripted(role: Role) -> dict[str, Partner]:
    """Scripts that can take the seat."""
    return {name: SCRIPTED[name] for name in (PROPOSERS if role is Role.PROPOSER else VERIFIERS)}


def seat_body(room: GameRoom, role: Role) -> SeatBody:
    """What the seat may know now."""
    game = room.engine.game
    observation = room.engine.observe(role)["observation"]
    has_chosen = room.chosen[role] is not None
    legal = [] if room.over or has_chosen else room.legal(role)
    appearance = game.config.dynamics.appearance
    target, intent, message = (observation.get(name) for name in ("target", "intent", "message"))
    stop = game.encode_action(Role.PROPOSER, STOP_ACTION)
    return SeatBody(
        role=role.name.lower(),
        protocol=game.protocol.name,
        configuration=room.configuration,
        horizon=game.config.dynamics.horizon,
        opposite=room.opposite[role],
        view=room.views[role],
        over=room.over,
        your_turn=bool(legal),
        waiting_for_other=has_chosen,
        own_actions=room.own_actions[role],
        reward=round(room.rewards[role], 6) if room.over else None,
        grid=appearance.grid if isinstance(appearance, Scatter) else None,
        scene=scene_body(room.engine.state.mdp.scene) if "image" in observation else None,
        statement=read_text(observation["statement"]) if "statement" in observation else None,
        target=None if target is None else bool(target),
        intent=None if intent is None else Intent(int(intent)).name.lower(),
        proposal=_proposal(room, observation.get("proposal")),
        message=None if message is None else int(message),
        history=[_past_turn(room, row) for row in observation.get("history", ())],
        answers=[game.describe(role, index) for index in legal] if role is Role.VERIFIER else [],
        may_stop=role is Role.PROPOSER and stop in legal,
    )


def _proposal(room: GameRoom, array: Any) -> str | None:
    """The name of an action in the released array form."""
    if array is None or array[0] == NO_CHOICE:
        return None
    return describe(room.engine.game.config.dynamics.appearance.from_array(array))


def _past_turn(room: GameRoom, row: Any) -> PastTurnBody:
    game = room.engine.game
    *array, answer, proposer_word, verifier_word = row.tolist()
    answers = game.protocol.answers(game.config)
    return PastTurnBody(
        proposal=_proposal(room, np.array(array)),
        answer=answers[answer] if 0 <= answer < len(answers) else None,
        proposer_word=max(0, proposer_word),
        verifier_word=max(0, verifier_word),
    )


def legal_names(room: GameRoom, role: Role, look: tuple[str | None, str | None, str | None]) -> list[str]:
    """What the seat may do now, by the action mask; of ADDs of items only those of the look."""
    if room.over or room.chosen[role] is not None:
        return []
    game = room.engine.game
    if role is Role.VERIFIER:
        return [game.describe(role, index) for index in room.legal(role)]
    appearance = game.config.dynamics.appearance
    spoken = game.message_sizes[role] + 1
    actions = dict.fromkeys(appearance.decode(index // spoken) for index in room.legal(role))
    return [describe(action) for action in actions if not isinstance(action, AddItem) or _looks(action, look)]


def _looks(action: AddItem, look: tuple[str | None, str | None, str | None]) -> bool:
    names = (action.shape.name, action.colour.name, action.size.name)
    return all(wanted is None or wanted == name for wanted, name in zip(look, names, strict=True))


def act(room: GameRoom, role: Role, name: str, seen: int) -> None:
    """A person's action, by name, after `seen` of its own. Answers 409 where it is not its turn, is not legal now, or
    was taken already, 422 for a name of no action."""
    if room.over:
        raise refusal(409, "the game is over; begin a new one")
    if len(room.own_actions[role]) != seen:
        raise refusal(409, "you have acted since, perhaps in another window; look again")
    legal = [] if room.chosen[role] is not None else room.legal(role)
    if not legal:
        raise refusal(409, "it is not your turn")
    index = _numbered(room, role, name, legal)
    if index not in legal:
        raise refusal(409, f"{name} is not legal now; nothing was done")
    _proceed(room.take, role, index)


def _numbered(room: GameRoom, role: Role, name: str, legal: Iterable[int]) -> int:
    game = room.engine.game
    if role is Role.VERIFIER:
        answers = {game.describe(role, index): index for index in legal}
        if name not in answers:
            raise refusal(422, f"{name!r} is no answer; choose from {', '.join(answers)}")
        return answers[name]
    try:
        return game.encode_action(role, game.config.dynamics.appearance.encode(named(name)))
    except ActionError as fault:
        raise refusal(422, str(fault)) from None
