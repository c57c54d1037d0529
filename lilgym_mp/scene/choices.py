"""Lookup in a closed set of choices, and lists of names, for helpful errors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TypeVar

Value = TypeVar("Value")


def choose(what: str, name: object, table: Mapping[str, Value]) -> Value:
    """The entry of `table` with this name.

    Raises ValueError naming the value and every choice, sorted.
    """
    if isinstance(name, str) and name in table:
        return table[name]
    raise ValueError(f"unknown {what} {name!r}; choose from {listed(table)}")


def listed(names: Iterable[object]) -> str:
    """The names sorted and joined, for error messages."""
    return ", ".join(sorted(str(name) for name in names))
