"""Samples random meanings by difficulty level.

1: one count of items described by attributes. 2: one predicate or box condition, or a universal statement. 3: two
conditions, relations between items, comparisons. 4: counts of boxes, coreference, superlatives, comparisons of named
boxes. 5: compounds of clauses of levels 2 to 4, boxes with three conditions.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations
from typing import TypeVar

from lilgym_mp.choices import choose
from lilgym_mp.generator.meanings import semantics as sem
from lilgym_mp.generator.quantities import NONE, SOME, Quantity, at_least, at_most, exactly
from lilgym_mp.scene import BOX_COUNT, Colour, Shape, Size

LEVELS = (1, 2, 3, 4, 5)
Option = TypeVar("Option")
EMPTY = sem.Count(NONE, sem.ANYTHING)
WeightedSamplers = Sequence[tuple[int, Callable[[], sem.Clause]]]  # weight, sampler of one kind of clause


def random_meaning(appearance: str, level: int, rng: random.Random) -> sem.Clause:
    """A meaning of that level. It may be unsatisfiable or always true; `validation` rejects those.

    Raises ValueError for an unknown appearance or level.
    """
    sampler = choose("appearance", appearance, {"tower": TowerMeaningSampler, "scatter": ScatterMeaningSampler})(rng)
    if level not in LEVELS:
        raise ValueError(f"unknown level {level!r}; choose from {', '.join(map(str, LEVELS))}")
    while not _sensible(meaning := sampler.sample(level)):
        pass
    return meaning


class MeaningSampler:
    """Samples clauses and their parts."""

    # Each appearance has its own
    relations: tuple[sem.Relation, ...]

    def samplers_by_level(self) -> dict[int, WeightedSamplers]: ...
    def attribute(self) -> sem.Attribute: ...
    def described_items(self) -> sem.NounPhrase: ...
    def items_in_box(self) -> sem.NounPhrase: ...  # whose counts in one box are of interest
    def simple_items(self) -> sem.NounPhrase: ...  # described by one attribute
    def related_to(self, relation: sem.Relation) -> sem.RelatedTo: ...
    def condition(self) -> sem.BoxCondition: ...

    def __init__(self, rng: random.Random) -> None:
        self.rng = rng

    def sample(self, level: int) -> sem.Clause:
        weights, samplers = zip(*self.samplers_by_level()[level], strict=True)
        (sample,) = self.rng.choices(samplers, weights)
        return sample()

    def pick(self, *options: Option) -> Option:
        return self.rng.choice(options)

    def chance(self, probability: float) -> bool:
        return self.rng.random() < probability

    def box_index(self) -> int:
        return self.rng.choice(range(BOX_COUNT))

    # Quantities

    def quantity(self, max_count: int = 5, *, none: float = 0.08) -> Quantity:
        """Mostly existence, exact counts and lower bounds; zero with probability `none`."""
        if self.chance(none):
            return NONE
        number = min(max_count, self.pick(1, 2, 2, 3, 3, 4, 5))
        match self.pick("some", "some", "some", "exact", "exact", "least", "least", "most", "range", "vague"):
            case "exact":
                return exactly(number)
            case "least":
                return at_least(max(2, number))
            case "most":
                return at_most(number)
            case "range" if number < max_count:
                return Quantity(number, number + self.pick(1, 1, 2))
            case "vague" if max_count >= 4:
                return Quantity(self.pick(3, 4), None, vague=True)
            case _:
                return SOME

    def box_quantity(self) -> Quantity:
        """A quantity of boxes."""
        return self.pick(SOME, SOME, SOME, SOME, exactly(1), exactly(2), exactly(2), at_least(2), NONE)

    def small_quantity(self) -> Quantity:
        return self.pick(exactly(1), exactly(2), at_least(2), at_most(1))

    # Attributes, items and predicates

    def colours(self, number: int, *others: int) -> frozenset[Colour]:
        """Random colours, as many as one of the numbers."""
        return frozenset(self.rng.sample(list(Colour), self.pick(number, *others) if others else number))

    def related(self) -> sem.RelatedTo | sem.RelatedByAttribute:
        relation = self.pick(*self.relations)
        if self.chance(0.2):
            return sem.RelatedByAttribute(relation, self.attribute(), self.chance(0.6))
        return self.related_to(relation)

    # Conditions of boxes

    def contained(self) -> sem.Count:
        return sem.Count(
            self.pick(SOME, SOME, exactly(1), exactly(2), at_least(2), exactly(3), NONE), self.items_in_box()
        )

    def variety(self, *quantities: Quantity) -> sem.Variety:
        return sem.Variety(self.attribute(), self.pick(*quantities))

    def partitive_count(
        self, predicate: Callable[[], sem.Predicate], *, predicate_last: bool = False
    ) -> sem.PartitiveCount:
        quantity = self.pick(exactly(1), exactly(2), exactly(2), exactly(3))
        given = None if predicate_last else predicate()
        noun, partitive = self.items_in_box(), sem.Partitive.ALL
        if quantity != exactly(1):
            partitive = self.pick(sem.Partitive.ALL, sem.Partitive.NONE, sem.Partitive.SOME, sem.Partitive.ONE)
        return sem.PartitiveCount(quantity, noun, partitive, given or predicate())

    def conditions(self, number: int) -> sem.BoxConditions:
        """Compatible conditions, negative ones last."""
        while True:
            found = [self.condition() for _ in range(number)]
            if not any(_clash(one, other) for one, other in combinations(found, 2)):
                return tuple(sorted(found, key=_list_position))

    # Clauses

    def item_count(self) -> sem.Clause:
        return sem.Count(self.quantity(), self.described_items())

    def two_item_counts(self) -> sem.Clause:
        conjunctive = self.chance(0.7)
        first = sem.Count(self.quantity(3), self.described_items())
        quantity = self.quantity(3, none=0.3) if conjunctive else self.quantity(3, none=0)
        return sem.Compound(conjunctive, (first, sem.Count(quantity, self.described_items())))

    def count_comparison(self) -> sem.Clause:
        order = self.pick(sem.Order.MORE, sem.Order.MORE, sem.Order.FEWER, sem.Order.EQUAL)
        margin = self.pick(1, 2) if order is not sem.Order.EQUAL and self.chance(0.25) else None
        return sem.CountComparison(self.described_items(), order, self.described_items(), margin)

    def scene_variety(self) -> sem.Clause:
        return self.variety(exactly(1), exactly(2), exactly(3), at_least(2))

    def equal_counts(self) -> sem.Clause:
        return sem.EqualCounts(self.pick(sem.ANYTHING, self.described_items()), self.chance(0.5))

    def parity(self) -> sem.Clause:
        return sem.Parity(self.pick(sem.ANYTHING, self.simple_items()), self.chance(0.4))

    def related_existence(self) -> sem.Clause:
        return sem.Count(self.pick(SOME, SOME, SOME, NONE), self.items_in_box().such_that(self.related()))

    def box_count(self, number: int, *, towers: bool = False) -> sem.Clause:
        return sem.BoxCount(self.box_quantity(), self.conditions(number), towers)

    def some_boxes(self, *, towers: bool = False) -> sem.Clause:
        return sem.BoxCount(self.pick(exactly(2), at_least(2), exactly(1)), self.conditions(2), towers)

    def named_box(self, number: int, *, towers: bool = False) -> sem.Clause:
        return sem.NamedBox(self.box_index(), self.conditions(number), towers)

    def compound(self) -> sem.Clause:
        parts: list[sem.Clause] = []
        while len(parts) < 2:
            part = self.sample(self.pick(2, 2, 3, 3, 4))
            parts += [] if isinstance(part, sem.Compound) else [part]
        return sem.Compound(self.chance(0.75), tuple(parts))


def _clash(one: sem.BoxCondition, other: sem.BoxCondition) -> bool:
    """Whether the two conditions are redundant or read oddly together."""
    if isinstance(one, sem.Count) and isinstance(other, sem.Count):
        return one.noun == other.noun or (
            sem.ANYTHING in (one.noun, other.noun) and NONE in (one.quantity, other.quantity)
        )
    if isinstance(one, sem.ContainsOnly) or isinstance(other, sem.ContainsOnly):
        return not any(isinstance(c, sem.Count) and c.noun == sem.ANYTHING and c.quantity.low for c in (one, other))
    if isinstance(one, sem.EndColour) and isinstance(other, sem.EndColour):
        return one.position is other.position
    if {type(one), type(other)} == {sem.EndColour, sem.MatchingEnds}:
        return True
    if {type(one), type(other)} == {sem.Count, sem.Variety}:
        return sem.Count(exactly(1), sem.ANYTHING) in (one, other)
    if isinstance(one, sem.PartitiveCount) or isinstance(other, sem.PartitiveCount):
        return True
    return type(one) is type(other)


def _list_position(condition: sem.BoxCondition) -> int:
    """Sort key for the conditions of a box: total counts first, negative conditions last."""
    if isinstance(condition, sem.Count):
        return 3 if condition.quantity == NONE else 0 if condition.noun == sem.ANYTHING else 1
    return 2


def _sensible(clause: sem.Clause) -> bool:
    """Whether no predicate restates or contradicts its noun phrase, and nothing is compared with itself."""
    match clause:
        case sem.EveryItem(noun, sem.Matches(description)) | sem.PartitiveCount(_, noun, _, sem.Matches(description)):
            return not _share_attribute(noun.description, description)
        case sem.EveryItem(noun, predicate) | sem.PartitiveCount(_, noun, _, predicate):
            return predicate not in noun.predicates
        case sem.BoxCount(Quantity(0, 0), conditions) if any(map(_is_negative_or_bounded, conditions)):
            return False
        case (
            sem.BoxCount(_, conditions)
            | sem.NamedBox(_, conditions)
            | sem.LargestBox(_, conditions)
            | sem.EveryTower(conditions)
        ):
            return all(
                not _share_attribute(condition.noun.description, condition.predicate.description)
                for condition in conditions
                if isinstance(condition, sem.PartitiveCount) and isinstance(condition.predicate, sem.Matches)
            )
        case sem.CountComparison(one, _, other):
            return one != other and not (
                one.description.colours & other.description.colours and one.description.shape == other.description.shape
            )
        case sem.Compound(conjunctive, clauses):
            nouns = [part.noun for part in clauses if isinstance(part, sem.Count)]
            if not conjunctive and any(len(noun.description.colours) > 1 for noun in nouns):
                return False
            return len(set(clauses)) == len(clauses) and len(set(nouns)) == len(nouns) and all(map(_sensible, clauses))
        case _:
            return True


def _is_negative_or_bounded(condition: sem.BoxCondition) -> bool:
    """Whether "no box has ..." would be confusing: "no box has no circles", "no box has no fewer than two"."""
    usual = (SOME, exactly(1), exactly(2), exactly(3))
    return isinstance(condition, sem.Count) and condition.quantity not in usual


def _share_attribute(one: sem.Description, other: sem.Description) -> bool:
    """Whether both descriptions give a value for the same attribute."""
    return bool(
        (one.colours and other.colours)
        or (one.shape is not None and other.shape is not None)
        or (one.size is not None and other.size is not None)
    )


class TowerMeaningSampler(MeaningSampler):
    """Meanings about towers of coloured blocks."""

    relations = (sem.Relation.ON, sem.Relation.ON, sem.Relation.UNDER, sem.Relation.ABOVE, sem.Relation.BELOW)

    def samplers_by_level(self) -> dict[int, WeightedSamplers]:
        return {
            1: [
                (6, self.item_count),
                (2, lambda: sem.EveryItem(sem.ANYTHING, self.coloured(1, 2, 2))),
                (1, self.scene_variety),
                (3, lambda: sem.NamedBox(self.box_index(), (self.pick(self.contained(), EMPTY),))),
                (2, lambda: sem.Count(self.quantity(7, none=0), sem.ANYTHING)),
            ],
            2: [
                (4, self.items_at_position),
                (6, lambda: self.box_count(1, towers=True)),
                (3, lambda: self.named_box(1, towers=True)),
                (2, lambda: self.box_count(1)),
                (2, self.every_box),
            ],
            3: [
                (5, lambda: self.box_count(2, towers=True)),
                (4, self.related_existence),
                (3, self.count_comparison),
                (3, self.two_item_counts),
                (2, lambda: sem.EveryTower(self.conditions(1))),
                (2, self.every_item),
            ],
            4: [
                (3, lambda: sem.Count(self.small_quantity(), self.described_items().such_that(self.related()))),
                (3, lambda: self.partitive_count(self.predicate, predicate_last=True)),
                (2, lambda: sem.LargestBox(sem.ANYTHING, self.conditions(1))),
                (2, self.box_comparison),
                (2, self.equal_counts),
                (2, lambda: sem.EveryItem(self.simple_items(), self.predicate(), positive=False)),
                (1, self.parity),
                (3, lambda: self.some_boxes(towers=True)),
                (2, lambda: self.named_box(2, towers=True)),
            ],
            5: [(6, self.compound), (3, lambda: self.box_count(3, towers=True)), (3, self.tower_with_partitive)],
        }

    def attribute(self) -> sem.Attribute:
        return sem.Attribute.COLOUR

    def described_items(self) -> sem.NounPhrase:
        return sem.NounPhrase(sem.Description(colours=self.colours(1, 1, 1, 1, 2)))

    def simple_items(self) -> sem.NounPhrase:
        return sem.NounPhrase(sem.Description(colours=self.colours(1)))

    items_in_box = simple_items

    def coloured(self, number: int, *others: int) -> sem.Matches:
        return sem.Matches(sem.Description(colours=self.colours(number, *others)))

    def at_position(self) -> sem.Predicate:
        return sem.AtPosition(sem.TowerPosition(self.pick("top", "top", "bottom", "bottom", "second", "third")))

    def related_to(self, relation: sem.Relation) -> sem.RelatedTo:
        return sem.RelatedTo(relation, self.simple_items())

    def predicate(self) -> sem.Predicate:
        return self.pick(self.at_position(), self.related(), sem.InBox(self.box_index()))

    def condition(self) -> sem.BoxCondition:
        match self.pick("contains", "contains", "height", "height", "end", "end", "only", "variety", "ends"):
            case "contains":
                return self.contained()
            case "height":
                number = self.pick(1, 2, 2, 3, 3, 4)
                exact = exactly(number)
                return sem.Count(self.pick(exact, exact, at_least(max(2, min(3, number)))), sem.ANYTHING)
            case "end":
                return sem.EndColour(self.pick(sem.TowerPosition.TOP, sem.TowerPosition.BOTTOM), self.colours(1))
            case "only":
                return sem.ContainsOnly(sem.Description(colours=self.colours(1, 1, 2)))
            case "variety":
                return self.variety(exactly(1), exactly(2), at_least(2), exactly(3))
            case _:
                return sem.MatchingEnds(self.chance(0.6))

    def items_at_position(self) -> sem.Clause:
        return sem.Count(self.quantity(3, none=0.1), self.described_items().such_that(self.at_position()))

    def every_box(self) -> sem.Clause:
        return sem.BoxCount(exactly(3), (sem.Count(self.pick(SOME, SOME, NONE, exactly(1)), self.simple_items()),))

    def every_item(self) -> sem.Clause:
        if self.chance(0.3):
            return sem.EveryItem(sem.ANYTHING.such_that(self.at_position()), self.coloured(1, 2))
        return sem.EveryItem(self.simple_items(), self.predicate())

    def box_comparison(self) -> sem.Clause:
        one, other = self.rng.sample(range(BOX_COUNT), 2)
        order = self.pick(*sem.Order)
        if self.chance(0.5):
            return sem.BoxComparison(sem.ANYTHING, one, order, other, towers=True)
        return sem.BoxComparison(self.pick(sem.ANYTHING, self.simple_items()), one, order, other)

    def tower_with_partitive(self) -> sem.Clause:
        ends = (sem.TowerPosition.TOP, sem.TowerPosition.BOTTOM)
        partitive = self.partitive_count(lambda: self.pick(self.related(), sem.AtPosition(self.pick(*ends))))
        return sem.BoxCount(SOME, (partitive,), towers=True)


class ScatterMeaningSampler(MeaningSampler):
    """Meanings about items of three shapes, colours and sizes anywhere in the boxes."""

    relations = (
        *(sem.Relation.TOUCHING, sem.Relation.TOUCHING, sem.Relation.NEAR),
        *(sem.Relation.ABOVE, sem.Relation.BELOW),
    )

    def samplers_by_level(self) -> dict[int, WeightedSamplers]:
        return {
            1: [
                (7, self.item_count),
                (2, lambda: sem.EveryItem(sem.ANYTHING, sem.Matches(self.description(rich=0.2)))),
                (1, self.scene_variety),
                (3, self.named_box_contents),
                (1, lambda: sem.Count(self.quantity(6, none=0), sem.ANYTHING)),
            ],
            2: [
                (6, self.items_with_predicate),
                (6, lambda: self.box_count(1)),
                (2, lambda: sem.EveryItem(self.items(rich=0.3), self.positive_predicate())),
                (2, self.every_box),
                (1, self.named_box_contents),
            ],
            3: [
                (5, lambda: self.box_count(2)),
                (4, self.related_existence),
                (3, self.count_comparison),
                (3, self.two_item_counts),
                (2, self.items_with_two_predicates),
                (2, self.every_item_with_predicate),
                (2, lambda: sem.Count(self.quantity(4), self.items(rich=0.3).such_that(self.predicate()))),
            ],
            4: [
                (4, lambda: self.partitive_count(self.partitive_predicate)),
                (3, lambda: sem.Count(self.small_quantity(), self.items(rich=0.3).such_that(self.related()))),
                (2, self.largest_box),
                (2, self.box_comparison),
                (2, self.equal_counts),
                (2, lambda: sem.EveryItem(self.items(rich=0.2), self.positive_predicate(), positive=False)),
                (1, self.parity),
                (3, self.some_boxes),
                (2, lambda: self.named_box(2)),
            ],
            5: [(6, self.compound), (3, lambda: self.box_count(3)), (4, self.box_with_partitive)],
        }

    def attribute(self) -> sem.Attribute:
        return self.pick(sem.Attribute.COLOUR, sem.Attribute.COLOUR, sem.Attribute.SHAPE, sem.Attribute.SIZE)

    def description(self, *, rich: float) -> sem.Description:
        """One attribute value; with probability `rich` two or, rarely, all three."""
        attributes = self.pick("colour", "colour", "shape", "shape", "size")
        if self.chance(rich):
            attributes = self.pick(
                "colour shape", "colour shape", "colour shape", "size shape", "size colour", "size colour shape"
            )
        return sem.Description(
            shape=self.pick(*Shape) if "shape" in attributes else None,
            colours=self.colours(1, 1, 1, 1, 1, 2) if "colour" in attributes else frozenset(),
            size=self.pick(*Size) if "size" in attributes else None,
        )

    def items(self, *, rich: float = 0.5) -> sem.NounPhrase:
        return sem.NounPhrase(self.description(rich=rich))

    described_items = items_in_box = items

    def simple_items(self) -> sem.NounPhrase:
        return self.items(rich=0)

    def related_to(self, relation: sem.Relation) -> sem.RelatedTo:
        noun = self.pick(self.items(rich=0.4), self.items(rich=0.4), sem.ANYTHING)
        return sem.RelatedTo(relation, noun, positive=relation is not sem.Relation.TOUCHING or self.chance(0.85))

    def predicate(self, *, positive: bool = False) -> sem.Predicate:
        positive = positive or self.chance(0.85)
        match self.pick("wall", "wall", "side", "side", "side", "near", "corner", "box"):
            case "wall":
                return sem.AtWall(positive=positive)
            case "side":
                return sem.AtWall(self.pick(*sem.Wall), positive=positive)
            case "near":
                return sem.AtWall(self.pick(None, *sem.Wall), near=True)
            case "corner":
                return sem.InCorner(positive=positive)
            case _:
                return sem.InBox(self.box_index(), positive=positive)

    def positive_predicate(self) -> sem.Predicate:
        return self.pick(sem.Matches(self.description(rich=0)), self.predicate(positive=True))

    def partitive_predicate(self) -> sem.Predicate:
        matches = sem.Matches(self.description(rich=0))
        return self.pick(matches, self.predicate(positive=True), self.predicate(positive=True))

    def condition(self) -> sem.BoxCondition:
        match self.pick(*["contains"] * 5, "total", "total", "only", "variety", "predicate"):
            case "contains":
                return self.contained()
            case "total":
                number = self.pick(1, 2, 3, 3, 4, 5)
                return sem.Count(self.pick(exactly(number), at_least(max(2, number))), sem.ANYTHING)
            case "only":
                return sem.ContainsOnly(self.description(rich=0.2))
            case "variety":
                return self.variety(exactly(1), exactly(2), at_least(2), exactly(3))
            case _:
                predicate = self.pick(sem.AtWall(), sem.AtWall(self.pick(*sem.Wall)), sem.InCorner())
                return sem.Count(self.pick(SOME, SOME, NONE), self.items(rich=0.3).such_that(predicate))

    def named_box_contents(self) -> sem.Clause:
        return sem.NamedBox(self.box_index(), (self.pick(self.contained(), self.contained(), EMPTY),))

    def items_with_predicate(self) -> sem.Clause:
        return sem.Count(self.pick(SOME, SOME, self.quantity(4)), self.items().such_that(self.predicate()))

    def items_with_two_predicates(self) -> sem.Clause:
        first = self.pick(sem.AtWall(self.pick(None, *sem.Wall)), sem.InCorner())
        quantity, noun = self.quantity(2), self.items(rich=0.3).such_that(first)
        return sem.Count(quantity, noun.such_that(sem.InBox(self.box_index())))

    def every_item_with_predicate(self) -> sem.Clause:
        if self.chance(0.6):
            noun = sem.ANYTHING.such_that(self.predicate(positive=True))
            return sem.EveryItem(noun, sem.Matches(self.description(rich=0)))
        return sem.EveryItem(self.items(rich=0.3), replace(self.related(), positive=True))

    def every_box(self) -> sem.Clause:
        return sem.BoxCount(
            exactly(3), (sem.Count(self.pick(SOME, SOME, NONE, exactly(1), at_least(2)), self.items()),)
        )

    def largest_box(self) -> sem.Clause:
        return sem.LargestBox(self.pick(sem.ANYTHING, sem.ANYTHING, self.simple_items()), self.conditions(1))

    def box_comparison(self) -> sem.Clause:
        one, other = self.rng.sample(range(BOX_COUNT), 2)
        return sem.BoxComparison(self.pick(sem.ANYTHING, self.items()), one, self.pick(*sem.Order), other)

    def box_with_partitive(self) -> sem.Clause:
        def predicate() -> sem.Predicate:
            matches = sem.Matches(self.description(rich=0))
            return self.pick(matches, sem.AtWall(), sem.AtWall(self.pick(*sem.Wall)), sem.InCorner())

        return sem.BoxCount(SOME, (self.partitive_count(predicate),))
