"""/game: a seat in the game of proposer and verifier, beside a partner or another person."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Request, Response
from pydantic import BaseModel, Field

from lilgym_mp.envs.proposer_verifier import PRESETS, PROTOCOLS, Partner, Role
from lilgym_mp.evaluation import Settings
from lilgym_mp.scene import Colour, Shape, Size
from lilgym_mp.web import live_games
from lilgym_mp.web.app_services import Services, ServicesOf
from lilgym_mp.web.authentication import CallerOf
from lilgym_mp.web.errors import refusal
from lilgym_mp.web.field_types import Name, RandomId
from lilgym_mp.web.routes.play import ColourName, ConfigurationName, ShapeName, SizeName, SplitName
from lilgym_mp.web.templating import page
from lilgym_mp.web.trained_partners import OF_RUN, SHIPPED

router = APIRouter()
api = APIRouter(prefix="/api/game", tags=["game"])

ViewName = Literal["everything", "no picture", "no statement", "no target"]
VERDICT_BINS = (2, 3, 5, 9)  # offered on the page; each answer has a key
PartnerName = Annotated[str, Field(max_length=100, pattern=r"^[\w:.-]+$", description="person, or a partner")]


class NewGame(BaseModel):
    """What to play and who sits where. At least one seat is a person's."""

    configuration: ConfigurationName = "TowerScratch"
    split: SplitName = "dev"
    protocol: Literal["veto", "joint", "audit", "critique"] = "veto"
    rewards: Literal["common", "correctness", "helpful", "sneaky", "hidden", "brier", "log"] = "common"
    verdict_bins: int | None = Field(
        None, ge=2, le=9, description="audit: how many probabilities the verifier chooses from; null: a plain verdict"
    )
    proposer: PartnerName = live_games.PERSON
    verifier: PartnerName = "oracle"
    proposer_view: ViewName = "everything"
    verifier_view: ViewName = "everything"


class SeatAction(BaseModel):
    """An action by its name, such as ADD(LEFT, BLUE) or accept, and how many this seat took before."""

    action: Name
    own_actions: int = Field(ge=0, le=100_000)


@router.get("/game", include_in_schema=False)
def game_page(request: Request, services: ServicesOf) -> Response:
    return page(
        request,
        "game.html",
        sizes=services.catalogue.sizes(),
        protocols=list(PROTOCOLS),
        rewards=list(PRESETS),
        verdict_bins=VERDICT_BINS,
        views=list(live_games.VIEWS),
        proposers=live_games.PROPOSERS,
        verifiers=live_games.VERIFIERS,
        trained=services.trained_partners.names(),
        shapes=[shape.name for shape in Shape],
        colours=[colour.name for colour in Colour],
        item_sizes=[size.name for size in Size],
    )


@api.post("/games", status_code=201)
def begin(new: NewGame, services: ServicesOf, caller: CallerOf) -> live_games.NewGameBody:
    """Begins a game; gives a key for each seat that a person takes."""
    names = (new.proposer, new.verifier)
    if live_games.PERSON not in names:
        raise refusal(422, "take at least one of the seats yourself")
    partners = {name: _partner(services, role, name, new) for role, name in zip(Role, names, strict=True)}
    chosen = new.model_dump(exclude={"proposer", "verifier"})
    room = live_games.new_room(
        caller.id,
        services.options.corpus,
        chosen,
        names,
        {name: partner for name, partner in partners.items() if partner is not None},
    )
    roles = [role for role, name in zip(Role, names, strict=True) if name == live_games.PERSON]
    keys = services.games.add(room, roles)
    return live_games.NewGameBody(proposer=keys.get(Role.PROPOSER), verifier=keys.get(Role.VERIFIER))


def _partner(services: Services, role: Role, name: str, new: NewGame) -> Partner | None:
    if name == live_games.PERSON:
        return None
    if name.startswith((SHIPPED, OF_RUN)):
        view = new.proposer_view if role is Role.PROPOSER else new.verifier_view
        if view != live_games.WHOLE_VIEW:
            raise refusal(422, f"a trained agent must see everything, not with {view!r}")
        return services.trained_partners.partner(name, Settings(new.configuration, services.options.corpus))
    scripts = live_games.scripted(role)
    if name not in scripts:
        raise refusal(422, f"{name!r} cannot be {role.name.lower()}; choose from person, {', '.join(scripts)}")
    return scripts[name]


@api.get("/seats/{key}")
def seat(key: RandomId, services: ServicesOf) -> live_games.SeatBody:
    """What the agent in this seat sees now."""
    room, role = services.games.find(key)
    with room.lock:
        return live_games.seat_body(room, role)


@api.get("/seats/{key}/legal")
def legal(
    key: RandomId,
    services: ServicesOf,
    shape: ShapeName | None = None,
    colour: ColourName | None = None,
    size: SizeName | None = None,
) -> live_games.LegalBody:
    """What this seat may do now, by its action mask; of ADDs in Scatter those of the look."""
    room, role = services.games.find(key)
    with room.lock:
        return live_games.LegalBody(actions=live_games.legal_names(room, role, (shape, colour, size)))


@api.post("/seats/{key}/actions")
def act(key: RandomId, taken: SeatAction, services: ServicesOf) -> live_games.SeatBody:
    """Acts in this seat; partners move until a person must."""
    room, role = services.games.find(key)
    with room.lock:
        live_games.act(room, role, taken.action, taken.own_actions)
        return live_games.seat_body(room, role)


router.include_router(api)
