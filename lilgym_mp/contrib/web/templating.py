"""HTML pages from Jinja templates, with autoescaping."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

from fastapi import Request
from fastapi.responses import HTMLResponse
from jinja2 import Environment, PackageLoader, StrictUndefined

from lilgym_mp import __version__
from lilgym_mp.scene import Colour, Shape, Size


class NavigationEntry(NamedTuple):
    """An entry of the navigation bar and the start page."""

    path: str
    title: str
    description: str
    in_bar: bool = True


NAVIGATION = [
    NavigationEntry("/play", "Play", "Solve tasks yourself, by mouse or keyboard, and see how the expert does it."),
    NavigationEntry("/watch", "Watch", "Step through recorded episodes: what agents did, and what they predicted."),
    NavigationEntry("/game", "Game", "Play the proposer-verifier game with a scripted, trained or human partner."),
    NavigationEntry("/annotate", "Annotate", "Write programs that capture what statements mean."),
    NavigationEntry("/explore", "Explore", "Search the corpus: statements, scenes, programs and agents' results."),
    NavigationEntry("/beat", "Beat the agent", "Play ten tasks against a trained agent.", in_bar=False),
    NavigationEntry("/sentence", "Your sentence", "Type one, and see how an agent reads and plays it.", in_bar=False),
]


@cache
def _environment() -> Environment:
    loader = PackageLoader("lilgym_mp.contrib.web", "pages")
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    members = {"shapes": Shape, "colours": Colour, "item_sizes": Size}
    environment.globals |= {name: list(enum.__members__) for name, enum in members.items()}
    environment.globals |= {"navigation": NAVIGATION, "version": __version__}
    return environment


def render_page(request: Request, template: str, status_code: int = 200, **values: Any) -> HTMLResponse:
    """Renders a template with the values and the common context: path, navigation, CSRF token, version."""
    visitor = request.scope.get("visitor")
    common = {"path": request.url.path, "csrf_token": visitor.csrf_token if visitor else ""}
    text = _environment().get_template(template).render(**common, **values)
    return HTMLResponse(text, status_code, headers={"Cache-Control": "no-store"})
