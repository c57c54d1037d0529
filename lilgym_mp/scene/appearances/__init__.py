"""Tower and Scatter: their scenes, their actions, and the effect of an action on a scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, TypeVar

from lilgym_mp.scene.appearances.base import Appearance, Edit, Grid, InvalidReason, PlacementRules
from lilgym_mp.scene.appearances.grids import NATIVE, RELEASED_GRID, GridError, checked_grid
from lilgym_mp.scene.choices import choose, listed
from lilgym_mp.submodules import submodule_getter

if TYPE_CHECKING:
    from lilgym_mp.scene.appearances.scatter.rules import Scatter
    from lilgym_mp.scene.appearances.tower.rules import Tower

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
    "UnsupportedAppearance",
    "checked_grid",
    "make_appearance",
    "part_of",
]

Value = TypeVar("Value")
Builder = Callable[[Grid], Appearance]
APPEARANCES: dict[str, str | Builder] = {  # or "module:name" of one, which is imported when first used
    "tower": "lilgym_mp.scene.appearances.tower.rules:make_tower",
    "scatter": "lilgym_mp.scene.appearances.scatter.rules:Scatter",
}


def make_appearance(name: str, grid: object = RELEASED_GRID) -> Appearance:
    """The appearance called `name`; `grid`, (columns, rows) or "native", applies to scatter only.

    Raises ValueError naming the choices, GridError for a grid whose cells straddle a separator.
    """
    return _made(choose("appearance", name, APPEARANCES), checked_grid(grid))


class UnsupportedAppearance(ValueError):
    """An appearance lacks what is asked for, such as a search or a network."""


def part_of(appearance: str, part: str, table: Mapping[str, Value]) -> Value:
    """The entry of an appearance in a table of what appearances may lack.

    Args:
        appearance: The appearance's name.
        part: What the table has, for the error, such as "expert".
        table: The entries by name of the appearance.

    Raises:
        UnsupportedAppearance: If the appearance has no entry; the message names those that have one.
    """
    if appearance not in table:
        raise UnsupportedAppearance(f"appearance {appearance!r} has no {part}; those that have one: {listed(table)}")
    return table[appearance]


@cache
def _made(builder: str | Builder, grid: Grid) -> Appearance:
    make: Builder = resolve_name(builder) if isinstance(builder, str) else builder
    return make(grid)


def __getattr__(name: str) -> Any:
    """Imports `Tower` and `Scatter` when first used."""
    if name not in ("Tower", "Scatter"):
        return submodule_getter(__name__)(name)
    return resolve_name(f"{__name__}.{name.lower()}.rules:{name}")
