"""Web application behind `lilgym-mp serve`: play, watch, take a seat in a game, annotate, explore.

An adapter: rules, truth values, legality and rendering come from the package; this layer adds pages, a JSON API and a
database. Needs the extra `web`. `create_app(ServeOptions(...))` returns the ASGI application.
"""

from typing import Any

__all__ = ["ServeOptions", "create_app"]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    """Imports lazily: the worker processes that evaluate programs need neither FastAPI nor the database."""
    if name == "create_app":
        from lilgym_mp.web.app import create_app

        return create_app
    if name == "ServeOptions":
        from lilgym_mp.web.serve_options import ServeOptions

        return ServeOptions
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
