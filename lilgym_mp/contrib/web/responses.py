"""Pages from Jinja templates, with autoescaping, and error responses: JSON under /api, an HTML page elsewhere."""

from __future__ import annotations

import hashlib
import logging
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from http import HTTPStatus
from pathlib import Path
from threading import Lock
from typing import Any

from fastapi import FastAPI, HTTPException, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import HTMLResponse, JSONResponse
from jinja2 import Environment, PackageLoader, StrictUndefined
from starlette.exceptions import HTTPException as FrameworkException

from lilgym_mp import __version__
from lilgym_mp.contrib.web.database import DatabaseError
from lilgym_mp.corpus import CorpusError
from lilgym_mp.programs import ProgramError
from lilgym_mp.scene import Colour, Shape, Size
from lilgym_mp.scene.actions import ActionError
from lilgym_mp.scene.appearances import UnsupportedAppearance

ASSETS = Path(__file__).parent / "assets"
LOGGER = logging.getLogger(__name__)
STATUSES = {ActionError: 422, ProgramError: 422, CorpusError: 404, UnsupportedAppearance: 404}
"""Exceptions that routes let pass, with the status of the response; the message is theirs."""
# Path, title and description of the pages in the bar.
NAVIGATION = [
    ("/play", "Play", "Solve tasks yourself, by mouse or keyboard, and see how the expert does it."),
    ("/watch", "Watch", "Step through episodes: what agents did, and what they predicted."),
    ("/game", "Game", "Play the proposer-verifier game with a scripted, trained or human partner."),
    ("/annotate", "Annotate", "Write programs that capture what statements mean."),
    ("/explore", "Explore", "Search the corpus: statements, scenes and programs."),
    ("/beat", "Beat", "Play ten tasks against a trained agent."),
    ("/sentence", "Sentence", "Type one, and see how an agent reads and plays it."),
]


@cache
def _environment() -> Environment:
    loader = PackageLoader("lilgym_mp.contrib.web", "pages")
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    members = {"shapes": Shape, "colours": Colour, "item_sizes": Size}
    environment.globals |= {name: list(enum.__members__) for name, enum in members.items()}
    content = b"".join(path.read_bytes() for path in sorted(ASSETS.iterdir()))
    digest = hashlib.sha256(content).hexdigest()[:12]  # in the URLs of assets, so that no browser keeps older ones
    environment.globals |= {"navigation": NAVIGATION, "version": __version__, "assets_version": digest}
    return environment


def render_page(request: Request, template: str, status_code: int = 200, **values: Any) -> HTMLResponse:
    """Renders a template with the values and the common context: path, the way from it to `/`, navigation, version.

    Links are relative, as a proxy may add a prefix to the path.
    """
    path = request.scope["path"]
    root = "../" * (path.count("/") - 1) or "./"
    text = _environment().get_template(template).render(path=path, root=root, **values)
    return HTMLResponse(text, status_code, headers={"Cache-Control": "no-store"})


@contextmanager
def refusing(status: int = 422) -> Iterator[None]:
    """Responds to a ValueError in the block with the status and its message; a CorpusError has its own status."""
    try:
        yield
    except CorpusError:
        raise
    except ValueError as fault:
        raise HTTPException(status, str(fault)) from None


@contextmanager
def in_turn(lock: Lock, seconds: float, busy: str) -> Iterator[None]:
    """Holds the lock during the block. Responds with 503 if others hold it for longer than these seconds."""
    if not lock.acquire(timeout=seconds):
        raise HTTPException(503, f"{busy}; try again in a moment")
    try:
        yield
    finally:
        lock.release()


def error_response(request: Request, status: int, message: str) -> Response:
    """A JSON or HTML error response, depending on the request's path."""
    if request.url.path.startswith("/api/") or request.url.path == "/openapi.json":
        return JSONResponse({"status": status, "message": message}, status)
    title = HTTPStatus(status).phrase
    return render_page(request, "error.html", status_code=status, title=title, message=message)


def add_error_handlers(app: FastAPI) -> None:
    """Makes the application answer every exception with a readable response."""
    for kind in (
        FrameworkException,
        *STATUSES,
        RequestValidationError,
        sqlite3.OperationalError,
        DatabaseError,
        Exception,
    ):
        app.add_exception_handler(kind, _respond)


def _respond(request: Request, fault: Any) -> Response:
    """The response to an exception that a route raised."""
    path = request.url.path
    status = next((status for kind, status in STATUSES.items() if isinstance(fault, kind)), 500)
    message = str(fault)
    if isinstance(fault, FrameworkException):
        default = HTTPStatus(fault.status_code).phrase
        said = {404: f"there is nothing at {path}", 405: f"{path} does not accept {request.method} requests"}
        status = fault.status_code
        message = str(fault.detail)
        message = said.get(status, message) if message == default else message
    elif isinstance(fault, RequestValidationError):
        errors = (f"{'.'.join(map(str, error['loc']))}: {error['msg']}" for error in fault.errors())
        status = 422
        message = "; ".join(errors)
    elif isinstance(fault, (sqlite3.OperationalError, DatabaseError)):
        LOGGER.error("database: %s", fault)
        status = 503
        message = "the database is not responding; nothing was saved: try again"
    elif status == 500:
        LOGGER.error("%s %s failed", request.method, path, exc_info=fault)
        message = "something went wrong on the server; nothing was saved"
    response = error_response(request, status, message or "the request is malformed")
    response.headers.update(getattr(fault, "headers", None) or {})
    return response
