"""Whether a meaning holds in a scene, computed from pixels and not through the program language.

It is the second opinion on every generated program. A `Interpretation` can also bend what people may see or mean
differently (is two pixels from the wall touching it? is "all the circles" true of none?); start scenes are chosen
where every reading agrees. Geometry: SPEC section 8.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from lilgym_mp.generator.semantics import (
    AtLevel,
    Attribute,
    AtWall,
    Beside,
    BesideLike,
    BoxCount,
    BoxesCompared,
    BoxIs,
    Clause,
    Compared,
    Condition,
    Conditions,
    Ends,
    Evenly,
    Every,
    EveryTower,
    Extreme,
    Has,
    HasLook,
    InBox,
    InCorner,
    ItemCount,
    Joined,
    Level,
    Look,
    NotEvery,
    Noun,
    Order,
    Parity,
    PictureVaried,
    Purely,
    Quantity,
    Relation,
    SameEnds,
    Share,
    SharedCount,
    Sharing,
    Trait,
    Varied,
    Wall,
)
from lilgym_mp.scene import BOX_SIDE, Item, Scene

SECOND_BOTTOM, THIRD_BOTTOM = 21, 42  # pixels above the floor


class Interpretation(NamedTuple):
    """One way to take a statement. The defaults are the language's own."""

    wall_gap: int = 0  # pixels at which an item still touches a wall
    touch_gap: int = 1  # pixels at which two items still touch
    close_gap: int = 4  # pixels at which items or walls are touching or almost
    overlap: int = 0  # pixels by which the higher of two items may reach below the other's top and be above
    vacuous: bool = False  # whether all of none is true
    soft_shift: int = 0  # what vague words mean more or less than the language says
    exclusive: bool = False  # whether "or" excludes both
    ties: bool = False  # whether one of several tallest towers is "the tallest" one


STANDARD = Interpretation()
ALTERNATIVES = (
    Interpretation(wall_gap=3, touch_gap=4, close_gap=7, overlap=14, vacuous=True, soft_shift=-1, ties=True),
    Interpretation(touch_gap=0, close_gap=2, overlap=-2, soft_shift=1, exclusive=True),
)


class Seen(NamedTuple):
    """An item where it is; y upwards from the floor of its box."""

    item: Item
    box: int
    left: int
    right: int
    top: int
    bottom: int


def holds(clause: Clause, scene: Scene, reading: Interpretation = STANDARD) -> bool:
    """Whether the clause is true of the scene under that reading."""
    return _View(scene, reading).clause(clause)


class _View:
    """A scene looked at under one reading."""

    def __init__(self, scene: Scene, reading: Interpretation) -> None:
        self.boxes = [[_seen(item, index) for item in box.items] for index, box in enumerate(scene.boxes)]
        self.items = [seen for box in self.boxes for seen in box]
        self.reading = reading

    def clause(self, clause: Clause) -> bool:
        match clause:
            case ItemCount(quantity, noun):
                return self.number(quantity, len(self.named(self.items, noun)))
            case SharedCount():
                return self.shared(self.items, clause)
            case BoxCount(quantity, conditions, towers):
                return self.number(quantity, sum(self.box(box, conditions, towers) for box in self.boxes))
            case EveryTower(conditions):
                towers = [box for box in self.boxes if box]
                met = all(self.box(box, conditions, towers=True) for box in towers)
                return met and (bool(towers) or self.reading.vacuous)
            case BoxIs(index, conditions, towers):
                return self.box(self.boxes[index], conditions, towers)
            case Every(noun, trait):
                return self.every(self.named(self.items, noun), trait)
            case NotEvery(noun, trait):
                return not all(self.trait(seen, trait) for seen in self.named(self.items, noun))
            case Compared(one, order, other, margin):
                counts = (len(self.named(self.items, one)), len(self.named(self.items, other)))
                return _ordered(counts, order) if margin is None else counts[0] - counts[1] == _signed(order, margin)
            case BoxesCompared(noun, one, order, other, towers):
                pair = (self.boxes[one], self.boxes[other])
                counts = (len(self.named(pair[0], noun)), len(self.named(pair[1], noun)))
                return _ordered(counts, order) and (all(pair) or not towers)
            case PictureVaried(attribute, quantity):
                return self.number(quantity, len(_values(self.items, attribute)))
            case Evenly(noun, same):
                return len({len(self.named(box, noun)) for box in self.boxes}) == (1 if same else len(self.boxes))
            case Parity(noun, even):
                return (len(self.named(self.items, noun)) % 2 == 0) == even
            case Extreme(noun, conditions):
                numbers = [len(self.named(box, noun)) for box in self.boxes]
                first = [box for box, number in zip(self.boxes, numbers, strict=True) if number == max(numbers)]
                meeting = (self.box(box, conditions, towers=False) for box in first)
                return any(meeting) and (len(first) == 1 or self.reading.ties)
            case Joined(every, clauses):
                values = [self.clause(part) for part in clauses]
                return all(values) if every else any(values) and not (self.reading.exclusive and sum(values) > 1)

    def number(self, quantity: Quantity, count: int) -> bool:
        shift = self.reading.soft_shift if quantity.soft else 0
        return quantity.holds(count - shift)

    def named(self, items: Sequence[Seen], noun: Noun) -> list[Seen]:
        return [
            seen for seen in items if _looks(seen, noun.look) and all(self.trait(seen, trait) for trait in noun.traits)
        ]

    def every(self, items: Sequence[Seen], trait: Trait) -> bool:
        return all(self.trait(seen, trait) for seen in items) and (bool(items) or self.reading.vacuous)

    def shared(self, items: Sequence[Seen], clause: SharedCount | Sharing) -> bool:
        mine = self.named(items, clause.noun)
        having = sum(self.trait(seen, clause.trait) for seen in mine)
        fits = {Share.ALL: having == len(mine), Share.NONE: having == 0, Share.SOME: having > 0, Share.ONE: having == 1}
        return self.number(clause.quantity, len(mine)) and fits[clause.share]

    def trait(self, seen: Seen, trait: Trait) -> bool:
        return self.shows(seen, trait) == trait.holds

    def shows(self, seen: Seen, trait: Trait) -> bool:
        match trait:
            case HasLook(look):
                return _looks(seen, look)
            case AtWall(wall, close):
                near = self.walls(seen, close)
                return bool(near) if wall is None else wall in near
            case InCorner(close):
                return len(self.walls(seen, close)) == 2
            case InBox(index):
                return seen.box == index
            case AtLevel(level):
                return self.at_level(seen, level)
            case Beside(relation, noun):
                return bool(self.named(self.all_related(seen, relation), noun))
            case BesideLike(relation, attribute, same):
                mine = _value(seen.item, attribute)
                others = (_value(other.item, attribute) for other in self.all_related(seen, relation))
                return any((other == mine) == same for other in others)

    def all_related(self, seen: Seen, relation: Relation) -> list[Seen]:
        box = self.boxes[seen.box]
        return [other for other in box if other is not seen and self.related(seen, relation, other)]

    def walls(self, seen: Seen, close: bool) -> set[Wall]:
        reach = self.reading.close_gap if close else self.reading.wall_gap
        gaps = {
            Wall.LEFT: seen.left,
            Wall.RIGHT: BOX_SIDE - seen.right,
            Wall.TOP: BOX_SIDE - seen.top,
            Wall.BOTTOM: seen.bottom,
        }
        return {wall for wall, gap in gaps.items() if gap <= reach}

    def at_level(self, seen: Seen, level: Level) -> bool:
        tops = [other.top for other in self.boxes[seen.box]]
        match level:
            case Level.TOP:
                return seen.top == max(tops)
            case Level.BOTTOM:
                return seen.top == min(tops)
            case Level.SECOND:
                return seen.bottom == SECOND_BOTTOM
            case Level.THIRD:
                return seen.bottom == THIRD_BOTTOM

    def related(self, seen: Seen, relation: Relation, other: Seen) -> bool:
        gap = max(seen.left - other.right, other.left - seen.right, seen.bottom - other.top, other.bottom - seen.top)
        above = seen.bottom + self.reading.overlap >= other.top and seen.top > other.top
        below = other.bottom + self.reading.overlap >= seen.top and other.top > seen.top
        match relation:
            case Relation.TOUCHING:
                return gap <= self.reading.touch_gap
            case Relation.NEAR:
                return gap <= self.reading.close_gap
            case Relation.ON:
                return above and gap <= 1
            case Relation.UNDER:
                return below and gap <= 1
            case Relation.ABOVE:
                return above
            case Relation.BELOW:
                return below

    def box(self, box: Sequence[Seen], conditions: Conditions, towers: bool) -> bool:
        return all(self.condition(box, condition) for condition in conditions) and (bool(box) or not towers)

    def condition(self, box: Sequence[Seen], condition: Condition) -> bool:
        match condition:
            case Has(quantity, noun):
                return self.number(quantity, len(self.named(box, noun)))
            case Purely(look):
                return bool(box) and all(_looks(seen, look) for seen in box)
            case Varied(attribute, quantity):
                return self.number(quantity, len(_values(box, attribute)))
            case Ends(level, colours):
                return any(self.at_level(seen, level) and seen.item.colour in colours for seen in box)
            case SameEnds(same):
                ends = [seen for seen in box if self.at_level(seen, Level.TOP) or self.at_level(seen, Level.BOTTOM)]
                return len(box) > 1 and (len(_values(ends, Attribute.COLOUR)) == 1) == same
            case Sharing():
                return self.shared(box, condition)


def _seen(item: Item, box: int) -> Seen:
    top = BOX_SIDE - item.y
    return Seen(item, box, item.x, item.x + item.side, top, top - item.side)


def _looks(seen: Seen, look: Look) -> bool:
    item = seen.item
    return (
        look.shape in (None, item.shape)
        and look.size in (None, item.size)
        and (not look.colours or item.colour in look.colours)
    )


def _values(items: Sequence[Seen], attribute: Attribute) -> set[int]:
    return {_value(seen.item, attribute) for seen in items}


def _value(item: Item, attribute: Attribute) -> int:
    match attribute:
        case Attribute.COLOUR:
            return item.colour
        case Attribute.SHAPE:
            return item.shape
        case Attribute.SIZE:
            return item.size


def _ordered(counts: tuple[int, int], order: Order) -> bool:
    one, other = counts
    return {Order.MORE: one > other, Order.FEWER: one < other, Order.EQUAL: one == other}[order]


def _signed(order: Order, margin: int) -> int:
    return margin if order is Order.MORE else -margin
