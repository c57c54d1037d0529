"""/game: take a seat in a proposer-verifier game with a partner or another person."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Request, Response
from pydantic import BaseModel, Field

from lilgym_mp.envs.proposer_verifier import PRESETS, PROTOCOLS, Partner, Role
from lilgym_mp.evaluation import Settings
from lilgym_mp.web import field_types, live_games
from lilgym_mp.web.app_services import AppServices, Services
from lilgym_mp.web.authentication import CurrentCaller
from lilgym_mp.web.bodies import LegalBody
from lilgym_mp.web.errors import http_error
from lilgym_mp.web.templating import render_page
from lilgym_mp.web.trained_partners import RUN_PREFIX, SHIPPED_PREFIX

router = APIRouter()
api = APIRouter(prefix="/api/game", tags=["game"])

ViewName = Literal["everything", "no picture", "no statement", "no target"]
VERDICT_BINS = (2, 3, 5, 9)  # choices on the page; at most 9, as each answer has a digit key
PartnerName = Annotated[str, Field(max_length=100, pattern=r"^[\w:.-]+$", description="person, or a partner's name")]


class NewGame(BaseModel):
    """Settings of a game and who takes each seat; at least one must be a person."""

    configuration: field_types.ConfigurationName = "TowerScratch"
    split: field_types.SplitName = "dev"
    protocol: field_types.ProtocolName = "veto"
    rewards: field_types.PresetName = "common"
    verdict_bins: int | None = Field(
        None, ge=2, le=9, description="audit: number of probabilities the verifier chooses from; null: accept or reject"
    )
    proposer: PartnerName = live_games.PERSON
    verifier: PartnerName = "oracle"
    proposer_view: ViewName = "everything"
    verifier_view: ViewName = "everything"


class SeatAction(BaseModel):
    """An action by name, such as ADD(LEFT, BLUE) or accept, and the number of actions this seat took before."""

    action: field_types.Name
    own_actions: int = Field(ge=0, le=100_000)


@router.get("/game", include_in_schema=False)
def game_page(request: Request, services: Services) -> Response:
    return render_page(
        request,
        "game.html",
        sizes=services.catalogue.sizes(),
        protocols=list(PROTOCOLS),
        protocol_rules=list(PROTOCOLS.values()),
        rewards=list(PRESETS),
        verdict_bins=VERDICT_BINS,
        views=list(live_games.VIEWS),
        proposers=live_games.PROPOSERS,
        verifiers=live_games.VERIFIERS,
        trained=services.trained_partners.names(),
    )


@api.post("/games", status_code=201)
def begin(new: NewGame, services: Services, caller: CurrentCaller) -> live_games.NewGameBody:
    """Starts a game; returns a key for each seat taken by a person."""
    names = (new.proposer, new.verifier)
    if live_games.PERSON not in names:
        raise http_error(422, "at least one of the seats must be taken by a person")
    partners = {name: _partner(services, role, name, new) for role, name in zip(Role, names, strict=True)}
    chosen = new.model_dump(exclude={"proposer", "verifier"})
    game = live_games.new_game(
        caller.id,
        services.options.corpus,
        chosen,
        names,
        {name: partner for name, partner in partners.items() if partner is not None},
    )
    roles = [role for role, name in zip(Role, names, strict=True) if name == live_games.PERSON]
    keys = services.games.add(game, roles)
    return live_games.NewGameBody(proposer=keys.get(Role.PROPOSER), verifier=keys.get(Role.VERIFIER))


def _partner(services: AppServices, role: Role, name: str, new: NewGame) -> Partner | None:
    if name == live_games.PERSON:
        return None
    if name.startswith((SHIPPED_PREFIX, RUN_PREFIX)):
        view = new.proposer_view if role is Role.PROPOSER else new.verifier_view
        if view != live_games.FULL_VIEW:
            raise http_error(422, f"a trained agent must see {live_games.FULL_VIEW}; its view is {view!r}")
        settings = Settings(new.configuration, services.options.corpus)
        return services.trained_partners.partner(name, settings, role, new.protocol)
    scripted = live_games.scripted_partners(role)
    if name not in scripted:
        raise http_error(422, f"{name!r} cannot be {role.name.lower()}; choose from person, {', '.join(scripted)}")
    return scripted[name]


@api.get("/seats/{key}")
def seat(key: field_types.RandomId, services: Services) -> live_games.SeatBody:
    """What the agent in this seat observes now."""
    game, role = services.games.find(key)
    with game.lock:
        return live_games.seat_body(game, role)


@api.get("/seats/{key}/legal")
def legal(key: field_types.RandomId, services: Services, item_type: field_types.ItemTypeQuery) -> LegalBody:
    """This seat's legal actions by its action mask; Scatter's ADDs are filtered by shape, colour and size."""
    game, role = services.games.find(key)
    with game.lock:
        return LegalBody(actions=live_games.legal_names(game, role, item_type))


@api.post("/seats/{key}/actions")
def act(key: field_types.RandomId, taken: SeatAction, services: Services) -> live_games.SeatBody:
    """Takes an action in this seat; partners then play until a person must act."""
    game, role = services.games.find(key)
    with game.lock:
        live_games.act(game, role, taken.action, taken.own_actions)
        return live_games.seat_body(game, role)


router.include_router(api)
