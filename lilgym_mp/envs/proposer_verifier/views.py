"""What each agent sees: the names that make up a view. `observations` encodes them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, TypeAlias

from lilgym_mp.envs.checks import checked_count, checked_flag
from lilgym_mp.scene.choices import choose

ViewSpec: TypeAlias = "View | str | Mapping[str, Any]"

SCENE_VIEWS = ("image", "structured", "text", "none")
STATEMENT_VIEWS = ("tokens", "text", "none")


@dataclass(frozen=True, slots=True)
class View:
    """What an agent sees. "intent" (proposer only) and "message" are added if the game has them."""

    scene: str = "image"  # a name in SCENE_VIEWS
    statement: str = "tokens"  # a name in STATEMENT_VIEWS
    target: bool = True
    proposal: bool = True  # the pending proposal
    proposed_scene: bool = False  # the scene after the pending proposal, in the same form as the scene
    refused: bool = True  # the proposal refused last, until an action is played
    history: int = 0  # number of past turns

    def __post_init__(self) -> None:
        """Raises ValueError naming the choices."""
        choose("scene view", self.scene, dict.fromkeys(SCENE_VIEWS))
        choose("statement view", self.statement, dict.fromkeys(STATEMENT_VIEWS))
        for name in ("target", "proposal", "proposed_scene", "refused"):
            checked_flag(f"{name} of a view", getattr(self, name))
        if self.proposed_scene and self.scene == "none":
            raise ValueError("proposed_scene of a view needs a scene view other than 'none'")
        checked_count("history of a view", self.history, least=0)


VIEWS: Mapping[str, View] = {
    "image": View(),
    "structured": View(scene="structured"),
    "text": View(scene="text", statement="text"),
}


def make_view(view: ViewSpec) -> View:
    """A view from its fields or a name in VIEWS. Raises ValueError naming the choices."""
    if isinstance(view, View):
        return view
    if isinstance(view, Mapping):
        names = {field.name: field for field in fields(View)}
        for name in view:
            choose("field of a view", name, names)
        return View(**view)
    return choose("view", view, VIEWS)
