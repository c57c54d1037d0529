"""Proposer-verifier games with people in one or both seats, kept in memory.

A seat's response contains only its agent's observation and action mask, its own past actions, and the settings chosen
for the game. Infos, the other seat's observation, and anything about the task outside of the view never leave this
module while the game is played. Once it is over, each seat learns its own reward, and both learn how it ended.
"""

from __future__ import annotations

import secrets
import threading
import time
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from lilgym_mp.actions import ActionError, describe, named
from lilgym_mp.corpus import CorpusError
from lilgym_mp.envs.proposer_verifier import (
    SCRIPTED,
    GameSettings,
    Intent,
    Partner,
    PartnerError,
    PartnerTurn,
    Role,
    View,
    read_text,
)
from lilgym_mp.envs.proposer_verifier.engine import GameEngine
from lilgym_mp.envs.proposer_verifier.partners import partner_action
from lilgym_mp.envs.proposer_verifier.protocols import AGENTS, NO_CHOICE, STOP_ACTION
from lilgym_mp.envs.proposer_verifier.views import GameSetup
from lilgym_mp.evaluation import Settings
from lilgym_mp.web.bodies import Body, Reward, SceneBody, scene_body
from lilgym_mp.web.errors import http_error
from lilgym_mp.web.field_types import ItemType

PERSON = "person"
PROPOSERS = ("helpful", "sneaky", "by_intent", "random")  # scripted partners for the proposer's seat
VERIFIERS = ("oracle", "always_accept", "always_reject", "random")
HISTORY_TURNS = 6  # past turns in each seat's observation
FULL_VIEW = "everything"
VIEWS: Mapping[str, View] = {
    FULL_VIEW: View(scene="image", statement="text", target=True, proposal=True, history=HISTORY_TURNS),
    "no picture": View(scene="none", statement="text", target=True, proposal=True, history=HISTORY_TURNS),
    "no statement": View(scene="image", statement="none", target=True, proposal=True, history=HISTORY_TURNS),
    "no target": View(scene="image", statement="text", target=False, proposal=True, history=HISTORY_TURNS),
}
MAX_GAMES = 300  # beyond that the least recently used game is evicted
MAX_GAMES_PER_VISITOR = 10
IDLE_SECONDS = 2 * 3600.0  # until an unused game is evicted
MAX_PARTNER_TURNS = 500  # turns in a row without a person's action


class PastTurnBody(Body):
    """A past turn as this seat observes it. Null: no action taken; message 0: silence."""

    proposal: str | None
    answer: str | None
    proposer_message: int
    verifier_message: int


class EndBody(Body):
    """How a game ended, revealed to both seats: whether the statement got the target value, and what each seat knew."""

    reached: bool
    statement: str
    value: bool  # of the statement in the last scene
    target: bool
    intent: str
    views: dict[str, str]  # by role


class SeatBody(Body):
    """What the agent in this seat observes. Parts excluded from its view are null."""

    role: str
    protocol: str
    configuration: str
    horizon: int
    opposite: str  # "person" or the partner's name
    view: str
    end: EndBody | None  # null until the game is over
    over: bool
    round: int  # from 1
    your_turn: bool
    waiting_for_other: bool  # simultaneous moves: this seat has chosen, the other has not
    own_actions: list[str]
    reward: Reward | None  # this seat's return; null until the game is over
    grid: tuple[int, int] | None  # columns, rows; null in Tower
    scene: SceneBody | None
    statement: str | None
    target: bool | None
    intent: str | None
    proposal: str | None
    message: int | None
    history: list[PastTurnBody]
    answers: list[str]  # legal answers of the verifier, by name
    may_stop: bool  # whether the proposer may propose STOP now


class NewGameBody(Body):
    """Keys of the seats taken by people; null for a partner's seat. Whoever holds a key controls that seat."""

    proposer: str | None
    verifier: str | None


@dataclass
class LiveGame:
    """A game in progress: its engine, the two seats, and bookkeeping outside of the game state.

    Pairs are indexed by Role.
    """

    visitor: str  # who started it
    configuration: str
    engine: GameEngine
    views: tuple[str, str]  # names in VIEWS
    partners: tuple[Partner | None, Partner | None]  # None: a person
    opposite: tuple[str, str]  # name of the other seat's player
    rng: np.random.Generator
    last_used: float = field(default_factory=time.monotonic)
    chosen: list[int | None] = field(default_factory=lambda: [None, None])  # actions of the turn under way
    own_actions: tuple[list[str], list[str]] = field(default_factory=lambda: ([], []))
    rewards: list[float] = field(default_factory=lambda: [0.0, 0.0])  # summed over the game
    lock: threading.Lock = field(default_factory=threading.Lock)

    @property
    def over(self) -> bool:
        return not self.engine.state.movers

    def legal(self, role: Role) -> list[int]:
        """Indices of the agent's legal actions except "wait"."""
        wait = self.engine.game.wait_actions[role]
        return [index for index in np.flatnonzero(self.engine.observe(role)["action_mask"]).tolist() if index != wait]

    def act(self, role: Role, action: int) -> None:
        """Takes a person's action, then plays partners' turns until a person must act. Raises PartnerError."""
        self.own_actions[role].append(self.engine.game.describe(role, action))
        self.chosen[role] = action
        self.advance()

    def advance(self) -> None:
        """Plays turns until a person must act or the game is over. Raises PartnerError."""
        for _ in range(MAX_PARTNER_TURNS):
            movers = self.engine.state.movers
            if not movers or any(self._choose(role) is None for role in movers):
                return
            proposer, verifier = (self.chosen[role] if role in movers else None for role in Role)
            step = self.engine.step(proposer, verifier)
            self.chosen = [None, None]
            self.rewards = [total + reward for total, reward in zip(self.rewards, step.rewards, strict=True)]

    def _choose(self, role: Role) -> int | None:
        """The role's action in this turn, asking its partner if necessary; None if a person has yet to choose."""
        partner = self.partners[role]
        if self.chosen[role] is None and partner is not None:
            self.chosen[role] = partner_action(partner, PartnerTurn(self.engine, role, self.rng))
        return self.chosen[role]


class LiveGames:
    """All games in progress, by seat key; limited in number and idle time."""

    def __init__(self) -> None:
        self._seats: OrderedDict[str, tuple[LiveGame, Role]] = OrderedDict()
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
        return len({id(game) for game, _ in self._seats.values()})

    def _evict(self, visitor: str) -> None:
        """Drops idle games, then the least recently used beyond the limits, counting one to be added by the visitor."""
        now = time.monotonic()
        games = sorted({id(game): game for game, _ in self._seats.values()}.values(), key=lambda game: game.last_used)
        alive = [game for game in games if now - game.last_used <= IDLE_SECONDS]
        own = [game for game in alive if game.visitor == visitor]
        dropped = {id(game) for game in games} - {id(game) for game in alive}
        dropped |= {id(game) for game in own[: max(0, len(own) - MAX_GAMES_PER_VISITOR + 1)]}
        left = [game for game in alive if id(game) not in dropped]
        dropped |= {id(game) for game in left[: max(0, len(left) - MAX_GAMES + 1)]}
        for key in [key for key, (game, _) in self._seats.items() if id(game) in dropped]:
            del self._seats[key]


@lru_cache(maxsize=64)
def game_setup(
    corpus: str,
    configuration: str,
    split: str,
    protocol: str,
    rewards: str,
    verdict_bins: int | None,
    views: tuple[str, str],
) -> GameSetup:
    """Raises ValueError for settings that do not go together, CorpusError for missing tasks."""
    settings = Settings(configuration, corpus)
    return GameSettings(
        appearance=settings.appearance,
        start=settings.start,
        protocol=protocol,
        rewards=rewards,
        verdict_bins=verdict_bins,
        corpus=corpus,
        split=split,
        views={agent: VIEWS[view] for agent, view in zip(AGENTS, views, strict=True)},
        image_size="native",
    ).setup()


def new_game(
    visitor: str, corpus: str, chosen: Mapping[str, Any], names: tuple[str, str], partners: Mapping[str, Partner]
) -> LiveGame:
    """Starts a game and plays until a person must act; `names`: PERSON or a partner, by Role.

    `chosen` has configuration, split, protocol, rewards, verdict_bins, proposer_view and verifier_view. Responds with
    404 if there are no such tasks, 422 if the settings do not go together.
    """
    views = chosen["proposer_view"], chosen["verifier_view"]
    try:
        keys = ("configuration", "split", "protocol", "rewards", "verdict_bins")
        setup = game_setup(corpus, *(chosen[key] for key in keys), views)
    except CorpusError as fault:
        raise http_error(404, str(fault)) from None
    except ValueError as fault:
        raise http_error(422, str(fault)) from None
    engine = GameEngine(setup)
    engine.reset(secrets.randbelow(2**31), None)
    game = LiveGame(
        visitor,
        chosen["configuration"],
        engine,
        views,
        tuple(None if name == PERSON else partners[name] for name in names),  # pyright: ignore[reportArgumentType]
        (names[1], names[0]),
        np.random.default_rng(secrets.randbits(64)),
    )
    with _partner_errors():
        game.advance()
    return game


@contextmanager
def _partner_errors() -> Iterator[None]:
    """Responds with 422 if a partner cannot play."""
    try:
        yield
    except (PartnerError, ValueError) as fault:
        raise http_error(422, f"the partner cannot play this game: {fault}") from None


def scripted_partners(role: Role) -> dict[str, Partner]:
    return {name: SCRIPTED[name] for name in (PROPOSERS if role is Role.PROPOSER else VERIFIERS)}


def seat_body(live: LiveGame, role: Role) -> SeatBody:
    game = live.engine.game
    observation = live.engine.observe(role)["observation"]
    has_chosen = live.chosen[role] is not None
    legal = [] if live.over or has_chosen else live.legal(role)
    appearance = game.config.dynamics.appearance
    target, intent, message = (observation.get(name) for name in ("target", "intent", "message"))
    stop = game.encode_action(Role.PROPOSER, STOP_ACTION)
    return SeatBody(
        role=role.name.lower(),
        protocol=game.protocol.name,
        configuration=live.configuration,
        horizon=game.config.dynamics.horizon,
        opposite=live.opposite[role],
        view=live.views[role],
        end=_end_body(live) if live.over else None,
        over=live.over,
        round=live.engine.state.mdp.steps + 1,
        your_turn=bool(legal),
        waiting_for_other=has_chosen,
        own_actions=live.own_actions[role],
        reward=live.rewards[role] if live.over else None,
        grid=appearance.grid,
        scene=scene_body(live.engine.state.mdp.scene) if "image" in observation else None,
        statement=read_text(observation["statement"]) if "statement" in observation else None,
        target=None if target is None else bool(target),
        intent=None if intent is None else Intent(int(intent)).name.lower(),
        proposal=_proposal(live, observation.get("proposal")),
        message=None if message is None else int(message),
        history=[_past_turn(live, row) for row in observation.get("history", ())],
        answers=[game.describe(role, index) for index in legal] if role is Role.VERIFIER else [],
        may_stop=role is Role.PROPOSER and stop in legal,
    )


def _end_body(live: LiveGame) -> EndBody:
    state = live.engine.state
    task, value = state.mdp.task, state.mdp.task.truth(state.mdp.scene)
    return EndBody.of(
        task,
        reached=value is task.target,
        value=value,
        intent=state.intent.name.lower(),
        views={role.name.lower(): live.views[role] for role in Role},
    )


def _proposal(live: LiveGame, array: Any) -> str | None:
    """The name of an action in the released array form; None for no action."""
    if array is None or array[0] == NO_CHOICE:
        return None
    return describe(live.engine.game.config.dynamics.appearance.from_array(array))


def _past_turn(live: LiveGame, row: Any) -> PastTurnBody:
    game = live.engine.game
    *array, answer, proposer_message, verifier_message = row.tolist()
    answers = game.protocol.answers(game.config)
    return PastTurnBody(
        proposal=_proposal(live, np.array(array)),
        answer=answers[answer] if 0 <= answer < len(answers) else None,
        proposer_message=max(0, proposer_message),
        verifier_message=max(0, verifier_message),
    )


def legal_names(live: LiveGame, role: Role, item_type: ItemType) -> list[str]:
    """Names of the seat's legal actions by its action mask; of Scatter's ADDs only those of matching items."""
    if live.over or live.chosen[role] is not None:
        return []
    game = live.engine.game
    if role is Role.VERIFIER:
        return [game.describe(role, index) for index in live.legal(role)]
    appearance = game.config.dynamics.appearance
    messages = game.message_sizes[role] + 1  # an action index encodes (edit, message)
    actions = dict.fromkeys(appearance.decode(index // messages) for index in live.legal(role))
    return [describe(action) for action in actions if item_type.matches(action)]


def act(live: LiveGame, role: Role, name: str, own_actions: int) -> None:
    """Takes a person's action by name; `own_actions` is the number of actions the seat had taken when it chose.

    Responds with 409 if the game is over, it is not the seat's turn, the count is stale or the action illegal; with 422
    for an unknown name.
    """
    if live.over:
        raise http_error(409, "the game is over; start a new one")
    if len(live.own_actions[role]) != own_actions:
        raise http_error(409, "you have acted since, perhaps in another window; reload the page")
    legal = [] if live.chosen[role] is not None else live.legal(role)
    if not legal:
        raise http_error(409, "it is not your turn")
    index = _action_index(live, role, name, legal)
    if index not in legal:
        raise http_error(409, f"{name} is not legal now; nothing was done")
    with _partner_errors():
        live.act(role, index)


def _action_index(live: LiveGame, role: Role, name: str, legal: Iterable[int]) -> int:
    """The agent's action index for a name. Responds with 422 for an unknown name."""
    game = live.engine.game
    if role is Role.VERIFIER:
        answers = {game.describe(role, index): index for index in legal}
        if name not in answers:
            raise http_error(422, f"{name!r} is not a legal answer; choose from {', '.join(answers)}")
        return answers[name]
    try:
        return game.encode_action(role, game.config.dynamics.appearance.encode(named(name)))
    except ActionError as fault:
        raise http_error(422, str(fault)) from None
