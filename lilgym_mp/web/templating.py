"""Pages from templates, escaped."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

from fastapi import Request
from fastapi.responses import HTMLResponse
from jinja2 import Environment, PackageLoader, StrictUndefined

from lilgym_mp import __version__


class NavigationEntry(NamedTuple):
    """A page in the list at the top of every page."""

    path: str
    title: str
    description: str


NAVIGATION = [
    NavigationEntry("/play", "Play", "Solve tasks yourself, by mouse or keyboard, and see how the expert does it."),
    NavigationEntry("/watch", "Watch", "Step through what trained agents did and what they thought."),
    NavigationEntry("/game", "Game", "Take a seat in the proposer and verifier game beside a partner."),
    NavigationEntry("/annotate", "Annotate", "Write the program that says what a statement means."),
    NavigationEntry("/explore", "Explore", "Search the corpus: statements, scenes, programs, what agents did."),
]


@cache
def _environment() -> Environment:
    return Environment(
        loader=PackageLoader("lilgym_mp.web", "pages"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def page(request: Request, template: str, status_code: int = 200, **values: Any) -> HTMLResponse:
    """The page of a template, with what every page needs: where we are, who looks, the CSRF token."""
    visitor = request.scope.get("visitor")
    text = (
        _environment()
        .get_template(template)
        .render(
            navigation=NAVIGATION,
            path=request.url.path,
            csrf_token=visitor.csrf_token if visitor else "",
            person=visitor.person if visitor else None,
            version=__version__,
            **values,
        )
    )
    return HTMLResponse(text, status_code, headers={"Cache-Control": "no-store"})
