"""Hyperparameters as dataclass fields with a description and bounds. Imports no torch."""

from __future__ import annotations

import math
from collections.abc import Container
from dataclasses import field, fields
from typing import Any


def setting(default: Any, description: str, lowest: float = 0, highest: float = math.inf) -> Any:
    """A field of a recipe; `description` is its help text on the command line."""
    return field(default=default, metadata={"description": description, "bounds": (lowest, highest)})


def option(name: str) -> str:
    """A setting's name on the command line, without the leading dashes."""
    return name.replace("_", "-")


def check_bounds(recipe: Any, exempt: Container[str] = ()) -> None:
    """Raises ValueError naming the first setting out of bounds, its value and its bounds."""
    for each in fields(recipe):
        if each.name in exempt:
            continue
        value, (lowest, highest) = getattr(recipe, each.name), each.metadata["bounds"]
        if not lowest <= value <= highest:
            upper = "" if highest == math.inf else f" and at most {highest:g}"
            raise ValueError(f"{option(each.name)} must be at least {lowest:g}{upper}, not {value}")
