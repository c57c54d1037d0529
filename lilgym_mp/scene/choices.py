"""Lookup in a closed set of choices, and lists of names, for helpful errors."""

from __future__ import annotations

import operator
import warnings
from collections.abc import Iterable, Iterator, Mapping, MutableMapping
from typing import Any, SupportsIndex, TypeVar

from lilgym_mp.scene.arrays import BOOLEANS

EXTENSIONS = "lilgym_mp"  # group of entry points: modules of other packages that register what they add

Value = TypeVar("Value")


def choose(what: str, name: object, table: Mapping[str, Value]) -> Value:
    """The entry of `table` with this name.

    Loads extensions before it raises ValueError naming the value, every choice, sorted, and the closest one.
    """
    close: list[str] = []
    if isinstance(name, str):
        if name not in table:
            load_extensions()
        if name in table:
            return table[name]
        from difflib import get_close_matches

        close = get_close_matches(name, table, 1)
    question = f"; did you mean {close[0]!r}?" if close else ""
    raise ValueError(f"unknown {what} {name!r}; choose from {listed(table)}{question}")


def checked_count(name: str, value: object, least: int = 1, *, of: str = "") -> int:
    """A whole number as an int, whatever its type; booleans and floats are none.

    Args:
        name: What the error calls the value.
        value: The value.
        least: The lowest value allowed.
        of: What is counted, for the error, such as " of actions or None".

    Raises:
        ValueError: Unless it is a whole number, `least` or more.
    """
    number = operator.index(value) if isinstance(value, SupportsIndex) and not isinstance(value, BOOLEANS) else None
    if number is None or number < least:
        kind = "positive whole number" if least == 1 else f"whole number, {least} or more"
        raise ValueError(f"{name} must be a {kind}{of}, not {value!r}")
    return number


def register(what: str, name: str, value: Value, table: MutableMapping[str, Value]) -> None:
    """Adds an entry. Raises ValueError for a name that is taken or is not a string."""
    if not isinstance(name, str) or name in table:  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ValueError(f"{what} {name!r} is already registered, or is no text")
    table[name] = value


def load_extensions() -> None:
    """Imports, once, what installed packages name as entry points of the group `EXTENSIONS`; warns of what fails."""
    for entry_point in _PENDING:
        try:
            entry_point.load()
        except (Exception, SystemExit) as error:
            warnings.warn(f"the extension {entry_point.name!r} cannot be imported: {error!r}", stacklevel=2)


def _entry_points() -> Iterator[Any]:
    from importlib.metadata import entry_points  # when first needed: finding them takes time

    yield from entry_points(group=EXTENSIONS)


_PENDING = _entry_points()  # not yet loaded


def listed(names: Iterable[object]) -> str:
    """The names sorted and joined, for error messages."""
    return ", ".join(sorted(str(name) for name in names))


def article(noun: str) -> str:
    """The noun with its indefinite article."""
    return f"an {noun}" if noun[0] in "aeiou" else f"a {noun}"


def flag_name(name: str) -> str:
    """The option for a field, without its leading dashes."""
    return name.replace("_", "-")
