"""The start page, logging in and out, and who the browser is."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import RedirectResponse
from pydantic import BaseModel
from sqlalchemy import select

from lilgym_mp.web.app_services import ServicesOf
from lilgym_mp.web.authentication import CallerOf, keep_visitor, new_visitor_id, token_hash
from lilgym_mp.web.errors import refusal
from lilgym_mp.web.store.models import Person, Visitor
from lilgym_mp.web.templating import page

router = APIRouter()


class SessionBody(BaseModel):
    """Who the browser is, and what it must send with state-changing requests."""

    csrf_token: str
    person: str | None
    role: str | None


@router.get("/", include_in_schema=False)
def home(request: Request, services: ServicesOf) -> Response:
    return page(request, "home.html", corpus=services.options.corpus)


@router.get("/healthz", include_in_schema=False)
def health() -> dict[str, str]:
    return {"status": "ok"}


@router.get("/api/session", tags=["session"])
def session(caller: CallerOf) -> SessionBody:
    """The CSRF token of this browser, and who is logged in."""
    person = caller.person
    return SessionBody(
        csrf_token=caller.csrf_token,
        person=person.name if person else None,
        role=person.role if person else None,
    )


@router.get("/login", include_in_schema=False)
def login(request: Request, services: ServicesOf, token: Annotated[str, Query(max_length=200)] = "") -> Response:
    """Logs the browser in as the person whose token it is, under a new cookie."""
    with services.database.writing() as session:
        person = session.scalar(select(Person).where(Person.token_hash == token_hash(token))) if token else None
        if person is None:
            raise refusal(401, "this link is not valid, or not any more; ask the organiser for a new one")
        caller = request.scope["visitor"]
        before = session.get(Visitor, caller.id)
        visitor = keep_visitor(session, new_visitor_id())
        visitor.nickname = before.nickname if before else None
        visitor.person_id = person.id
    services.logins.forget()
    caller.id, caller.is_new = visitor.id, True  # the answer gives the browser its new cookie
    return RedirectResponse("/annotate", 303)


@router.post("/api/session/logout", tags=["session"], status_code=204)
def logout(services: ServicesOf, caller: CallerOf) -> None:
    """Logs the browser out."""
    if caller.person is None:
        return
    with services.database.writing() as session:
        keep_visitor(session, caller.id).person_id = None
    services.logins.forget()
