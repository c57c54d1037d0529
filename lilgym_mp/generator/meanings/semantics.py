"""Meaning representations: what a generated statement says, as a small tree independent of any wording.

A meaning is a `Clause` over noun phrases, predicates of items, conditions of boxes and quantities.
`program_realisation` turns it into a program and `sentence_realisation` into English; `statement_grammar` parses
English back into meanings, and `interpretation` evaluates a meaning in a scene. None of the four uses another, so that
each can check the rest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from enum import StrEnum
from typing import Any, TypeVar, cast

from lilgym_mp.generator.quantities import Quantity
from lilgym_mp.scene import Colour, Shape, Size

Node = TypeVar("Node")


class Wall(StrEnum):
    """A side of a box."""

    LEFT = "left"
    RIGHT = "right"
    TOP = "top"
    BOTTOM = "bottom"


class TowerPosition(StrEnum):
    """A place in a tower; SECOND and THIRD count from the bottom."""

    TOP = "top"
    BOTTOM = "bottom"
    SECOND = "second"
    THIRD = "third"


class Relation(StrEnum):
    """A spatial relation of one item to another in the same box."""

    TOUCHING = "touching"
    NEAR = "near"  # touching or almost
    ON = "on"  # directly above, in a tower
    UNDER = "under"  # directly below, in a tower
    ABOVE = "above"  # anywhere higher
    BELOW = "below"


class Attribute(StrEnum):
    COLOUR = "colour"
    SHAPE = "shape"
    SIZE = "size"


class Order(StrEnum):
    """The outcome of comparing two counts."""

    MORE = "more"
    FEWER = "fewer"
    EQUAL = "equal"


class Partitive(StrEnum):
    """The quantifier in "... of them"."""

    ALL = "all"
    NONE = "none"
    SOME = "some"
    ONE = "one"  # exactly one


@dataclass(frozen=True, slots=True)
class Description:
    """Attribute values of an item. None and an empty set match anything; several colours match any of them."""

    shape: Shape | None = None
    colours: frozenset[Colour] = frozenset()
    size: Size | None = None


@dataclass(frozen=True, slots=True)
class Matches:
    """The item matches the description: is blue, is a small circle."""

    description: Description
    positive: bool = True


@dataclass(frozen=True, slots=True)
class AtWall:
    """The item touches a wall of its box, any wall when `wall` is None; `near` includes gaps of up to 4 pixels."""

    wall: Wall | None = None
    near: bool = False
    positive: bool = True


@dataclass(frozen=True, slots=True)
class InCorner:
    """The item touches two walls of its box."""

    near: bool = False
    positive: bool = True


@dataclass(frozen=True, slots=True)
class InBox:
    """The item is in the left (0), middle (1) or right (2) box."""

    index: int
    positive: bool = True


@dataclass(frozen=True, slots=True)
class AtPosition:
    """The item is at this position of its tower."""

    position: TowerPosition
    positive: bool = True


@dataclass(frozen=True, slots=True)
class RelatedTo:
    """The item stands in the relation to another item that the noun phrase denotes."""

    relation: Relation
    noun: NounPhrase
    positive: bool = True


@dataclass(frozen=True, slots=True)
class RelatedByAttribute:
    """The item stands in the relation to another with the same attribute value, or (`same` False) a different one."""

    relation: Relation
    attribute: Attribute
    same: bool
    positive: bool = True


Predicate = Matches | AtWall | InCorner | InBox | AtPosition | RelatedTo | RelatedByAttribute


@dataclass(frozen=True, slots=True)
class NounPhrase:
    """Denotes the items that match the description and satisfy every predicate."""

    description: Description = Description()
    predicates: tuple[Predicate, ...] = ()

    def such_that(self, predicate: Predicate) -> NounPhrase:
        return NounPhrase(self.description, (*self.predicates, predicate))


ANYTHING = NounPhrase()


@dataclass(frozen=True, slots=True)
class Count:
    """The picture, or the box, has this quantity of the items."""

    quantity: Quantity
    noun: NounPhrase


@dataclass(frozen=True, slots=True)
class PartitiveCount:
    """The picture, or the box, has this quantity of the items, and this part of them satisfies the predicate."""

    quantity: Quantity
    noun: NounPhrase
    partitive: Partitive
    predicate: Predicate


@dataclass(frozen=True, slots=True)
class Variety:
    """The items of the picture, or of the box, have this quantity of different values of the attribute."""

    attribute: Attribute
    quantity: Quantity


@dataclass(frozen=True, slots=True)
class ContainsOnly:
    """The box is not empty and every item in it matches the description."""

    description: Description


@dataclass(frozen=True, slots=True)
class EndColour:
    """The top or bottom item of the tower has one of the colours."""

    position: TowerPosition
    colours: frozenset[Colour]


@dataclass(frozen=True, slots=True)
class MatchingEnds:
    """The tower has at least two items, and its top and bottom have the same colour, or (`same` False) differ."""

    same: bool


PictureOrBoxCondition = Count | PartitiveCount | Variety
BoxCondition = PictureOrBoxCondition | ContainsOnly | EndColour | MatchingEnds
BoxConditions = tuple[BoxCondition, ...]


@dataclass(frozen=True, slots=True)
class BoxCount:
    """This quantity of boxes satisfies all conditions; with `towers` only boxes that are not empty count."""

    quantity: Quantity
    conditions: BoxConditions
    towers: bool = False


@dataclass(frozen=True, slots=True)
class EveryTower:
    """There is a tower, and every tower satisfies all conditions."""

    conditions: BoxConditions


@dataclass(frozen=True, slots=True)
class NamedBox:
    """The box at this index satisfies all conditions; with `towers` it must not be empty."""

    index: int
    conditions: BoxConditions
    towers: bool = False


@dataclass(frozen=True, slots=True)
class EveryItem:
    """There are such items, and every one satisfies the predicate, or (`positive` False) not every one does."""

    noun: NounPhrase
    predicate: Predicate
    positive: bool = True


@dataclass(frozen=True, slots=True)
class CountComparison:
    """There are more, fewer or as many of the first items than of the second; `margin` is the exact difference."""

    one: NounPhrase
    order: Order
    other: NounPhrase
    margin: int | None = None


@dataclass(frozen=True, slots=True)
class BoxComparison:
    """Box `one` has more, fewer or as many of the items than box `other`; with `towers` neither may be empty."""

    noun: NounPhrase
    one: int
    order: Order
    other: int
    towers: bool = False


@dataclass(frozen=True, slots=True)
class EqualCounts:
    """All boxes contain equally many of the items, or (`same` False) no two boxes do."""

    noun: NounPhrase
    same: bool


@dataclass(frozen=True, slots=True)
class Parity:
    """The number of the items is even or odd."""

    noun: NounPhrase
    even: bool


@dataclass(frozen=True, slots=True)
class LargestBox:
    """One box contains more of the items than any other, and satisfies the conditions."""

    noun: NounPhrase
    conditions: BoxConditions


@dataclass(frozen=True, slots=True)
class Compound:
    """A conjunction of clauses, or (`conjunctive` False) a disjunction."""

    conjunctive: bool
    clauses: tuple[Clause, ...]


ComparingClause = CountComparison | BoxComparison | EqualCounts | LargestBox
Clause = PictureOrBoxCondition | BoxCount | NamedBox | EveryItem | EveryTower | ComparingClause | Parity | Compound


def with_values_replaced(node: Node, colours: Mapping[Colour, Colour], shapes: Mapping[Shape, Shape]) -> Node:
    """The same tree with other colours and shapes: in the same wording, its statement has the same form."""

    def replaced(part: Any) -> Any:
        match part:
            case Colour():
                return colours[part]
            case Shape():
                return shapes[part]
            case frozenset():
                return frozenset(map(replaced, cast("frozenset[object]", part)))
            case tuple() if not isinstance(part, Quantity):
                return tuple(map(replaced, cast("tuple[object, ...]", part)))
            case _ if is_dataclass(part):
                return type(part)(*(replaced(getattr(part, field.name)) for field in fields(part)))
            case _:
                return part

    return replaced(node)
