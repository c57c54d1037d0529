"""Start page, login and logout, and the current session."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import RedirectResponse
from pydantic import BaseModel
from sqlalchemy import select

from lilgym_mp.web.app_services import Services
from lilgym_mp.web.authentication import CurrentCaller, get_or_create_visitor, hash_token, new_visitor_id
from lilgym_mp.web.errors import http_error
from lilgym_mp.web.store.models import Person, Visitor
from lilgym_mp.web.templating import render_page

router = APIRouter()


class SessionBody(BaseModel):
    """The person logged in, and the CSRF token for state-changing requests."""

    csrf_token: str
    person: str | None
    role: str | None


@router.get("/", include_in_schema=False)
def home(request: Request, services: Services) -> Response:
    return render_page(request, "home.html", corpus=services.options.corpus)


@router.get("/healthz", include_in_schema=False)
def health() -> dict[str, str]:
    return {"status": "ok"}


@router.get("/api/session", tags=["session"])
def session(caller: CurrentCaller) -> SessionBody:
    """This browser's CSRF token, and the person logged in."""
    person = caller.person
    return SessionBody(
        csrf_token=caller.csrf_token,
        person=person.name if person else None,
        role=person.role if person else None,
    )


@router.get("/login", include_in_schema=False)
def login(request: Request, services: Services, token: Annotated[str, Query(max_length=200)] = "") -> Response:
    """Logs the browser in as the token's owner, with a new cookie against session fixation."""
    with services.database.write_session() as session:
        person = session.scalar(select(Person).where(Person.token_hash == hash_token(token))) if token else None
        if person is None:
            raise http_error(401, "this link is invalid or has been revoked; ask the organiser for a new one")
        caller = request.scope["caller"]
        previous = session.get(Visitor, caller.id)
        visitor = get_or_create_visitor(session, new_visitor_id())
        visitor.nickname = previous.nickname if previous else None
        visitor.person_id = person.id
    services.login_cache.invalidate()
    caller.id, caller.is_new = visitor.id, True  # makes the middleware set the new cookie
    return RedirectResponse("/annotate", 303)


@router.post("/api/session/logout", tags=["session"], status_code=204)
def logout(services: Services, caller: CurrentCaller) -> None:
    """Logs the browser out."""
    if caller.person is None:
        return
    with services.database.write_session() as session:
        get_or_create_visitor(session, caller.id).person_id = None
    services.login_cache.invalidate()
