"""Evaluates a meaning in a scene from pixel geometry, independently of the program language.

Every generated program is checked against it. An `Interpretation` varies what people judge differently (does an item
two pixels from the wall touch it? is "all the circles" true of none?); start scenes are chosen where all
interpretations agree. Geometry: docs/spec.md, "Programs".
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from lilgym_mp.generator.meanings import semantics as sem
from lilgym_mp.generator.quantities import Quantity
from lilgym_mp.scene import BOX_SIDE, Item, Scene

SECOND_BOTTOM, THIRD_BOTTOM = 21, 42  # bottom edges of the second and third block, in pixels above the floor


class Interpretation(NamedTuple):
    """Thresholds and conventions for judging a statement. The defaults are those of the program language."""

    wall_gap: int = 0  # largest gap in pixels at which an item touches a wall
    touch_gap: int = 1  # largest gap at which two items touch
    near_gap: int = 4  # largest gap for "touching or almost touching" an item or wall
    overlap: int = 0  # pixels by which an item above another may reach below that one's top
    vacuous: bool = False  # whether "all" and "every" are true of no items
    vague_shift: int = 0  # added to the lower bound of vague quantities
    exclusive: bool = False  # whether "or" is exclusive
    ties: bool = False  # whether "the tallest" may be one of several equally tall towers


STANDARD = Interpretation()
ALTERNATIVES = (
    Interpretation(wall_gap=3, touch_gap=4, near_gap=7, overlap=14, vacuous=True, vague_shift=-1, ties=True),
    Interpretation(touch_gap=0, near_gap=2, overlap=-2, vague_shift=1, exclusive=True),
)


class PlacedItem(NamedTuple):
    """An item with its edges in pixels: x from the left wall of its box, y upwards from the floor."""

    item: Item
    box: int
    left: int
    right: int
    top: int
    bottom: int


def holds(clause: sem.Clause, scene: Scene, interpretation: Interpretation = STANDARD) -> bool:
    """Whether the clause is true in the scene."""
    return _Evaluator(scene, interpretation).clause(clause)


class _Evaluator:
    """Evaluates the parts of a meaning in one scene under one interpretation."""

    def __init__(self, scene: Scene, interpretation: Interpretation) -> None:
        self.boxes = [[_placed(item, index) for item in box.items] for index, box in enumerate(scene.boxes)]
        self.items = [placed for box in self.boxes for placed in box]
        self.interpretation = interpretation

    def clause(self, clause: sem.Clause) -> bool:
        match clause:
            case sem.Count() | sem.PartitiveCount() | sem.Variety():
                return self.condition(self.items, clause)
            case sem.BoxCount(quantity, conditions, towers):
                return self.admits(quantity, sum(self.box(box, conditions, towers) for box in self.boxes))
            case sem.EveryTower(conditions):
                towers = [box for box in self.boxes if box]
                satisfied = all(self.box(box, conditions, towers=True) for box in towers)
                return satisfied and (bool(towers) or self.interpretation.vacuous)
            case sem.NamedBox(index, conditions, towers):
                return self.box(self.boxes[index], conditions, towers)
            case sem.EveryItem(noun, predicate, positive):
                items = self.denoted(self.items, noun)
                satisfied = all(self.satisfies(placed, predicate) for placed in items)
                return satisfied and (bool(items) or self.interpretation.vacuous) if positive else not satisfied
            case sem.CountComparison(one, order, other, margin):
                return _ordered(len(self.denoted(self.items, one)), order, len(self.denoted(self.items, other)), margin)
            case sem.BoxComparison(noun, one, order, other, towers):
                left, right = self.boxes[one], self.boxes[other]
                holds_order = _ordered(len(self.denoted(left, noun)), order, len(self.denoted(right, noun)))
                return holds_order and (bool(left and right) or not towers)
            case sem.EqualCounts(noun, same):
                return len({len(self.denoted(box, noun)) for box in self.boxes}) == (1 if same else len(self.boxes))
            case sem.Parity(noun, even):
                return (len(self.denoted(self.items, noun)) % 2 == 0) == even
            case sem.LargestBox(noun, conditions):
                counts = [len(self.denoted(box, noun)) for box in self.boxes]
                largest = [box for box, count in zip(self.boxes, counts, strict=True) if count == max(counts)]
                satisfied = any(self.box(box, conditions, towers=False) for box in largest)
                return satisfied and (len(largest) == 1 or self.interpretation.ties)
            case sem.Compound(conjunctive, clauses):
                values = [self.clause(part) for part in clauses]
                if conjunctive:
                    return all(values)
                return any(values) and not (self.interpretation.exclusive and sum(values) > 1)

    def admits(self, quantity: Quantity, count: int) -> bool:
        shift = self.interpretation.vague_shift if quantity.vague else 0
        return quantity.admits(count - shift)

    def denoted(self, items: Sequence[PlacedItem], noun: sem.NounPhrase) -> list[PlacedItem]:
        return [
            placed
            for placed in items
            if _matches(placed, noun.description)
            and all(self.satisfies(placed, predicate) for predicate in noun.predicates)
        ]

    def satisfies(self, placed: PlacedItem, predicate: sem.Predicate) -> bool:
        return self.satisfies_positively(placed, predicate) == predicate.positive

    def satisfies_positively(self, placed: PlacedItem, predicate: sem.Predicate) -> bool:
        match predicate:
            case sem.Matches(description):
                return _matches(placed, description)
            case sem.AtWall(wall, near):
                walls = self.walls_within_reach(placed, near)
                return bool(walls) if wall is None else wall in walls
            case sem.InCorner(near):
                return len(self.walls_within_reach(placed, near)) == 2
            case sem.InBox(index):
                return placed.box == index
            case sem.AtPosition(position):
                return self.at_position(placed, position)
            case sem.RelatedTo(relation, noun):
                return bool(self.denoted(self.related_items(placed, relation), noun))
            case sem.RelatedByAttribute(relation, attribute, same):
                value, others = _value(placed, attribute), self.related_items(placed, relation)
                return any((_value(other, attribute) == value) == same for other in others)

    def related_items(self, placed: PlacedItem, relation: sem.Relation) -> list[PlacedItem]:
        box = self.boxes[placed.box]
        return [other for other in box if other is not placed and self.related(placed, relation, other)]

    def walls_within_reach(self, placed: PlacedItem, near: bool) -> set[sem.Wall]:
        max_gap = self.interpretation.near_gap if near else self.interpretation.wall_gap
        gaps = {
            sem.Wall.LEFT: placed.left,
            sem.Wall.RIGHT: BOX_SIDE - placed.right,
            sem.Wall.TOP: BOX_SIDE - placed.top,
            sem.Wall.BOTTOM: placed.bottom,
        }
        return {wall for wall, gap in gaps.items() if gap <= max_gap}

    def at_position(self, placed: PlacedItem, position: sem.TowerPosition) -> bool:
        tops = [other.top for other in self.boxes[placed.box]]
        return {
            sem.TowerPosition.TOP: placed.top == max(tops),
            sem.TowerPosition.BOTTOM: placed.top == min(tops),
            sem.TowerPosition.SECOND: placed.bottom == SECOND_BOTTOM,
            sem.TowerPosition.THIRD: placed.bottom == THIRD_BOTTOM,
        }[position]

    def related(self, placed: PlacedItem, relation: sem.Relation, other: PlacedItem) -> bool:
        gap = max(
            placed.left - other.right, other.left - placed.right, placed.bottom - other.top, other.bottom - placed.top
        )
        above = placed.bottom + self.interpretation.overlap >= other.top and placed.top > other.top
        below = other.bottom + self.interpretation.overlap >= placed.top and other.top > placed.top
        return {
            sem.Relation.TOUCHING: gap <= self.interpretation.touch_gap,
            sem.Relation.NEAR: gap <= self.interpretation.near_gap,
            sem.Relation.ON: above and gap <= 1,
            sem.Relation.UNDER: below and gap <= 1,
            sem.Relation.ABOVE: above,
            sem.Relation.BELOW: below,
        }[relation]

    def box(self, box: Sequence[PlacedItem], conditions: sem.BoxConditions, towers: bool) -> bool:
        return all(self.condition(box, condition) for condition in conditions) and (bool(box) or not towers)

    def condition(self, items: Sequence[PlacedItem], condition: sem.BoxCondition) -> bool:
        """Whether the items of a box, or of the picture, satisfy the condition."""
        match condition:
            case sem.Count(quantity, noun):
                return self.admits(quantity, len(self.denoted(items, noun)))
            case sem.ContainsOnly(description):
                return bool(items) and all(_matches(placed, description) for placed in items)
            case sem.Variety(attribute, quantity):
                return self.admits(quantity, len(_values(items, attribute)))
            case sem.EndColour(position, colours):
                return any(self.at_position(placed, position) and placed.item.colour in colours for placed in items)
            case sem.MatchingEnds(same):
                positions = (sem.TowerPosition.TOP, sem.TowerPosition.BOTTOM)
                ends = [placed for placed in items if any(self.at_position(placed, end) for end in positions)]
                return len(items) > 1 and (len(_values(ends, sem.Attribute.COLOUR)) == 1) == same
            case sem.PartitiveCount(quantity, noun, partitive, predicate):
                denoted = self.denoted(items, noun)
                satisfying = sum(self.satisfies(placed, predicate) for placed in denoted)
                holds_for = {
                    sem.Partitive.ALL: satisfying == len(denoted),
                    sem.Partitive.NONE: satisfying == 0,
                    sem.Partitive.SOME: satisfying > 0,
                    sem.Partitive.ONE: satisfying == 1,
                }
                return self.admits(quantity, len(denoted)) and holds_for[partitive]


def _placed(item: Item, box: int) -> PlacedItem:
    top = BOX_SIDE - item.y
    return PlacedItem(item, box, item.x, item.x + item.side, top, top - item.side)


def _matches(placed: PlacedItem, description: sem.Description) -> bool:
    item = placed.item
    return (
        description.shape in (None, item.shape)
        and description.size in (None, item.size)
        and (not description.colours or item.colour in description.colours)
    )


def _values(items: Sequence[PlacedItem], attribute: sem.Attribute) -> set[int]:
    return {_value(placed, attribute) for placed in items}


def _value(placed: PlacedItem, attribute: sem.Attribute) -> int:
    return getattr(placed.item, attribute)


def _ordered(one: int, order: sem.Order, other: int, margin: int | None = None) -> bool:
    if order is sem.Order.EQUAL:
        return one == other
    excess = one - other if order is sem.Order.MORE else other - one
    return excess > 0 if margin is None else excess == margin
