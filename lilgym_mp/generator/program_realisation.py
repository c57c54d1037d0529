"""From a meaning to its program, in the words of the program language (docs/programs.md)."""

from __future__ import annotations

from lilgym_mp.generator.semantics import (
    ANYTHING,
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
)
from lilgym_mp.scene import Colour, Size

VARIABLES = "xyzuvw"  # one for each depth of nesting
ALL = "all_items"
_SIZES = {Size.SMALL: "is_small", Size.MEDIUM: "is_medium", Size.LARGE: "is_big"}
_LEVELS = {Level.TOP: "is_top", Level.BOTTOM: "is_bottom", Level.SECOND: "is_second", Level.THIRD: "is_third"}
_RELATED = {
    Relation.TOUCHING: "get_touching",
    Relation.NEAR: "get_closely_touching",
    Relation.ON: "get_below",
    Relation.UNDER: "get_above",
    Relation.ABOVE: "get_box_all_below",
    Relation.BELOW: "get_box_all_above",
}
_SETS = {Attribute.COLOUR: "get_set_colors", Attribute.SHAPE: "get_set_shapes", Attribute.SIZE: "get_set_sizes"}
_MEMBERS = {Attribute.COLOUR: "color", Attribute.SHAPE: "shape", Attribute.SIZE: "size"}
_ORDERS = {Order.MORE: ">", Order.FEWER: "<", Order.EQUAL: "=="}


def program_source(clause: Clause) -> str:
    """The program that is true where the clause holds."""
    match clause:
        case ItemCount(quantity, noun):
            return _numbered(quantity, _items(ALL, noun, 0))
        case SharedCount(quantity, noun, share, trait):
            return _shared(ALL, quantity, noun, share, trait, 0)
        case BoxCount(quantity, conditions, towers):
            return _numbered(quantity, f"filter_obj(all_boxes, lambda b: {_box('b', conditions, towers)})")
        case EveryTower(conditions):
            towers = "filter_obj(all_boxes, lambda b: b.is_tower())"
            return f"All({towers}, lambda b: {_box('b', conditions, towers=False)})"
        case BoxIs(index, conditions, towers):
            return _box(f"all_boxes[{index}]", conditions, towers)
        case Every(noun, trait):
            return f"All({_items(ALL, noun, 0)}, lambda x: {_trait(trait, 0)})"
        case NotEvery(noun, trait):
            return f"exist(filter_obj({_items(ALL, noun, 0)}, lambda x: NOT({_trait(trait, 0)})))"
        case Compared():
            return _compared(clause)
        case BoxesCompared(noun, one, order, other, towers):
            left, right = (_count(_items(f"all_boxes[{index}].all_items_in_box()", noun, 0)) for index in (one, other))
            test = f"{left} {_ORDERS[order]} {right}"
            return f"all_boxes[{one}].is_tower() and all_boxes[{other}].is_tower() and {test}" if towers else test
        case PictureVaried(attribute, quantity):
            return _numbered(quantity, f"{_SETS[attribute]}({ALL})")
        case Evenly(noun, same):
            counts = (_count(_items(f"p[{index}].all_items_in_box()", noun, 0)) for index in (0, 1))
            return f"All(combinations(all_boxes, 2), lambda p: {(' == ' if same else ' != ').join(counts)})"
        case Parity(noun, even):
            return f"{_count(_items(ALL, noun, 0))} % 2 == {0 if even else 1}"
        case Extreme(noun, conditions):
            mine, others = (_count(_items(f"{box}.all_items_in_box()", noun, 0)) for box in "bc")
            most = f"count(filter_obj(all_boxes, lambda c: {others} >= {mine})) == 1"
            return f"exist(filter_obj(all_boxes, lambda b: {most} and {_box('b', conditions, towers=False)}))"
        case Joined(every, clauses):
            return (" and " if every else " or ").join(f"({program_source(part)})" for part in clauses)


def _compared(clause: Compared) -> str:
    one, other = (_count(_items(ALL, noun, 0)) for noun in (clause.one, clause.other))
    if clause.margin is None:
        return f"{one} {_ORDERS[clause.order]} {other}"
    smaller, larger = (other, one) if clause.order is Order.MORE else (one, other)
    return f"{larger} == {smaller} + {clause.margin}"


def _numbered(quantity: Quantity, collection: str) -> str:
    low, high, _ = quantity
    if quantity.high == 0:
        return f"NOT(exist({collection}))"
    if (low, high) == (1, None):
        return f"exist({collection})"
    if low == high:
        return f"count({collection}) == {low}"
    if high is None:
        return f"ge(count({collection}), {low})"
    if low == 0:
        return f"le(count({collection}), {high})"
    return f"{low} <= count({collection}) <= {high}"


def _count(collection: str) -> str:
    return f"count({collection})"


def _items(source: str, noun: Noun, depth: int) -> str:
    """The items of `source` that the noun names."""
    if noun == ANYTHING:
        return source
    look, traits = noun.look, noun.traits
    if not traits and look == Look(colours=look.colours) and len(look.colours) == 1:
        return f"filter_color({source}, Color.{next(iter(look.colours)).name})"
    if not traits and look == Look(shape=look.shape) and look.shape is not None:
        return f"filter_shape({source}, Shape.{look.shape.name})"
    return f"filter_obj({source}, lambda {VARIABLES[depth]}: {_noun_test(noun, depth)})"


def _noun_test(noun: Noun, depth: int) -> str:
    tests = [*_look_tests(noun.look, VARIABLES[depth]), *(_trait(trait, depth) for trait in noun.traits)]
    return " and ".join(tests)


def _look_tests(look: Look, variable: str) -> list[str]:
    tests: list[str] = []
    if look.colours:
        colours = [f"{_colour_word(colour)}({variable})" for colour in sorted(look.colours)]
        tests.append(colours[0] if len(colours) == 1 else f"({' or '.join(colours)})")
    if look.size is not None:
        tests.append(f"{_SIZES[look.size]}({variable})")
    if look.shape is not None:
        tests.append(f"is_{look.shape.name.lower()}({variable})")
    return tests


def _colour_word(colour: Colour) -> str:
    return f"is_{colour.name.lower()}"


def _trait(trait: Trait, depth: int) -> str:
    test = _trait_test(trait, depth)
    return test if trait.holds else f"NOT({test})"


def _trait_test(trait: Trait, depth: int) -> str:
    variable = VARIABLES[depth]
    match trait:
        case HasLook(look):
            tests = _look_tests(look, variable)
            return tests[0] if len(tests) == 1 else f"({' and '.join(tests)})"
        case AtWall(wall, close):
            side = "" if wall is None else f", Side.{wall.name}"
            return f"is_{'closely_' if close else ''}touching_wall({variable}{side})"
        case InCorner(close):
            return f"is_{'closely_' if close else ''}touching_corner({variable})"
        case InBox(index):
            return f"{variable}.box == all_boxes[{index}]"
        case AtLevel(level):
            return f"{_LEVELS[level]}({variable})"
        case Beside(relation, noun):
            return f"exist({_items(f'{_RELATED[relation]}({variable})', noun, depth + 1)})"
        case BesideLike(relation, attribute, same):
            other, member = VARIABLES[depth + 1], _MEMBERS[attribute]
            test = f"{other}.{member} {'==' if same else '!='} {variable}.{member}"
            return f"exist(filter_obj({_RELATED[relation]}({variable}), lambda {other}: {test}))"


def _box(box: str, conditions: Conditions, towers: bool) -> str:
    tests = [_condition(box, condition) for condition in conditions]
    return " and ".join([f"{box}.is_tower()", *tests] if towers else tests)


def _condition(box: str, condition: Condition) -> str:
    items = f"{box}.all_items_in_box()"
    match condition:
        case Has(quantity, noun):
            return _numbered(quantity, _items(items, noun, 0))
        case Purely(look):
            return f"All({items}, lambda x: {_trait_test(HasLook(look), 0)})"
        case Varied(attribute, quantity):
            return _numbered(quantity, f"{_SETS[attribute]}({items})")
        case Ends(level, colours):
            return _numbered(Quantity(1, None), _items(items, Noun(Look(colours=colours), (AtLevel(level),)), 0))
        case SameEnds(same):
            ends = f"filter_obj({items}, lambda x: is_top(x) or is_bottom(x))"
            return f"ge(count({items}), 2) and {'' if same else 'not '}all_same_color({ends})"
        case Sharing(quantity, noun, share, trait):
            return _shared(items, quantity, noun, share, trait, 0)


def _shared(source: str, quantity: Quantity, noun: Noun, share: Share, trait: Trait, depth: int) -> str:
    number = _numbered(quantity, _items(source, noun, depth))
    having = _items(source, noun.also(trait), depth)
    match share:
        case Share.ALL:
            return f"{number} and All({_items(source, noun, depth)}, lambda x: {_trait(trait, depth)})"
        case Share.NONE:
            return f"{number} and NOT(exist({having}))"
        case Share.SOME:
            return f"{number} and exist({having})"
        case Share.ONE:
            return f"{number} and count({having}) == 1"
