"""Start page and the current session."""

from __future__ import annotations

from fastapi import APIRouter, Request, Response

from lilgym_mp.contrib.web.app_services import Services
from lilgym_mp.contrib.web.templating import render_page
from lilgym_mp.contrib.web.visitors import CurrentVisitor

router = APIRouter()
api = APIRouter(prefix="/api/session", tags=["session"])


@router.get("/", include_in_schema=False)
def home(request: Request, services: Services) -> Response:
    return render_page(request, "home.html", corpus=services.options.corpus, sizes=services.catalogue.sizes())


@router.get("/healthz", include_in_schema=False)
async def health() -> dict[str, str]:  # async: needs no thread, so a busy thread pool does not delay it
    return {"status": "ok"}


@api.get("")
def session(visitor: CurrentVisitor) -> dict[str, str]:
    """This browser's CSRF token, which state-changing requests need."""
    return {"csrf_token": visitor.csrf_token}
