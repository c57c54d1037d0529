"""Tower and Scatter: their scenes, their actions, and the effect of an action on a scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from lilgym_mp.scene.appearances.base import Appearance, Edit, Grid, InvalidReason
from lilgym_mp.scene.appearances.placement import PlacementRules
from lilgym_mp.scene.appearances.scatter import NATIVE, RELEASED_GRID, GridError, Scatter, checked_grid
from lilgym_mp.scene.appearances.tower import Tower
from lilgym_mp.scene.choices import choose

__all__ = [
    "APPEARANCES",
    "NATIVE",
    "RELEASED_GRID",
    "Appearance",
    "Edit",
    "Grid",
    "GridError",
    "InvalidReason",
    "PlacementRules",
    "Scatter",
    "Tower",
    "checked_grid",
    "make_appearance",
]

BUILDERS: Mapping[str, Callable[[Grid], Appearance]] = {"tower": lambda grid: Tower(), "scatter": Scatter}

APPEARANCES: Mapping[str, Appearance] = {name: build(RELEASED_GRID) for name, build in BUILDERS.items()}


def make_appearance(name: str, grid: object = RELEASED_GRID) -> Appearance:
    """The appearance called `name`; `grid`, (columns, rows) or "native", applies to scatter only.

    Raises ValueError naming the choices, GridError for a grid whose cells straddle a separator.
    """
    return choose("appearance", name, BUILDERS)(checked_grid(grid))
