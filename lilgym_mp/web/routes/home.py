"""Start page, login and logout, and the current session."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import RedirectResponse
from pydantic import BaseModel
from sqlalchemy import select
from sqlalchemy.orm import Session

from lilgym_mp.scene import Colour, Item, Scene, Shape, Size
from lilgym_mp.web.app_services import Services
from lilgym_mp.web.authentication import CurrentCaller, get_or_create_visitor, hash_token, new_visitor_id
from lilgym_mp.web.bodies import data_url
from lilgym_mp.web.errors import http_error
from lilgym_mp.web.store.models import Person, Visitor
from lilgym_mp.web.templating import render_page

router = APIRouter()
api = APIRouter(prefix="/api/session", tags=["session"])
EXAMPLE = Scene.of(
    [
        Item(5, 8, Shape.CIRCLE, Colour.YELLOW, Size.LARGE),
        Item(60, 15, Shape.TRIANGLE, Colour.BLUE, Size.MEDIUM),
        Item(30, 62, Shape.SQUARE, Colour.BLACK, Size.LARGE),
    ],
    [Item(12, 55, Shape.TRIANGLE, Colour.YELLOW, Size.LARGE), Item(66, 24, Shape.SQUARE, Colour.BLUE, Size.SMALL)],
    [
        Item(58, 60, Shape.CIRCLE, Colour.BLUE, Size.LARGE),
        Item(14, 12, Shape.SQUARE, Colour.YELLOW, Size.MEDIUM),
        Item(20, 66, Shape.CIRCLE, Colour.BLACK, Size.MEDIUM),
    ],
)


class SessionBody(BaseModel):
    """The person logged in, and the CSRF token for state-changing requests."""

    csrf_token: str
    person: str | None
    role: str | None


@router.get("/", include_in_schema=False)
def home(request: Request, services: Services) -> Response:
    return render_page(request, "home.html", corpus=services.options.corpus, picture=data_url(EXAMPLE))


@router.get("/healthz", include_in_schema=False)
async def health() -> dict[str, str]:  # async: needs no thread, so a busy thread pool does not delay it
    return {"status": "ok"}


@api.get("")
def session(caller: CurrentCaller) -> SessionBody:
    """This browser's CSRF token, and the person logged in."""
    person = caller.person
    return SessionBody(csrf_token=caller.csrf_token, person=person and person.name, role=person and person.role)


@router.get("/login", include_in_schema=False)
async def login(
    services: Services, caller: CurrentCaller, token: Annotated[str, Query(max_length=200)] = ""
) -> Response:
    """Logs the browser in as the token's owner, with a new cookie against session fixation."""
    token_hash = hash_token(token)

    def log_in(session: Session) -> str:
        if session.scalar(select(Person.id).where(Person.token_hash == token_hash)) is None:
            raise http_error(401, "this link is invalid or has been revoked; ask the organiser for a new one")
        previous = session.get(Visitor, caller.id)
        visitor = get_or_create_visitor(session, new_visitor_id())
        visitor.nickname = previous.nickname if previous else None
        visitor.token_hash = token_hash
        return visitor.id

    caller.id, caller.is_new = await services.database.write(log_in), True  # the middleware sets the new cookie
    return RedirectResponse("/annotate", 303)


@api.post("/logout", status_code=204)
async def logout(services: Services, caller: CurrentCaller) -> None:
    """Logs the browser out."""

    def log_out(session: Session) -> None:
        get_or_create_visitor(session, caller.id).token_hash = None

    if caller.person is not None:
        await services.database.write(log_out)
