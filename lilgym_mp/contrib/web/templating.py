"""HTML pages from Jinja templates, with autoescaping."""

from __future__ import annotations

from functools import cache
from typing import Any

from fastapi import Request
from fastapi.responses import HTMLResponse
from jinja2 import Environment, PackageLoader, StrictUndefined

from lilgym_mp import __version__
from lilgym_mp.scene import Colour, Shape, Size

# Path, title, description, and whether it is in the bar of every page or on the start page alone.
NAVIGATION = [
    ("/play", "Play", "Solve tasks yourself, by mouse or keyboard, and see how the expert does it.", True),
    ("/watch", "Watch", "Step through episodes: what agents did, and what they predicted.", True),
    ("/game", "Game", "Play the proposer-verifier game with a scripted, trained or human partner.", True),
    ("/annotate", "Annotate", "Write programs that capture what statements mean.", True),
    ("/explore", "Explore", "Search the corpus: statements, scenes and programs.", True),
    ("/beat", "Beat the agent", "Play ten tasks against a trained agent.", False),
    ("/sentence", "Your sentence", "Type one, and see how an agent reads and plays it.", False),
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
