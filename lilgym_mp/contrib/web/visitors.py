"""Who sends a request: a browser, identified by a random id in a cookie, and its CSRF token."""

from __future__ import annotations

import hashlib
import re
import secrets
from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends, Request

VISITOR_COOKIE = "lilgym_visitor"
_VISITOR_ID = re.compile(r"[A-Za-z0-9_-]{43}")


@dataclass(frozen=True, slots=True)
class Visitor:
    """A browser. Its id is known to it and the server alone."""

    id: str
    is_new: bool  # sent no valid cookie

    @classmethod
    def of_cookie(cls, cookie: str | None) -> Visitor:
        """The visitor with that id; a new one if the cookie is missing or no id."""
        if cookie is not None and _VISITOR_ID.fullmatch(cookie):
            return cls(cookie, is_new=False)
        return cls(secrets.token_urlsafe(32), is_new=True)

    @property
    def csrf_token(self) -> str:
        """A value that scripts of the server's own pages know, and that does not give the id away."""
        return hashed("csrf", self.id)


def hashed(purpose: str, secret: str) -> str:
    """A value that proves knowledge of the secret without giving it away."""
    return hashlib.sha256(f"lilgym-mp {purpose}:{secret}".encode()).hexdigest()


async def get_visitor(request: Request) -> Visitor:
    return request.scope["visitor"]


CurrentVisitor = Annotated[Visitor, Depends(get_visitor)]
