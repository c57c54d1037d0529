"""Random meanings by level of difficulty, 1 to 5.

1: one quantity of plain items. 2: one more thing about them: a wall, a place, a box, all of them. 3: two things
at once, relations between items, comparisons. 4: quantities over boxes, coreference, superlatives, named boxes
compared. 5: clauses of levels 2 to 4 joined, boxes with three conditions.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations
from typing import TypeVar

from lilgym_mp.choices import choose
from lilgym_mp.generator.semantics import (
    ANYTHING,
    NONE,
    SOME,
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
from lilgym_mp.scene import BOX_COUNT, Colour, Shape, Size

LEVELS = (1, 2, 3, 4, 5)
Option = TypeVar("Option")
Makers = Sequence[tuple[int, Callable[[], Clause]]]  # with weights


def random_meaning(appearance: str, level: int, rng: random.Random) -> Clause:
    """A meaning of that level; it may be unsatisfiable or always true, which `soundness` finds out.

    Raises ValueError for an unknown appearance or level.
    """
    meanings = choose("appearance", appearance, {"tower": TowerMeanings, "scatter": ScatterMeanings})(rng)
    if level not in LEVELS:
        raise ValueError(f"unknown level {level!r}; choose from {', '.join(map(str, LEVELS))}")
    while not _sensible(meaning := meanings.of_level(level)):
        pass
    return meaning


class Meanings:
    """What both appearances have."""

    most = 5  # the largest number asked for

    def __init__(self, rng: random.Random) -> None:
        self.rng = rng

    def of_level(self, level: int) -> Clause:
        makers = self.makers()[level]
        (maker,) = self.rng.choices([make for _, make in makers], [weight for weight, _ in makers])
        return maker()

    def makers(self) -> dict[int, Makers]:
        raise NotImplementedError

    def pick(self, *options: Option) -> Option:
        return self.rng.choice(options)

    def chance(self, share: float) -> bool:
        return self.rng.random() < share

    def colours(self, number: int = 1) -> frozenset[Colour]:
        return frozenset(self.rng.sample(list(Colour), number))

    def quantity(self, most: int | None = None, *, none: float = 0.08) -> Quantity:
        """Existence and exact numbers often, bounds less often, zero with chance `none`."""
        if self.chance(none):
            return NONE
        most = most or self.most
        number = min(most, self.pick(1, 2, 2, 3, 3, 4, 5))
        match self.pick("some", "some", "some", "exact", "exact", "least", "least", "most", "range", "soft"):
            case "exact":
                return Quantity(number, number)
            case "least":
                return Quantity(max(2, number), None)
            case "most":
                return Quantity(0, number)
            case "range" if number < most:
                return Quantity(number, number + self.pick(1, 1, 2))
            case "soft" if most >= 4:
                return Quantity(self.pick(3, 4), None, soft=True)
            case _:
                return SOME

    def few(self) -> Quantity:
        """A quantity for the items of one box, or of boxes."""
        return self.pick(SOME, SOME, Quantity(1, 1), Quantity(2, 2), Quantity(2, None), Quantity(3, 3), NONE)

    def boxes(self) -> Quantity:
        """A quantity of boxes."""
        options = (SOME, SOME, SOME, SOME, Quantity(1, 1), Quantity(2, 2), Quantity(2, 2), Quantity(2, None), NONE)
        return self.pick(*options)

    def share(self, quantity: Quantity) -> Share:
        if quantity == Quantity(1, 1):
            return Share.ALL
        return self.pick(Share.ALL, Share.NONE, Share.SOME, Share.ONE)

    def number_of_them(self) -> Quantity:
        return self.pick(Quantity(1, 1), Quantity(2, 2), Quantity(2, 2), Quantity(3, 3))

    def counted(self) -> Clause:
        return ItemCount(self.quantity(), self.plain())

    def two_counted(self) -> Clause:
        every = self.chance(0.7)
        first = ItemCount(self.quantity(3), self.plain())
        quantity = self.quantity(3, none=0.3) if every else self.quantity(3, none=0)
        return Joined(every, (first, ItemCount(quantity, self.plain())))

    def plain(self) -> Noun:
        raise NotImplementedError

    def compared(self) -> Clause:
        order = self.pick(Order.MORE, Order.MORE, Order.FEWER, Order.EQUAL)
        margin = self.pick(1, 2) if order is not Order.EQUAL and self.chance(0.25) else None
        return Compared(self.plain(), order, self.plain(), margin)

    def evenly(self) -> Clause:
        return Evenly(self.pick(ANYTHING, self.plain()), self.chance(0.5))

    def two_boxes(self) -> tuple[int, int]:
        one, other = self.rng.sample(range(BOX_COUNT), 2)
        return one, other

    def box_with(self, number: int, *, quantity: Quantity | None = None) -> Clause:
        return BoxCount(quantity or self.boxes(), self.conditions(number))

    def conditions(self, number: int) -> Conditions:
        """Conditions of different kinds or about different looks; what a box lacks comes last."""
        while True:
            found = [self.condition() for _ in range(number)]
            if not any(_clash(one, other) for one, other in combinations(found, 2)):
                return tuple(sorted(found, key=_place))

    def condition(self) -> Condition:
        raise NotImplementedError

    def joined(self) -> Clause:
        parts: list[Clause] = []
        while len(parts) < 2:
            part = self.of_level(self.pick(2, 2, 3, 3, 4))
            parts += [] if isinstance(part, Joined) else [part]
        return Joined(self.chance(0.75), tuple(parts))


def _clash(one: Condition, other: Condition) -> bool:
    """Whether the two would say the same twice or read oddly side by side."""
    if isinstance(one, Has) and isinstance(other, Has):
        return one.noun == other.noun or (ANYTHING in (one.noun, other.noun) and NONE in (one.quantity, other.quantity))
    if isinstance(one, Purely) or isinstance(other, Purely):
        return not any(isinstance(c, Has) and c.noun == ANYTHING and c.quantity.low for c in (one, other))
    if isinstance(one, Ends) and isinstance(other, Ends):
        return one.level is other.level
    if {type(one), type(other)} == {Ends, SameEnds}:
        return True
    if {type(one), type(other)} == {Has, Varied}:
        return Has(Quantity(1, 1), ANYTHING) in (one, other)
    if isinstance(one, Sharing) or isinstance(other, Sharing):
        return True
    return type(one) is type(other)


def _place(condition: Condition) -> int:
    """Where a condition stands in a list: numbers of anything first, what is lacking last."""
    if isinstance(condition, Has):
        return 3 if condition.quantity == NONE else 0 if condition.noun == ANYTHING else 1
    return 2


def _sensible(clause: Clause) -> bool:
    """Whether nothing is said of an attribute that the noun has fixed, and nothing is set against itself."""
    match clause:
        case Every(noun, HasLook(look)) | NotEvery(noun, HasLook(look)) | SharedCount(_, noun, _, HasLook(look)):
            return not _same_attribute(noun.look, look)
        case Every(noun, trait) | NotEvery(noun, trait) | SharedCount(_, noun, _, trait):
            return trait not in noun.traits
        case BoxCount(Quantity(0, 0), conditions) if any(map(_lacks_or_bounds, conditions)):
            return False
        case BoxCount(_, conditions) | BoxIs(_, conditions) | Extreme(_, conditions) | EveryTower(conditions):
            return all(
                not _same_attribute(condition.noun.look, condition.trait.look)
                for condition in conditions
                if isinstance(condition, Sharing) and isinstance(condition.trait, HasLook)
            )
        case Compared(one, _, other):
            return one != other and not (one.look.colours & other.look.colours and one.look.shape == other.look.shape)
        case Joined(every, clauses):
            if not every and any(
                part.noun.look.colours
                for part in clauses
                if isinstance(part, ItemCount) and len(part.noun.look.colours) > 1
            ):
                return False
            nouns = [part.noun for part in clauses if isinstance(part, ItemCount)]
            return len(set(clauses)) == len(clauses) and len(set(nouns)) == len(nouns) and all(map(_sensible, clauses))
        case _:
            return True


def _lacks_or_bounds(condition: Condition) -> bool:
    """Whether "no box has ..." would turn it into a riddle: no box has no circles, no box has no fewer than two."""
    return isinstance(condition, Has) and condition.quantity not in (
        SOME,
        Quantity(1, 1),
        Quantity(2, 2),
        Quantity(3, 3),
    )


def _same_attribute(one: Look, other: Look) -> bool:
    """Whether both looks say something of shape, of colour or of size."""
    return bool(
        (one.colours and other.colours)
        or (one.shape is not None and other.shape is not None)
        or (one.size is not None and other.size is not None)
    )


class TowerMeanings(Meanings):
    """Coloured blocks in stacks."""

    def makers(self) -> dict[int, Makers]:
        return {
            1: [(6, self.counted), (2, self.all_coloured), (1, self.varied), (3, self.in_named_box), (2, self.total)],
            2: [
                (4, self.placed),
                (6, lambda: self.tower_with(1)),
                (3, self.named_tower),
                (2, lambda: self.box_with(1)),
                (2, self.each_box),
            ],
            3: [
                (5, lambda: self.tower_with(2)),
                (4, self.stacked),
                (3, self.compared),
                (3, self.two_counted),
                (2, self.each_tower),
                (2, self.every),
            ],
            4: [
                (3, self.stacked_many),
                (3, self.shared),
                (2, self.extreme),
                (2, self.boxes_compared),
                (2, self.evenly),
                (2, self.not_every),
                (1, self.parity),
                (3, lambda: self.tower_with(2, quantity=self.pick(Quantity(2, 2), Quantity(2, None), Quantity(1, 1)))),
                (2, self.two_named),
            ],
            5: [(6, self.joined), (3, lambda: self.tower_with(3)), (3, self.sharing_box)],
        }

    def plain(self) -> Noun:
        return Noun(Look(colours=self.colours(self.pick(1, 1, 1, 1, 2))))

    def colour_noun(self) -> Noun:
        return Noun(Look(colours=self.colours()))

    def total(self) -> Clause:
        return ItemCount(self.quantity(7, none=0), ANYTHING)

    def all_coloured(self) -> Clause:
        return Every(ANYTHING, HasLook(Look(colours=self.colours(self.pick(1, 2, 2)))))

    def varied(self) -> Clause:
        return PictureVaried(
            Attribute.COLOUR, self.pick(Quantity(1, 1), Quantity(2, 2), Quantity(3, 3), Quantity(2, None))
        )

    def in_named_box(self) -> Clause:
        return BoxIs(self.pick(0, 1, 2), (self.pick(Has(self.few(), self.colour_noun()), Has(NONE, ANYTHING)),))

    def level_trait(self) -> Trait:
        return AtLevel(self.pick(Level.TOP, Level.TOP, Level.BOTTOM, Level.BOTTOM, Level.SECOND, Level.THIRD))

    def placed(self) -> Clause:
        return ItemCount(self.quantity(3, none=0.1), self.plain().also(self.level_trait()))

    def condition(self) -> Condition:
        match self.pick("has", "has", "height", "height", "end", "end", "pure", "varied", "ends"):
            case "has":
                return Has(self.few(), self.colour_noun())
            case "height":
                number = self.pick(1, 2, 2, 3, 3, 4)
                exact = Quantity(number, number)
                return Has(self.pick(exact, exact, Quantity(max(2, min(3, number)), None)), ANYTHING)
            case "end":
                return Ends(self.pick(Level.TOP, Level.BOTTOM), self.colours())
            case "pure":
                return Purely(Look(colours=self.colours(self.pick(1, 1, 2))))
            case "varied":
                return Varied(
                    Attribute.COLOUR, self.pick(Quantity(1, 1), Quantity(2, 2), Quantity(2, None), Quantity(3, 3))
                )
            case _:
                return SameEnds(self.chance(0.6))

    def tower_with(self, number: int, *, quantity: Quantity | None = None) -> Clause:
        return BoxCount(quantity or self.boxes(), self.conditions(number), towers=True)

    def named_tower(self) -> Clause:
        return BoxIs(self.pick(0, 1, 2), self.conditions(1), towers=True)

    def two_named(self) -> Clause:
        return BoxIs(self.pick(0, 1, 2), self.conditions(2), towers=True)

    def each_box(self) -> Clause:
        return BoxCount(Quantity(3, 3), (Has(self.pick(SOME, SOME, NONE, Quantity(1, 1)), self.colour_noun()),))

    def each_tower(self) -> Clause:
        return EveryTower(self.conditions(1))

    def pile(self) -> Beside | BesideLike:
        relation = self.pick(Relation.ON, Relation.ON, Relation.UNDER, Relation.ABOVE, Relation.BELOW)
        if self.chance(0.2):
            return BesideLike(relation, Attribute.COLOUR, self.chance(0.6))
        return Beside(relation, self.colour_noun())

    def stacked(self) -> Clause:
        return ItemCount(self.pick(SOME, SOME, SOME, NONE), self.colour_noun().also(self.pile()))

    def stacked_many(self) -> Clause:
        quantity = self.pick(Quantity(1, 1), Quantity(2, 2), Quantity(2, None), Quantity(0, 1))
        return ItemCount(quantity, self.plain().also(self.pile()))

    def trait(self) -> Trait:
        return self.pick(self.level_trait(), self.pile(), InBox(self.pick(0, 1, 2)))

    def every(self) -> Clause:
        if self.chance(0.3):
            return Every(Noun(Look(), (self.level_trait(),)), HasLook(Look(colours=self.colours(self.pick(1, 2)))))
        return Every(self.colour_noun(), self.trait())

    def not_every(self) -> Clause:
        return NotEvery(self.colour_noun(), self.trait())

    def shared(self) -> Clause:
        quantity = self.number_of_them()
        return SharedCount(quantity, self.colour_noun(), self.share(quantity), self.trait())

    def extreme(self) -> Clause:
        return Extreme(ANYTHING, self.conditions(1))

    def boxes_compared(self) -> Clause:
        one, other = self.two_boxes()
        order = self.pick(*Order)
        if self.chance(0.5):
            return BoxesCompared(ANYTHING, one, order, other, towers=True)
        return BoxesCompared(self.pick(ANYTHING, self.colour_noun()), one, order, other)

    def parity(self) -> Clause:
        return Parity(self.pick(ANYTHING, self.colour_noun()), self.chance(0.4))

    def sharing_box(self) -> Clause:
        quantity = self.number_of_them()
        trait = self.pick(self.pile(), AtLevel(self.pick(Level.TOP, Level.BOTTOM)))
        return BoxCount(SOME, (Sharing(quantity, self.colour_noun(), self.share(quantity), trait),), towers=True)


class ScatterMeanings(Meanings):
    """Items of three shapes, colours and sizes anywhere in the boxes."""

    def makers(self) -> dict[int, Makers]:
        return {
            1: [(7, self.counted), (2, self.all_alike), (1, self.varied), (3, self.in_named_box), (1, self.total)],
            2: [
                (6, self.with_trait),
                (6, lambda: self.box_with(1)),
                (2, self.every),
                (2, self.each_box),
                (1, self.in_named_box),
            ],
            3: [
                (5, lambda: self.box_with(2)),
                (4, self.related),
                (3, self.compared),
                (3, self.two_counted),
                (2, self.with_two_traits),
                (2, self.every_with_trait),
                (2, self.many_with_trait),
            ],
            4: [
                (4, self.shared),
                (3, self.related_many),
                (2, self.extreme),
                (2, self.boxes_compared),
                (2, self.evenly),
                (2, self.not_every),
                (1, self.parity),
                (3, lambda: self.box_with(2, quantity=self.pick(Quantity(2, 2), Quantity(2, None), Quantity(1, 1)))),
                (2, self.two_named),
            ],
            5: [(6, self.joined), (3, lambda: self.box_with(3)), (4, self.sharing_box)],
        }

    def look(self, *, rich: float = 0.5) -> Look:
        """A colour, a shape or a size; with chance `rich` two of them or, rarely, all."""
        kinds = self.pick("colour", "colour", "shape", "shape", "size")
        if self.chance(rich):
            kinds = self.pick(
                "colour shape", "colour shape", "colour shape", "size shape", "size colour", "size colour shape"
            )
        return Look(
            shape=self.pick(*Shape) if "shape" in kinds else None,
            colours=self.colours(self.pick(1, 1, 1, 1, 1, 2)) if "colour" in kinds else frozenset(),
            size=self.pick(*Size) if "size" in kinds else None,
        )

    def plain(self) -> Noun:
        return Noun(self.look())

    def total(self) -> Clause:
        return ItemCount(self.quantity(6, none=0), ANYTHING)

    def attribute(self) -> Attribute:
        return self.pick(Attribute.COLOUR, Attribute.COLOUR, Attribute.SHAPE, Attribute.SIZE)

    def all_alike(self) -> Clause:
        return Every(ANYTHING, HasLook(self.look(rich=0.2)))

    def varied(self) -> Clause:
        return PictureVaried(
            self.attribute(), self.pick(Quantity(1, 1), Quantity(2, 2), Quantity(3, 3), Quantity(2, None))
        )

    def in_named_box(self) -> Clause:
        return BoxIs(
            self.pick(0, 1, 2),
            (self.pick(Has(self.few(), self.plain()), Has(self.few(), self.plain()), Has(NONE, ANYTHING)),),
        )

    def trait(self, *, positive: bool = False) -> Trait:
        holds = positive or self.chance(0.85)
        match self.pick("wall", "wall", "side", "side", "side", "close", "corner", "box"):
            case "wall":
                return AtWall(holds=holds)
            case "side":
                return AtWall(self.pick(*Wall), holds=holds)
            case "close":
                return AtWall(self.pick(None, *Wall), close=True)
            case "corner":
                return InCorner(holds=holds)
            case _:
                return InBox(self.pick(0, 1, 2), holds=holds)

    def relation(self) -> Beside | BesideLike:
        relation = self.pick(Relation.TOUCHING, Relation.TOUCHING, Relation.NEAR, Relation.ABOVE, Relation.BELOW)
        if self.chance(0.2):
            return BesideLike(relation, self.attribute(), self.chance(0.6))
        noun = self.pick(Noun(self.look(rich=0.4)), Noun(self.look(rich=0.4)), ANYTHING)
        return Beside(relation, noun, holds=relation is not Relation.TOUCHING or self.chance(0.85))

    def with_trait(self) -> Clause:
        return ItemCount(self.pick(SOME, SOME, self.quantity(4)), self.plain().also(self.trait()))

    def many_with_trait(self) -> Clause:
        return ItemCount(self.quantity(4), Noun(self.look(rich=0.3)).also(self.trait()))

    def with_two_traits(self) -> Clause:
        first = self.pick(AtWall(self.pick(None, *Wall)), InCorner())
        return ItemCount(self.quantity(2), Noun(self.look(rich=0.3), (first, InBox(self.pick(0, 1, 2)))))

    def every(self) -> Clause:
        return Every(Noun(self.look(rich=0.3)), self.pick(HasLook(self.look(rich=0)), self.trait(positive=True)))

    def every_with_trait(self) -> Clause:
        if self.chance(0.6):
            return Every(Noun(Look(), (self.trait(positive=True),)), HasLook(self.look(rich=0)))
        return Every(Noun(self.look(rich=0.3)), self.relation_held())

    def relation_held(self) -> Beside | BesideLike:
        return replace(self.relation(), holds=True)

    def each_box(self) -> Clause:
        return BoxCount(
            Quantity(3, 3), (Has(self.pick(SOME, SOME, NONE, Quantity(1, 1), Quantity(2, None)), self.plain()),)
        )

    def related(self) -> Clause:
        return ItemCount(self.pick(SOME, SOME, SOME, NONE), self.plain().also(self.relation()))

    def related_many(self) -> Clause:
        quantity = self.pick(Quantity(1, 1), Quantity(2, 2), Quantity(2, None), Quantity(0, 1))
        return ItemCount(quantity, Noun(self.look(rich=0.3)).also(self.relation()))

    def condition(self) -> Condition:
        match self.pick("has", "has", "has", "has", "has", "total", "total", "pure", "varied", "trait"):
            case "has":
                return Has(self.few(), self.plain())
            case "total":
                number = self.pick(1, 2, 3, 3, 4, 5)
                return Has(self.pick(Quantity(number, number), Quantity(max(2, number), None)), ANYTHING)
            case "pure":
                return Purely(self.look(rich=0.2))
            case "varied":
                return Varied(
                    self.attribute(), self.pick(Quantity(1, 1), Quantity(2, 2), Quantity(2, None), Quantity(3, 3))
                )
            case _:
                trait = self.pick(AtWall(), AtWall(self.pick(*Wall)), InCorner())
                return Has(self.pick(SOME, SOME, NONE), Noun(self.look(rich=0.3), (trait,)))

    def two_named(self) -> Clause:
        return BoxIs(self.pick(0, 1, 2), self.conditions(2))

    def not_every(self) -> Clause:
        return NotEvery(Noun(self.look(rich=0.2)), self.pick(HasLook(self.look(rich=0)), self.trait(positive=True)))

    def shared(self) -> Clause:
        quantity = self.number_of_them()
        trait = self.pick(HasLook(self.look(rich=0)), self.trait(positive=True), self.trait(positive=True))
        return SharedCount(quantity, self.plain(), self.share(quantity), trait)

    def extreme(self) -> Clause:
        return Extreme(self.pick(ANYTHING, ANYTHING, Noun(self.look(rich=0))), self.conditions(1))

    def boxes_compared(self) -> Clause:
        one, other = self.two_boxes()
        return BoxesCompared(self.pick(ANYTHING, self.plain()), one, self.pick(*Order), other)

    def parity(self) -> Clause:
        return Parity(self.pick(ANYTHING, Noun(self.look(rich=0))), self.chance(0.4))

    def sharing_box(self) -> Clause:
        quantity = self.number_of_them()
        trait = self.pick(HasLook(self.look(rich=0)), AtWall(), AtWall(self.pick(*Wall)), InCorner())
        return BoxCount(SOME, (Sharing(quantity, self.plain(), self.share(quantity), trait),))
