"""Start page and the current session."""

from __future__ import annotations

from fastapi import APIRouter, Request, Response
from pydantic import BaseModel

from lilgym_mp.scene import Colour, Item, Scene, Shape, Size
from lilgym_mp.web.app_services import Services
from lilgym_mp.web.bodies import data_url
from lilgym_mp.web.templating import render_page
from lilgym_mp.web.visitors import CurrentVisitor

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
    """The CSRF token, which state-changing requests need."""

    csrf_token: str


@router.get("/", include_in_schema=False)
def home(request: Request, services: Services) -> Response:
    return render_page(request, "home.html", corpus=services.options.corpus, picture=data_url(EXAMPLE))


@router.get("/healthz", include_in_schema=False)
async def health() -> dict[str, str]:  # async: needs no thread, so a busy thread pool does not delay it
    return {"status": "ok"}


@api.get("")
def session(visitor: CurrentVisitor) -> SessionBody:
    """This browser's CSRF token."""
    return SessionBody(csrf_token=visitor.csrf_token)
