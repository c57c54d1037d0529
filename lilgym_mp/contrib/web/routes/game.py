"""/game: take a seat in a proposer-verifier game with a partner or another person.

A seat's response contains only its agent's observation and action mask, its own past actions, and the settings chosen
for the game. Infos, the other seat's observation, and anything about the task outside of the view never leave the
server while the game is played. Once it is over, each seat learns its own reward, and both learn how it ended.
"""

from __future__ import annotations

import secrets
from contextlib import suppress
from functools import lru_cache
from typing import Annotated

from fastapi import APIRouter, HTTPException, Request, Response
from pydantic import BaseModel, Field

from lilgym_mp.contrib.web.app_services import AppServices, Services
from lilgym_mp.contrib.web.bodies import (
    JSON,
    ConfigurationName,
    Name,
    PresetName,
    ProtocolName,
    RandomId,
    changed_item,
    pick,
    removable_items,
    scene_body,
)
from lilgym_mp.contrib.web.live_games import LiveGame
from lilgym_mp.contrib.web.responses import refusing, render_page
from lilgym_mp.contrib.web.routes.play import INVALID_EXPLANATIONS
from lilgym_mp.contrib.web.runs import RUN_PREFIX, SHIPPED_PREFIX
from lilgym_mp.envs.proposer_verifier import (
    PRESETS,
    PROTOCOLS,
    SCRIPTED,
    Game,
    GameSettings,
    Intent,
    Partner,
    Role,
    View,
    read_text,
)
from lilgym_mp.envs.proposer_verifier.engine import GameEngine
from lilgym_mp.envs.proposer_verifier.protocols import AGENTS, NO_CHOICE, STOP_ACTION
from lilgym_mp.evaluation.game_partners import ExpertProposer
from lilgym_mp.scene.actions import ActionError, describe, named
from lilgym_mp.scene.arrays import Int64Array

router = APIRouter()
api = APIRouter(prefix="/api/game", tags=["game"])

PERSON = "person"
EXPERT = "expert"
PARTNER_TITLES: dict[str, str] = {
    EXPERT: "expert: edits towards its goal",
    "helpful": "helpful: edits at random, claims if true",
    "deceptive": "deceptive: edits at random, claims if false",
    "by_intent": "by intent: helpful or deceptive, as drawn",
    "oracle": "oracle: knows the truth",
}
SCRIPTED_PARTNERS: dict[Role, tuple[str, ...]] = {  # by the seat they can take
    Role.PROPOSER: (EXPERT, "helpful", "deceptive", "by_intent", "random"),
    Role.VERIFIER: ("oracle", "always_accept", "always_reject", "random"),
}
VIEW = View(scene="image", statement="text", target=True, proposal=True, history=6)
PartnerName = Annotated[str, Field(max_length=100, pattern=r"^[\w:.-]+$", description="person, or a partner's name")]


class NewGame(BaseModel):
    """Settings of a game and who takes each seat; at least one must be a person."""

    configuration: ConfigurationName = "TowerScratch"
    protocol: ProtocolName = "veto"
    rewards: PresetName = "common"
    proposer: PartnerName = PERSON
    verifier: PartnerName = "oracle"


class SeatAction(BaseModel):
    """An action by name, such as ADD(LEFT, BLUE) or accept, and the number of actions this seat took before."""

    action: Name
    own_actions: int = Field(ge=0, le=100_000)


@router.get("/game", include_in_schema=False)
def game_page(request: Request, services: Services) -> Response:
    """The page of the two-agent game, with the choices of its form."""
    return render_page(
        request,
        "game.html",
        configurations=list(services.sizes()),
        protocols=list(PROTOCOLS),
        protocol_rules=list(PROTOCOLS.values()),
        rewards=list(PRESETS),
        proposers=_players(services, Role.PROPOSER),
        verifiers=_players(services, Role.VERIFIER),
    )


def _players(services: AppServices, role: Role) -> dict[str, str]:
    """Titles of those who can take the seat."""
    scripted = {name: PARTNER_TITLES.get(name, name.replace("_", " ")) for name in SCRIPTED_PARTNERS[role]}
    return {PERSON: "a person", **scripted, **services.runs.agents()}


@api.post("/games", status_code=201)
def begin(new: NewGame, services: Services) -> JSON:
    """Starts a game; returns a key for each seat taken by a person, who controls it; null for a partner's seat."""
    if PERSON not in (new.proposer, new.verifier):
        raise HTTPException(422, "at least one of the seats must be taken by a person")
    with refusing():
        engine = GameEngine(_game(services.corpus, new.configuration, new.protocol, new.rewards))
    proposer, verifier = (_partner(services, role, new, engine.game.settings) for role in Role)
    engine.reset(secrets.randbelow(2**31), None)
    opposite = [_opposite(name) for name in (new.verifier, new.proposer)]
    game = LiveGame(engine, (proposer, verifier), (opposite[0], opposite[1]))
    game.advance()
    keys = services.games.add(game, [role for role in Role if game.partners[role] is None])
    return {"proposer": keys.get(Role.PROPOSER), "verifier": keys.get(Role.VERIFIER)}


def _opposite(name: str) -> str:
    """Such as "an oracle (knows the truth)"."""
    title, _, does = PARTNER_TITLES.get(name, name).partition(": ")
    article = "an" if title[0] in "aeio" else "a"
    return f"{article} {title} ({does})" if does else title


def _partner(services: AppServices, role: Role, new: NewGame, settings: GameSettings) -> Partner | None:
    """The partner in that seat; None for a person. Responds with 404 or 422 if it cannot take it."""
    name = new.proposer if role is Role.PROPOSER else new.verifier
    if name == PERSON:
        return None
    if name.startswith((SHIPPED_PREFIX, RUN_PREFIX)):
        return services.runs.partner(name, role, settings)
    known = SCRIPTED_PARTNERS[role]
    if name not in known:
        raise HTTPException(422, f"{name!r} cannot be {role.name.lower()}; choose from person, {', '.join(known)}")
    if name != EXPERT:
        return SCRIPTED[name]
    with refusing():
        return ExpertProposer(services.dynamics(new.configuration), intent=None)


@lru_cache(maxsize=64)
def _game(corpus: str, configuration: str, protocol: str, rewards: str) -> Game:
    """Raises ValueError for settings that do not go together, CorpusError for missing tasks."""
    settings = GameSettings(
        configuration,
        corpus,
        split="dev",
        protocol=protocol,
        rewards=rewards,
        views=dict.fromkeys(AGENTS, VIEW),
        image_size="native",
    )
    return Game(settings)


@api.get("/seats/{key}")
def seat(key: RandomId, services: Services) -> JSON:
    """The present observation of the agent in this seat."""
    game, role = services.games.find(key)
    with game.lock:
        return _seat_body(game, role)


@api.get("/seats/{key}/legal")
def legal(key: RandomId, services: Services) -> JSON:
    """This seat's legal actions by its action mask."""
    live, role = services.games.find(key)
    game = live.engine.game
    with live.lock:
        legal = live.legal(role)
    if role is Role.VERIFIER:
        return {"actions": [game.describe(role, index) for index in legal]}
    messages = game.message_sizes[role] + 1  # an action index encodes (edit, message)
    actions = dict.fromkeys(game.dynamics.appearance.decode(index // messages) for index in legal)
    return {"actions": [describe(action) for action in actions]}


@api.post("/seats/{key}/actions")
def act(key: RandomId, taken: SeatAction, services: Services) -> JSON:
    """Takes an action in this seat; partners then play until a person must act.

    `own_actions` must be the number of actions that the seat has taken: another window may have acted since.
    """
    live, role = services.games.find(key)
    with live.lock:
        if live.over:
            raise HTTPException(409, "the game is over; start a new one")
        if len(live.own_actions[role]) != taken.own_actions:
            raise HTTPException(409, "you have acted since, perhaps in another window; reload the page")
        legal = {live.engine.game.describe(role, index): index for index in live.legal(role)}
        if not legal:
            raise HTTPException(409, "it is not your turn")
        if taken.action not in legal:
            raise HTTPException(409, f"{taken.action} is not legal now{_reason(live, taken.action)}; nothing was done")
        live.own_actions[role].append(taken.action)
        live.chosen[role] = legal[taken.action]
        live.advance()
        return _seat_body(live, role)


def _reason(live: LiveGame, name: str) -> str:
    """Why an edit is illegal; empty for what is none."""
    dynamics = live.engine.game.dynamics
    scene = live.engine.state.mdp.scene
    with suppress(ActionError):
        invalid = dynamics.appearance.apply(scene, named(name), dynamics.rules.placement).invalid
        return "" if invalid is None else f": {INVALID_EXPLANATIONS[invalid]}"
    return ""


def _seat_body(live: LiveGame, role: Role) -> JSON:
    """The observation of the agent in this seat. Parts excluded from its view are null."""
    game = live.engine.game
    state = live.engine.state
    observation = live.engine.observe(role)["observation"]
    legal = live.legal(role)
    intent = observation.get("intent")
    message = observation.get("message")
    stop = game.encode_action(Role.PROPOSER, STOP_ACTION)
    dynamics = game.dynamics
    scene = state.mdp.scene
    proposed = None if state.proposal is None else dynamics.appearance.decode(state.proposal)
    return {
        "role": role.name.lower(),
        "protocol": game.protocol.name,
        "configuration": game.settings.configuration,
        "horizon": dynamics.horizon,
        "opposite": live.opposite[role],  # "person" or the partner's name
        "end": _end_body(live) if live.over else None,
        "over": live.over,
        "round": state.mdp.steps + 1,
        "your_turn": bool(legal),
        "waiting_for_other": live.chosen[role] is not None,  # simultaneous moves: the other has not chosen
        "own_actions": live.own_actions[role],
        "reward": round(live.rewards[role], 6) if live.over else None,
        "grid": dynamics.appearance.grid,  # columns, rows; null in Tower
        "scene": scene_body(scene),
        "statement": read_text(observation["statement"]),
        "target": bool(observation["target"]),
        "intent": None if intent is None else Intent(int(intent)).name.lower(),
        "proposal": None if proposed is None else describe(proposed),
        "proposed_item": changed_item(scene, live.engine.games.proposed_scene(0)),  # null for STOP
        "removable": removable_items(dynamics, scene) if legal and role is Role.PROPOSER else {},
        "message": None if message is None else int(message),
        "history": [_past_turn(game, turn) for turn in live.engine.games.history[0]],
        "answers": [game.describe(role, index) for index in legal] if role is Role.VERIFIER else [],
        "may_stop": role is Role.PROPOSER and stop in legal,
    }


def _end_body(live: LiveGame) -> JSON:
    """The end of the game, revealed to both seats: the value reached, and what each knew."""
    state = live.engine.state
    task = state.mdp.task
    value = state.mdp.task.truth(state.mdp.scene)
    return {
        **pick(task, "statement", "target"),
        "reached": value is task.target,
        "value": value,
        "intent": state.intent.name.lower(),
    }


def _past_turn(game: Game, turn: Int64Array) -> JSON:
    """A past turn. Null: no action taken; message 0: silence."""
    proposal, answer, proposer_message, verifier_message = turn.tolist()
    return {
        "proposal": None if proposal == NO_CHOICE else describe(game.dynamics.appearance.decode(proposal)),
        "answer": None if answer == NO_CHOICE else game.protocol.answers[answer],
        "proposer_message": max(0, proposer_message),
        "verifier_message": max(0, verifier_message),
    }
