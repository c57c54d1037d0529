"""Hyperparameters as dataclass fields with a description, bounds and choices. Imports no torch."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import Field, asdict, field, fields
from typing import Any, Self

from lilgym_mp.evaluation.options import flag_name
from lilgym_mp.scene.choices import choose


def setting(
    default: Any,
    description: str,
    lowest: float = 0,
    highest: float = math.inf,
    *,
    choices: Iterable[str] = (),
    multiple_of: int = 0,
) -> Any:
    """A field of a recipe; `description` is its help text on the command line, `choices` are for strings."""
    metadata = {"description": description, "bounds": (lowest, highest), "choices": tuple(choices)}
    return field(default=default, metadata={**metadata, "multiple_of": multiple_of})


class Recipe:
    """Base of recipes: frozen dataclasses whose fields are made by `setting`."""

    __slots__ = ()

    def __post_init__(self) -> None:
        """Raises ValueError naming the first setting out of bounds, its value and its bounds or choices."""
        for each in self.settings():
            value, (lowest, highest) = getattr(self, each.name), each.metadata["bounds"]
            if each.metadata["choices"]:
                choose(flag_name(each.name), value, dict.fromkeys(each.metadata["choices"]))
            elif not lowest <= value <= highest:
                upper = "" if highest == math.inf else f" and at most {highest:g}"
                raise ValueError(f"{flag_name(each.name)} must be at least {lowest:g}{upper}, not {value}")
            elif (factor := each.metadata["multiple_of"]) and value % factor:
                raise ValueError(f"{flag_name(each.name)} must be a multiple of {factor}, not {value}")

    def to_json(self) -> dict[str, Any]:
        return asdict(self)  # pyright: ignore[reportArgumentType]

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Self:
        """Inverse of `to_json`. Raises ValueError naming an unknown setting, TypeError."""
        cls.check_known(data)
        return cls(**data)

    @classmethod
    def settings(cls) -> Sequence[Field[Any]]:
        return fields(cls)  # pyright: ignore[reportArgumentType]

    @classmethod
    def names(cls) -> list[str]:
        return [each.name for each in cls.settings()]

    @classmethod
    def check_known(cls, data: Iterable[str]) -> None:
        """Raises ValueError for an unknown setting, naming the choices."""
        for name in data:
            if name not in cls.names():
                raise ValueError(f"unknown setting {name!r} of a recipe; choose from {', '.join(cls.names())}")
