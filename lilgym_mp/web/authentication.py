"""Authentication: signed visitor cookies identify browsers, login tokens identify people."""

from __future__ import annotations

import hashlib
import hmac
import secrets
from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends, Request
from sqlalchemy import select
from sqlalchemy.orm import Session

from lilgym_mp.web.errors import http_error
from lilgym_mp.web.store.database import Database
from lilgym_mp.web.store.models import Person, Visitor

COOKIE = "lilgym_visitor"
COOKIE_SECONDS = 400 * 24 * 3600
ORGANISER, ANNOTATOR = "organiser", "annotator"
OPERATOR = "organiser"  # name of the person whose link the server prints when it starts


@dataclass(slots=True)
class Caller:
    """Sender of a request: a browser, and the person logged in there, if any."""

    id: str  # visitor id
    csrf_token: str
    is_new: bool  # sent no valid cookie
    person: Person | None = None

    @property
    def is_organiser(self) -> bool:
        return self.person is not None and self.person.role == ORGANISER


class CookieSigner:
    """Signs and verifies visitor cookies, and derives their CSRF tokens."""

    def __init__(self, key: str) -> None:
        self._key = key.encode()

    def _signature(self, purpose: str, value: str) -> str:
        return hmac.new(self._key, f"{purpose}:{value}".encode(), hashlib.sha256).hexdigest()

    def cookie(self, visitor_id: str) -> str:
        return f"{visitor_id}.{self._signature('cookie', visitor_id)}"

    def csrf_token(self, visitor_id: str) -> str:
        return self._signature("csrf", visitor_id)

    def caller(self, cookie: str | None) -> Caller:
        """The visitor identified by a cookie; a new one if the cookie is missing or its signature is wrong."""
        visitor_id, _, signature = (cookie or "").partition(".")
        is_known = hmac.compare_digest(signature.encode(), self._signature("cookie", visitor_id).encode())
        if not is_known:
            visitor_id = new_visitor_id()
        return Caller(visitor_id, self.csrf_token(visitor_id), not is_known)


def new_visitor_id() -> str:
    return secrets.token_urlsafe(32)


def hash_token(token: str) -> str:
    return hashlib.sha256(token.encode(errors="replace")).hexdigest()


def find_person(database: Database, visitor_id: str) -> Person | None:
    """The person logged in from this browser, unless the token has been revoked or replaced since."""
    with database.read_session() as session:
        logged_in = select(Visitor.token_hash).where(Visitor.id == visitor_id)
        return session.scalar(select(Person).where(Person.token_hash == logged_in.scalar_subquery()))


def get_or_create_visitor(session: Session, visitor_id: str) -> Visitor:
    """The visitor's row, inserted if missing."""
    visitor = session.get(Visitor, visitor_id)
    if visitor is None:
        visitor = Visitor(id=visitor_id)
        session.add(visitor)
        session.flush()
    return visitor


def issue_token(person: Person) -> str:
    """A new token for the person; it replaces any older token and ends the logins made with that."""
    token = secrets.token_urlsafe(24)
    person.token_hash = hash_token(token)
    return token


def issue_operator_token(session: Session) -> str:
    """A new token for the organiser who starts the server."""
    person = session.scalar(select(Person).where(Person.name == OPERATOR))
    if person is None:
        person = Person(name=OPERATOR)
        session.add(person)
    person.role = ORGANISER
    return issue_token(person)


def add_person(session: Session, name: str, role: str) -> Person:
    """Responds with 409 if the name is reserved or taken."""
    if name.casefold() == OPERATOR:
        raise http_error(409, f"the name {name!r} is reserved for the organiser who starts the server; choose another")
    existing = session.scalar(select(Person).where(Person.name == name))
    if existing is not None:
        raise http_error(
            409, f"there is already {existing.role} {name!r}; issue a new link in the list, or choose another name"
        )
    person = Person(name=name, role=role)
    session.add(person)
    return person


def find_other_person(session: Session, organiser: Person, person_id: int) -> Person:
    """The person whose login or role the organiser wants to change.

    Responds with 404 if there is none, 409 if it is the organiser, or the one who starts the server.
    """
    person = session.get(Person, person_id)
    if person is None:
        raise http_error(404, f"there is no person with id {person_id}")
    if person.id == organiser.id:
        raise http_error(409, "you cannot change your own link or role; ask another organiser")
    if person.name == OPERATOR:
        raise http_error(409, f"{OPERATOR!r} starts the server, which prints the link; it cannot be changed here")
    return person


async def get_caller(request: Request) -> Caller:
    return request.scope["caller"]


CurrentCaller = Annotated[Caller, Depends(get_caller)]


async def get_person(caller: CurrentCaller) -> Person:
    """The person logged in. Responds with 401 if nobody is."""
    if caller.person is None:
        raise http_error(401, "open the link that the organiser gave you to log in")
    return caller.person


CurrentPerson = Annotated[Person, Depends(get_person)]


async def get_organiser(person: CurrentPerson) -> Person:
    """The organiser logged in. Responds with 401 if nobody is logged in, 403 to annotators."""
    if person.role != ORGANISER:
        raise http_error(403, "only an organiser may do this")
    return person


CurrentOrganiser = Annotated[Person, Depends(get_organiser)]
