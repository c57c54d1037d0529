"""What a generated statement means: a small tree of items, boxes, quantities and clauses.

`sources` turns a meaning into a program, `wording` into English, `reading` reads English back into meanings, and
`interpretation` says directly whether a meaning holds in a scene. None of the four uses another.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from enum import StrEnum
from typing import Any, NamedTuple, TypeVar, cast

from lilgym_mp.scene import Colour, Shape, Size

Part = TypeVar("Part")


class Wall(StrEnum):
    """A side of a box."""

    LEFT = "left"
    RIGHT = "right"
    TOP = "top"
    BOTTOM = "bottom"


class Level(StrEnum):
    """A place in a box's pile, counted as the words say."""

    TOP = "top"
    BOTTOM = "bottom"
    SECOND = "second"
    THIRD = "third"


class Relation(StrEnum):
    """How one item lies to another of its box."""

    TOUCHING = "touching"
    NEAR = "near"  # touching or almost
    ON = "on"  # directly above, in a tower
    UNDER = "under"  # directly below, in a tower
    ABOVE = "above"  # anywhere higher in the box
    BELOW = "below"


class Attribute(StrEnum):
    """What items may have in common."""

    COLOUR = "colour"
    SHAPE = "shape"
    SIZE = "size"


class Order(StrEnum):
    """How one number compares with another."""

    MORE = "more"
    FEWER = "fewer"
    EQUAL = "equal"


class Share(StrEnum):
    """How many of the items just named are meant by "of them"."""

    ALL = "all"
    NONE = "none"
    SOME = "some"
    ONE = "one"  # exactly one


class Quantity(NamedTuple):
    """A range of numbers, both ends included; `high` None means no end. `soft` ranges come from vague words."""

    low: int
    high: int | None
    soft: bool = False

    def holds(self, count: int) -> bool:
        return self.low <= count and (self.high is None or count <= self.high)


SOME, NONE = Quantity(1, None), Quantity(0, 0)


@dataclass(frozen=True, slots=True)
class Look:
    """What an item looks like; no colours mean any colour, two colours either of them."""

    shape: Shape | None = None
    colours: frozenset[Colour] = frozenset()
    size: Size | None = None


@dataclass(frozen=True, slots=True)
class HasLook:
    """Being blue, being a small circle, not being black."""

    look: Look
    holds: bool = True


@dataclass(frozen=True, slots=True)
class AtWall:
    """Touching a wall of the box, any when `wall` is None; `close` counts almost touching (4 pixels)."""

    wall: Wall | None = None
    close: bool = False
    holds: bool = True


@dataclass(frozen=True, slots=True)
class InCorner:
    """Touching two walls of the box."""

    close: bool = False
    holds: bool = True


@dataclass(frozen=True, slots=True)
class InBox:
    """Being in the left (0), middle (1) or right (2) box."""

    index: int
    holds: bool = True


@dataclass(frozen=True, slots=True)
class AtLevel:
    """Being the top, the bottom, the second or third from below of its box."""

    level: Level
    holds: bool = True


@dataclass(frozen=True, slots=True)
class Beside:
    """Standing in the relation to some other item that is a `noun`."""

    relation: Relation
    noun: Noun
    holds: bool = True


@dataclass(frozen=True, slots=True)
class BesideLike:
    """Standing in the relation to some other item of the same colour, shape or size, or (`same` False) of another."""

    relation: Relation
    attribute: Attribute
    same: bool
    holds: bool = True


Trait = HasLook | AtWall | InCorner | InBox | AtLevel | Beside | BesideLike


@dataclass(frozen=True, slots=True)
class Noun:
    """Items of one look that have all the traits."""

    look: Look = Look()
    traits: tuple[Trait, ...] = ()

    def also(self, trait: Trait) -> Noun:
        return Noun(self.look, (*self.traits, trait))


ANYTHING = Noun()


@dataclass(frozen=True, slots=True)
class Has:
    """The box holds so many of these items."""

    quantity: Quantity
    noun: Noun


@dataclass(frozen=True, slots=True)
class Purely:
    """The box is not empty and holds nothing but items of this look."""

    look: Look


@dataclass(frozen=True, slots=True)
class Varied:
    """The box's items have so many different colours, shapes or sizes."""

    attribute: Attribute
    quantity: Quantity


@dataclass(frozen=True, slots=True)
class Ends:
    """The top or bottom item of the tower has one of the colours."""

    level: Level
    colours: frozenset[Colour]


@dataclass(frozen=True, slots=True)
class SameEnds:
    """The tower has at least two items, and top and bottom have the same colour, or (`same` False) have not."""

    same: bool


@dataclass(frozen=True, slots=True)
class Sharing:
    """The box holds so many of these items, and this share of them has the trait."""

    quantity: Quantity
    noun: Noun
    share: Share
    trait: Trait


Condition = Has | Purely | Varied | Ends | SameEnds | Sharing
Conditions = tuple[Condition, ...]


@dataclass(frozen=True, slots=True)
class ItemCount:
    """So many of these items are in the picture."""

    quantity: Quantity
    noun: Noun


@dataclass(frozen=True, slots=True)
class SharedCount:
    """So many of these items are in the picture, and this share of them has the trait."""

    quantity: Quantity
    noun: Noun
    share: Share
    trait: Trait


@dataclass(frozen=True, slots=True)
class BoxCount:
    """So many boxes meet all the conditions; `towers`: they are not empty, too."""

    quantity: Quantity
    conditions: Conditions
    towers: bool = False


@dataclass(frozen=True, slots=True)
class EveryTower:
    """There is a tower, and each tower meets all the conditions."""

    conditions: Conditions


@dataclass(frozen=True, slots=True)
class BoxIs:
    """The named box meets all the conditions."""

    index: int
    conditions: Conditions
    towers: bool = False


@dataclass(frozen=True, slots=True)
class Every:
    """There are such items, and each has the trait."""

    noun: Noun
    trait: Trait


@dataclass(frozen=True, slots=True)
class NotEvery:
    """Some such item lacks the trait."""

    noun: Noun
    trait: Trait


@dataclass(frozen=True, slots=True)
class Compared:
    """There are more (by `margin`, where given), fewer or as many of these items than of those."""

    one: Noun
    order: Order
    other: Noun
    margin: int | None = None


@dataclass(frozen=True, slots=True)
class BoxesCompared:
    """One named box has more, fewer or as many of these items than the other; `towers`: neither is empty."""

    noun: Noun
    one: int
    order: Order
    other: int
    towers: bool = False


@dataclass(frozen=True, slots=True)
class PictureVaried:
    """The picture's items have so many different colours, shapes or sizes."""

    attribute: Attribute
    quantity: Quantity


@dataclass(frozen=True, slots=True)
class Evenly:
    """All boxes hold equally many of these items, or (`same` False) no two boxes do."""

    noun: Noun
    same: bool


@dataclass(frozen=True, slots=True)
class Parity:
    """The number of these items is even or odd."""

    noun: Noun
    even: bool


@dataclass(frozen=True, slots=True)
class Extreme:
    """One box holds the most of these items, more than any other, and meets the conditions."""

    noun: Noun
    conditions: Conditions


@dataclass(frozen=True, slots=True)
class Joined:
    """All clauses hold, or (`every` False) at least one."""

    every: bool
    clauses: tuple[Clause, ...]


Simple = (
    ItemCount
    | SharedCount
    | BoxCount
    | EveryTower
    | BoxIs
    | Every
    | NotEvery
    | Compared
    | BoxesCompared
    | PictureVaried
    | Evenly
    | Parity
    | Extreme
)
Clause = Simple | Joined


def relabelled(part: Part, colours: Mapping[Colour, Colour], shapes: Mapping[Shape, Shape]) -> Part:
    """The same meaning of other colours and shapes: said in the same words it has the same form."""
    return cast("Part", _relabelled(part, colours, shapes))


def _relabelled(part: Any, colours: Mapping[Colour, Colour], shapes: Mapping[Shape, Shape]) -> object:
    match part:
        case Colour():
            return colours[part]
        case Shape():
            return shapes[part]
        case frozenset():
            return frozenset(_relabelled(inner, colours, shapes) for inner in cast("frozenset[object]", part))
        case tuple() if not isinstance(part, Quantity):
            return tuple(_relabelled(inner, colours, shapes) for inner in cast("tuple[object, ...]", part))
        case _ if is_dataclass(part):
            values = (_relabelled(getattr(part, field.name), colours, shapes) for field in fields(part))
            return type(part)(*values)
        case _:
            return part
