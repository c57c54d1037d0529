"""Realises a meaning as a program (docs/programs.md)."""

from __future__ import annotations

from lilgym_mp.generator.meanings import semantics as sem
from lilgym_mp.generator.program_text import ALL_ITEMS, BOX, TOWERS, boxes_where, items_in_box, quantity_test
from lilgym_mp.generator.quantities import SOME
from lilgym_mp.scene import Size

VARIABLES = "xyzuvw"  # names of lambda parameters, by nesting depth
_SIZE_TESTS = {Size.SMALL: "is_small", Size.MEDIUM: "is_medium", Size.LARGE: "is_big"}
_RELATED_ITEMS = {
    sem.Relation.TOUCHING: "get_touching",
    sem.Relation.NEAR: "get_closely_touching",
    sem.Relation.ON: "get_below",
    sem.Relation.UNDER: "get_above",
    sem.Relation.ABOVE: "get_box_all_below",
    sem.Relation.BELOW: "get_box_all_above",
}
_VALUES = {sem.Attribute.COLOUR: "color", sem.Attribute.SHAPE: "shape", sem.Attribute.SIZE: "size"}
_OPERATORS = {sem.Order.MORE: ">", sem.Order.FEWER: "<", sem.Order.EQUAL: "=="}


def program_source(clause: sem.Clause) -> str:
    """The program that is true where the clause holds."""
    match clause:
        case sem.Count() | sem.PartitiveCount() | sem.Variety():
            return _condition(ALL_ITEMS, clause)
        case sem.BoxCount(quantity, conditions, towers):
            return quantity_test(quantity, boxes_where(_box(BOX, conditions, towers)))
        case sem.EveryTower(conditions):
            return f"All({TOWERS}, lambda {BOX}: {_box(BOX, conditions, towers=False)})"
        case sem.NamedBox(index, conditions, towers):
            return _box(f"all_boxes[{index}]", conditions, towers)
        case sem.EveryItem(noun, predicate, True):
            return f"All({_items(ALL_ITEMS, noun, 0)}, lambda x: {_predicate_test(predicate, 0)})"
        case sem.EveryItem(noun, predicate):
            return f"exist(filter_obj({_items(ALL_ITEMS, noun, 0)}, lambda x: NOT({_predicate_test(predicate, 0)})))"
        case sem.CountComparison():
            return _count_comparison(clause)
        case sem.BoxComparison(noun, one, order, other, towers):
            left, right = (_count(_items(items_in_box(f"all_boxes[{index}]"), noun, 0)) for index in (one, other))
            test = f"{left} {_OPERATORS[order]} {right}"
            return f"all_boxes[{one}].is_tower() and all_boxes[{other}].is_tower() and {test}" if towers else test
        case sem.EqualCounts(noun, same):
            counts = (_count(_items(items_in_box(f"p[{index}]"), noun, 0)) for index in (0, 1))
            return f"All(combinations(all_boxes, 2), lambda p: {(' == ' if same else ' != ').join(counts)})"
        case sem.Parity(noun, even):
            return f"{_count(_items(ALL_ITEMS, noun, 0))} % 2 == {0 if even else 1}"
        case sem.LargestBox(noun, conditions):
            count, other_count = (_count(_items(items_in_box(box), noun, 0)) for box in (BOX, "c"))
            is_largest = f"count(filter_obj(all_boxes, lambda c: {other_count} >= {count})) == 1"
            return f"exist({boxes_where(f'{is_largest} and {_box(BOX, conditions, towers=False)}')})"
        case sem.Compound(conjunctive, clauses):
            return (" and " if conjunctive else " or ").join(f"({program_source(part)})" for part in clauses)


def _count_comparison(clause: sem.CountComparison) -> str:
    one, other = (_count(_items(ALL_ITEMS, noun, 0)) for noun in (clause.one, clause.other))
    if clause.margin is None:
        return f"{one} {_OPERATORS[clause.order]} {other}"
    smaller, larger = (other, one) if clause.order is sem.Order.MORE else (one, other)
    return f"{larger} == {smaller} + {clause.margin}"


def _count(collection: str) -> str:
    return f"count({collection})"


def _items(source: str, noun: sem.NounPhrase, depth: int) -> str:
    """The items of `source` that the noun phrase denotes."""
    if noun == sem.ANYTHING:
        return source
    description, predicates = noun.description, noun.predicates
    if not predicates and description == sem.Description(colours=description.colours) and len(description.colours) == 1:
        return f"filter_color({source}, Color.{next(iter(description.colours)).name})"
    if not predicates and description == sem.Description(shape=description.shape) and description.shape is not None:
        return f"filter_shape({source}, Shape.{description.shape.name})"
    return f"filter_obj({source}, lambda {VARIABLES[depth]}: {_noun_test(noun, depth)})"


def _noun_test(noun: sem.NounPhrase, depth: int) -> str:
    tests = [
        *_description_tests(noun.description, VARIABLES[depth]),
        *(_predicate_test(predicate, depth) for predicate in noun.predicates),
    ]
    return " and ".join(tests)


def _description_tests(description: sem.Description, variable: str) -> list[str]:
    tests: list[str] = []
    if description.colours:
        colours = [f"is_{colour.name.lower()}({variable})" for colour in sorted(description.colours)]
        tests.append(colours[0] if len(colours) == 1 else f"({' or '.join(colours)})")
    if description.size is not None:
        tests.append(f"{_SIZE_TESTS[description.size]}({variable})")
    if description.shape is not None:
        tests.append(f"is_{description.shape.name.lower()}({variable})")
    return tests


def _predicate_test(predicate: sem.Predicate, depth: int) -> str:
    test = _positive_test(predicate, depth)
    return test if predicate.positive else f"NOT({test})"


def _positive_test(predicate: sem.Predicate, depth: int) -> str:
    variable = VARIABLES[depth]
    match predicate:
        case sem.Matches(description):
            tests = _description_tests(description, variable)
            return tests[0] if len(tests) == 1 else f"({' and '.join(tests)})"
        case sem.AtWall(wall, near):
            side = "" if wall is None else f", Side.{wall.name}"
            return f"is_{'closely_' if near else ''}touching_wall({variable}{side})"
        case sem.InCorner(near):
            return f"is_{'closely_' if near else ''}touching_corner({variable})"
        case sem.InBox(index):
            return f"{variable}.box == all_boxes[{index}]"
        case sem.AtPosition(position):
            return f"is_{position}({variable})"
        case sem.RelatedTo(relation, noun):
            return f"exist({_items(f'{_RELATED_ITEMS[relation]}({variable})', noun, depth + 1)})"
        case sem.RelatedByAttribute(relation, attribute, same):
            other, member = VARIABLES[depth + 1], _VALUES[attribute]
            test = f"{other}.{member} {'==' if same else '!='} {variable}.{member}"
            return f"exist(filter_obj({_RELATED_ITEMS[relation]}({variable}), lambda {other}: {test}))"


def _box(box: str, conditions: sem.BoxConditions, towers: bool) -> str:
    tests = [_condition(items_in_box(box), condition) for condition in conditions]
    return " and ".join([f"{box}.is_tower()", *tests] if towers else tests)


def _condition(items: str, condition: sem.BoxCondition) -> str:
    """Tests a condition of the items of a box or of the picture."""
    match condition:
        case sem.Count(quantity, noun):
            return quantity_test(quantity, _items(items, noun, 0))
        case sem.ContainsOnly(description):
            return f"All({items}, lambda x: {_positive_test(sem.Matches(description), 0)})"
        case sem.Variety(attribute, quantity):
            return quantity_test(quantity, f"get_set_{_VALUES[attribute]}s({items})")
        case sem.EndColour(position, colours):
            ends = sem.NounPhrase(sem.Description(colours=colours), (sem.AtPosition(position),))
            return quantity_test(SOME, _items(items, ends, 0))
        case sem.MatchingEnds(same):
            ends = f"filter_obj({items}, lambda x: is_top(x) or is_bottom(x))"
            return f"ge(count({items}), 2) and {'' if same else 'not '}all_same_color({ends})"
        case sem.PartitiveCount(quantity, noun, partitive, predicate):
            counted, satisfying = _items(items, noun, 0), _items(items, noun.such_that(predicate), 0)
            test = {
                sem.Partitive.ALL: f"All({counted}, lambda x: {_predicate_test(predicate, 0)})",
                sem.Partitive.NONE: f"NOT(exist({satisfying}))",
                sem.Partitive.SOME: f"exist({satisfying})",
                sem.Partitive.ONE: f"count({satisfying}) == 1",
            }[partitive]
            return f"{quantity_test(quantity, counted)} and {test}"
