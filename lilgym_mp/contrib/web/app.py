"""Application factory: wires up database, middleware, routes and static assets."""

from __future__ import annotations

from functools import partial

from fastapi import FastAPI
from starlette.middleware.base import BaseHTTPMiddleware
from starlette.staticfiles import StaticFiles

from lilgym_mp import __version__
from lilgym_mp.contrib.web.app_services import AppServices, ServeOptions
from lilgym_mp.contrib.web.responses import ASSETS, add_error_handlers
from lilgym_mp.contrib.web.routes import ROUTERS
from lilgym_mp.contrib.web.security import guard


def create_app(options: ServeOptions) -> FastAPI:
    """Raises DatabaseError for an unusable database, CorpusError for an unusable corpus."""
    app = FastAPI(
        title="lilgym-mp",
        version=__version__,
        description="JSON API behind the pages of `lilgym-mp serve`.",
        docs_url=None,
        redoc_url=None,
        redirect_slashes=False,  # would name this server's own host and scheme; `guard` redirects relatively
    )
    app.state.services = AppServices(options)
    for router in ROUTERS:
        app.include_router(router)
    app.mount("/assets", StaticFiles(directory=ASSETS), name="assets")
    add_error_handlers(app)
    app.add_middleware(BaseHTTPMiddleware, dispatch=partial(guard, options))
    return app
