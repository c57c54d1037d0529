"""Who sends a request: the browser by its signed cookie, the person by the token it logged in with."""

from __future__ import annotations

import hashlib
import hmac
import secrets
import time
from dataclasses import dataclass
from typing import Annotated

from anyio.to_thread import run_sync
from fastapi import Depends, Request
from sqlalchemy import select
from sqlalchemy.orm import Session

from lilgym_mp.web.errors import refusal
from lilgym_mp.web.store import Database
from lilgym_mp.web.store.models import Person, Visitor

COOKIE = "lilgym_visitor"
COOKIE_SECONDS = 400 * 24 * 3600
LOGIN_SECONDS = 10.0  # after which a change made by another server on the same database is seen
MOST_LOGINS = 20_000
ORGANISER, ANNOTATOR = "organiser", "annotator"


@dataclass(slots=True)
class Caller:
    """Who sent this request; `person` is known where the visitor logged in."""

    id: str
    csrf_token: str
    is_new: bool
    person: Person | None = None

    @property
    def is_organiser(self) -> bool:
        return self.person is not None and self.person.role == ORGANISER


class Signer:
    """Makes and checks visitors' cookies and the CSRF tokens that belong to them."""

    def __init__(self, key: str) -> None:
        self._key = key.encode()

    def _signature(self, purpose: str, value: str) -> str:
        return hmac.new(self._key, f"{purpose}:{value}".encode(), hashlib.sha256).hexdigest()

    def cookie(self, visitor_id: str) -> str:
        return f"{visitor_id}.{self._signature('cookie', visitor_id)}"

    def csrf_token(self, visitor_id: str) -> str:
        return self._signature("csrf", visitor_id)

    def caller(self, cookie: str | None) -> Caller:
        """The visitor of a cookie; a new one where the cookie is missing or was not signed here."""
        visitor_id, _, signature = (cookie or "").partition(".")
        is_known = hmac.compare_digest(signature.encode(), self._signature("cookie", visitor_id).encode())
        if not is_known:
            visitor_id = new_visitor_id()
        return Caller(visitor_id, self.csrf_token(visitor_id), not is_known)


def new_visitor_id() -> str:
    return secrets.token_urlsafe(32)


def token_hash(token: str) -> str:
    """What is kept of a token."""
    return hashlib.sha256(token.encode(errors="replace")).hexdigest()


class Logins:
    """Who is logged in from which browser, remembered for a moment so that few requests ask the database."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._kept: dict[str, tuple[float, Person | None]] = {}  # until when, and who
        self._changes = 0

    async def person(self, visitor_id: str) -> Person | None:
        """Whoever logged in from this browser and still has a token."""
        until, found = self._kept.get(visitor_id, (0.0, None))
        if time.monotonic() < until:
            return found
        changes = self._changes
        found = await run_sync(self._find, visitor_id)
        if changes == self._changes:
            if len(self._kept) >= MOST_LOGINS:
                self._kept.clear()
            self._kept[visitor_id] = (time.monotonic() + LOGIN_SECONDS, found)
        return found

    def forget(self) -> None:
        """Must be called after every change of who is logged in or has a token."""
        self._changes += 1
        self._kept.clear()

    def _find(self, visitor_id: str) -> Person | None:
        with self._database.reading() as session:
            return session.scalar(
                select(Person).join(Visitor).where(Visitor.id == visitor_id, Person.token_hash.is_not(None))
            )


def keep_visitor(session: Session, visitor_id: str) -> Visitor:
    """The visitor's row, made where there is none."""
    visitor = session.get(Visitor, visitor_id)
    if visitor is None:
        visitor = Visitor(id=visitor_id)
        session.add(visitor)
        session.flush()
    return visitor


def give_token(session: Session, name: str, role: str) -> str:
    """A new token for the person of that name, who is made where there is none; an older token ends."""
    token = secrets.token_urlsafe(24)
    person = session.scalar(select(Person).where(Person.name == name))
    if person is None:
        person = Person(name=name, role=role)
        session.add(person)
    person.token_hash = token_hash(token)
    return token


async def caller(request: Request) -> Caller:
    """Who sent the request."""
    return request.scope["visitor"]


CallerOf = Annotated[Caller, Depends(caller)]


async def logged_in(caller: CallerOf) -> Person:
    """Whoever is logged in. Answers 401 where nobody is."""
    if caller.person is None:
        raise refusal(401, "open the link that the organiser gave you: it logs you in")
    return caller.person


LoggedIn = Annotated[Person, Depends(logged_in)]


async def organiser(person: LoggedIn) -> Person:
    """The organiser who is logged in. Answers 401 or 403 where none is."""
    if person.role != ORGANISER:
        raise refusal(403, "only an organiser may do this")
    return person


OrganiserOf = Annotated[Person, Depends(organiser)]
