"""The browser suite that `lilgym-mp serve` runs: play, watch, sit in a seat, annotate, explore.

An adapter: rules, truth, legality and pictures come from the package; here are pages, JSON and a database. Needs the
extra `web`. `create_app(ServeOptions(...))` gives the ASGI application.
"""

from typing import Any

__all__ = ["ServeOptions", "create_app"]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    """What is imported when it is asked for: the processes that evaluate programs need none of it."""
    if name == "create_app":
        from lilgym_mp.web.app import create_app

        return create_app
    if name == "ServeOptions":
        from lilgym_mp.web.serve_options import ServeOptions

        return ServeOptions
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
