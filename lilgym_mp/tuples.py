"""Named tuples made in half the time that calling their class takes, for what play makes at every step."""

from __future__ import annotations

from typing import Any, Protocol, TypeVar, cast

Made = TypeVar("Made", bound=tuple[Any, ...])


class _Maker(Protocol):
    def __call__(self, kind: type[Made], fields: tuple[Any, ...], /) -> Made: ...


new_tuple: _Maker = cast("Any", tuple).__new__  # takes all fields, in order, and checks nothing
