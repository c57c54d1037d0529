"""From a statement back to what it can mean, by a grammar of English phrases written for this corpus.

The grammar knows nothing of how `wording` makes statements. A statement that it cannot read, or can read in two ways
that differ somewhere, is not used.
"""
# The values of the grammar's symbols are of many types, so the rules' lambdas cannot be typed one by one.
# pyright: reportUnknownLambdaType=false, reportUnknownArgumentType=false, reportUnknownVariableType=false

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

from lilgym_mp.generator.chart_parser import Grammar
from lilgym_mp.generator.semantics import (
    ANYTHING,
    NONE,
    SOME,
    AtPosition,
    Attribute,
    AtWall,
    BoxComparison,
    BoxCondition,
    BoxCount,
    BoxVariety,
    Clause,
    Compound,
    Contains,
    ContainsOnly,
    ContainsPartitive,
    CountComparison,
    Description,
    EndColour,
    EqualCounts,
    EveryItem,
    EveryTower,
    InBox,
    InCorner,
    ItemCount,
    LargestBox,
    Matches,
    MatchingEnds,
    NamedBox,
    NotEveryItem,
    NounPhrase,
    Order,
    Parity,
    Partitive,
    PartitiveCount,
    Predicate,
    Quantity,
    RelatedByAttribute,
    RelatedTo,
    Relation,
    SceneVariety,
    TowerPosition,
    Wall,
    at_least,
    at_most,
    exactly,
)
from lilgym_mp.scene import Colour, Shape, Size

EXPANSIONS = (
    ("there's", "there is"),
    ("isn't", "is not"),
    ("aren't", "are not"),
    ("doesn't", "does not"),
    ("don't", "do not"),
    ("-block", " -block"),
    (",", " , "),
)
_NUMBERS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
LEXICON: Mapping[str, Mapping[str, object]] = {
    "NUM": {word: number for number, word in enumerate(_NUMBERS)} | {str(number): number for number in range(21)},
    "COLOUR": {"yellow": Colour.YELLOW, "black": Colour.BLACK, "blue": Colour.BLUE},
    "SHAPE": {
        f"{name}{s}": shape
        for name, shape in zip(("circle", "square", "triangle"), Shape, strict=True)
        for s in ("", "s")
    },
    "ITEM": {f"{name}{s}": None for name in ("item", "object", "thing", "shape", "block") for s in ("", "s")},
    "SIZE": {
        **dict.fromkeys(("small", "tiny", "little"), Size.SMALL),
        **dict.fromkeys(("medium", "medium-sized"), Size.MEDIUM),
        **dict.fromkeys(("big", "large"), Size.LARGE),
    },
    "ATTRIBUTE": {
        f"{attribute.replace('colour', 'color')}{s}": attribute for attribute in Attribute for s in ("", "s")
    },
    "NAME": {"left": 0, "middle": 1, "right": 2},
    "ORDER": {"more": Order.MORE, "fewer": Order.FEWER},
    "HEIGHT": {
        **dict.fromkeys(("taller", "higher"), Order.MORE),
        **dict.fromkeys(("shorter", "lower"), Order.FEWER),
    },
    "BOX": {"box": False, "boxes": False, **dict.fromkeys(("tower", "towers", "stack", "stacks"), True)},
    "SIDE": {
        "left": Wall.LEFT,
        "right": Wall.RIGHT,
        **dict.fromkeys(("top", "upper"), Wall.TOP),
        **dict.fromkeys(("bottom", "lower"), Wall.BOTTOM),
    },
    "END": {"top": TowerPosition.TOP, **dict.fromkeys(("bottom", "base"), TowerPosition.BOTTOM)},
    "MIDLEVEL": {"second": TowerPosition.SECOND, "third": TowerPosition.THIRD},
    "EVEN": {"even": True, "odd": False},
}


def parse_statement(statement: str) -> list[Clause]:
    """Everything that the statement can mean; empty where the grammar cannot read it."""
    return _grammar().readings("STATEMENT", _tokens(statement))


def _tokens(statement: str) -> list[str]:
    text = re.sub(r"[.!]+$", "", statement.strip().lower())
    for short, long in EXPANSIONS:
        text = text.replace(short, long)
    return text.split()


@cache
def _grammar() -> Grammar:
    grammar = Grammar(LEXICON)
    for add_rules in (_quantities, _nouns, _walls, _traits, _conditions, _items, _all_items, _boxes, _joined):
        add_rules(grammar.add)
    return grammar


Add = Callable[[str, str, Callable[..., Any]], None]
Counted = tuple[Quantity, NounPhrase]  # what a QN stands for


def _quantities(add: Add) -> None:
    add("SOME", "a|an", lambda: SOME)
    add("Q", "SOME", lambda q: q)
    add("Q", "no", lambda: NONE)
    add("Q", "RANGE", lambda q: q)
    for words, least in (("several", 3), ("quite a few", 3), ("many", 4), ("a lot of", 4), ("lots of", 4)):
        add("Q", words, lambda least=least: Quantity(least, None, vague=True))
    add("RANGE", "exactly|only|just|precisely? NUM", lambda n: exactly(n))
    add("RANGE", "a single", lambda: exactly(1))
    add("RANGE", "a pair of", lambda: exactly(2))
    add("RANGE", "at least NUM", lambda n: at_least(n))
    add("RANGE", "no fewer than NUM", lambda n: at_least(n))
    add("RANGE", "NUM or more", lambda n: at_least(n))
    add("RANGE", "more|greater than NUM", lambda n: at_least(n + 1))
    add("RANGE", "multiple", lambda: at_least(2))
    add("RANGE", "at most NUM", lambda n: at_most(n))
    add("RANGE", "no|not more than NUM", lambda n: at_most(n))
    add("RANGE", "fewer than NUM", lambda n: at_most(n - 1))
    add("RANGE", "NUM or NUM", lambda low, high: Quantity(low, high))
    add("RANGE", "between NUM and NUM", lambda low, high: Quantity(low, high))
    add("RANGE", "at least NUM but no more than NUM", lambda low, high: Quantity(low, high))


def _nouns(add: Add) -> None:
    add("COLOURS", "COLOUR", lambda colour: frozenset({colour}))
    add("COLOURS", "COLOUR or COLOUR", lambda one, other: frozenset({one, other}))
    add("HEAD", "SHAPE", lambda shape: shape)
    add("HEAD", "ITEM", lambda item: item)
    add("LOOK", "SIZE? COLOURS? HEAD", lambda size, colours, head: Description(head, colours or frozenset(), size))
    add("NOUN", "LOOK MODIFIERS?", lambda description, predicates: NounPhrase(description, predicates or ()))
    add("MODIFIERS", "MODIFIER MODIFIERS?", lambda predicate, more: (predicate, *(more or ())))
    add("MODIFIER", "that PREDICATE", lambda predicate: predicate)
    add("MODIFIER", "LYING", lambda predicate: predicate)
    add("MODIFIER", "not LYING", _denied)
    add("QN", "Q NOUN", lambda quantity, noun: (quantity, noun))
    add("ANOUN", "a|an|any|another NOUN", lambda noun: noun)
    add("ONES", "COLOURS ones", lambda colours: colours)


def _walls(add: Add) -> None:
    add("WALL", "a|an|any wall|edge|side", lambda: None)
    add("WALL", "the SIDE wall|edge|side", lambda wall: wall)
    add("WALL", "the wall|edge|side on the SIDE", lambda wall: wall)
    add("WALL", "the floor", lambda: Wall.BOTTOM)
    add("LYING", "touching|against WALL", AtWall)
    add("LYING", "touching or almost touching WALL", lambda wall: AtWall(wall, near=True))
    add("LYING", "very close to WALL or touching it", lambda wall: AtWall(wall, near=True))
    add("PREDICATE", "touches|touch WALL", AtWall)
    add("PREDICATE", "does|do not touch WALL", lambda wall: AtWall(wall, positive=False))
    add("PREDICATE", "touches|touch or almost touches|touch WALL", lambda wall: AtWall(wall, near=True))
    add("LYING", "sitting? in a corner", InCorner)
    add("LYING", "in a corner of a box", InCorner)
    add("LYING", "sitting? in corners", InCorner)
    add("LYING", "tucked into a corner", InCorner)


def _traits(add: Add) -> None:
    add("LYING", "in|inside the NAME box", InBox)
    add("LYING", "outside the NAME box", lambda index: InBox(index, positive=False))
    add("LYING", "at the very? END of a|their tower|stack|towers|stacks", AtPosition)
    add("LYING", "in MIDLEVEL position from the bottom", AtPosition)
    add("LYING", "MIDLEVEL from the bottom", AtPosition)
    for words, relation in (
        ("touching", Relation.TOUCHING),
        ("in contact with", Relation.TOUCHING),
        ("touching or almost touching", Relation.NEAR),
        ("directly on top of", Relation.ON),
        ("right on top of", Relation.ON),
        ("directly on|above", Relation.ON),
        ("directly|right under|below", Relation.UNDER),
    ):
        add("LYING", f"{words} ANOUN", lambda noun, relation=relation: RelatedTo(relation, noun))
        add("LYING", f"{words} LIKE", lambda like, relation=relation: RelatedByAttribute(relation, *like))
    for words, relation in (
        ("somewhere? above", Relation.ABOVE),
        ("higher up than", Relation.ABOVE),
        ("somewhere? below", Relation.BELOW),
        ("lower down than", Relation.BELOW),
    ):
        place = "in the same tower|stack|box"
        add("LYING", f"{words} ANOUN {place}", lambda noun, relation=relation: RelatedTo(relation, noun))
        add("LYING", f"{words} LIKE {place}", lambda like, relation=relation: RelatedByAttribute(relation, *like))
    add("LIKE", "a|an|another ITEM of the same ATTRIBUTE", lambda _, attribute: (attribute, True))
    add("LIKE", "a|an ITEM of a different ATTRIBUTE", lambda _, attribute: (attribute, False))
    add("LIKE", "a|an ITEM of another ATTRIBUTE", lambda _, attribute: (attribute, False))
    add("PREDICATE", "touches|touch ANOUN", lambda noun: RelatedTo(Relation.TOUCHING, noun))
    add("PREDICATE", "is|are|sits|sit|lies|lie|stands|stand|rests|rest LYING", lambda predicate: predicate)
    add("PREDICATE", "is|are not LYING", _denied)
    add("PREDICATE", "is|are BEING", Matches)
    add("PREDICATE", "is|are not BEING", lambda description: Matches(description, positive=False))
    add("BEING", "either? COLOURS", lambda colours: Description(colours=colours))
    add("BEING", "SIZE", lambda size: Description(size=size))
    add("BEING", "SIZE and COLOURS", lambda size, colours: Description(size=size, colours=colours))
    add(
        "BEING",
        "a|an? SIZE? COLOURS? SHAPE",
        lambda size, colours, shape: Description(shape, colours or frozenset(), size),
    )


def _denied(predicate: Predicate) -> Predicate:
    match predicate:
        case Matches(description):
            return Matches(description, positive=False)
        case AtWall(wall, near):
            return AtWall(wall, near, positive=False)
        case InCorner(near):
            return InCorner(near, positive=False)
        case InBox(index):
            return InBox(index, positive=False)
        case AtPosition(position):
            return AtPosition(position, positive=False)
        case RelatedTo(relation, noun):
            return RelatedTo(relation, noun, positive=False)
        case RelatedByAttribute(relation, attribute, same):
            return RelatedByAttribute(relation, attribute, same, positive=False)


def _conditions(add: Add) -> None:
    """HAVING is a verb phrase of boxes, THINGS what follows "has", THING one part of it: conditions all."""
    add("VARIETY", "a single ATTRIBUTE", lambda attribute: (attribute, exactly(1)))
    add("VARIETY", "all three ATTRIBUTE", lambda attribute: (attribute, exactly(3)))
    add("VARIETY", "RANGE different? ATTRIBUTE", lambda quantity, attribute: (attribute, quantity))
    add("THING", "QN", lambda counted: (Contains(*counted),))
    add("THING", "only LOOK", lambda description: (ContainsOnly(description),))
    add("THING", "nothing but NOUN", lambda noun: (ContainsOnly(_description_of(noun)),))
    add("THING", "only NOUN", lambda noun: (ContainsOnly(_description_of(noun)),))
    add("THING", "ITEM of VARIETY", lambda _, variety: (BoxVariety(*variety),))
    add("THING", "QN of VARIETY", lambda counted, variety: (Contains(*counted), BoxVariety(*variety)))
    add(
        "THING",
        "QN , both|all of them BEING",
        lambda counted, description: (Contains(*counted), ContainsOnly(description)),
    )
    add("THING", "QN , SHARE which PREDICATE", _sharing)
    add("THING", "QN , which PREDICATE", lambda counted, predicate: _sharing(counted, Partitive.ALL, predicate))
    add("THING", "a|an COLOURS END", lambda colours, end: (EndColour(end, colours),))
    add("THING", "a|an COLOURS block at the END", lambda colours, end: (EndColour(end, colours),))
    add("THING", "a|an COLOURS block on END", lambda colours, end: (EndColour(end, colours),))
    add("THING", "a top|base and a top|base of the same color", lambda: (MatchingEnds(same=True),))
    add("THING", "a top|base and a top|base of different colors", lambda: (MatchingEnds(same=False),))
    add("SHARE", "both|all of", lambda: Partitive.ALL)
    add("SHARE", "none|neither of", lambda: Partitive.NONE)
    add("SHARE", "at least one of", lambda: Partitive.SOME)
    add("SHARE", "exactly|only|just one of", lambda: Partitive.ONE)
    add("THINGS", "THING", lambda thing: thing)
    add("THINGS", "THING and|but THING", lambda one, other: (*one, *other))
    add("THINGS", "THING , THING and|but THING", lambda one, two, three: (*one, *two, *three))
    add("THINGS", "THING and THING but THING", lambda one, two, three: (*one, *two, *three))
    add("HAVING", "is|are empty", lambda: (Contains(NONE, ANYTHING),))
    add("HAVING", "has|have|contains|contain|holds|hold THINGS", lambda things: things)
    add("TALL", "NUM block|blocks tall|high", _height)
    add("ENDIS", "END block? is COLOURS", lambda end, colours: (EndColour(end, colours),))
    add("WITH", "with THINGS", lambda things: things)
    add("WITH", "that HAVING", lambda things: things)
    add("WITH", "of height NUM", _height)
    add("WITH", "that is|are TALL", lambda things: things)
    add("WITH", "whose ENDIS", lambda things: things)
    add("WITH", "whose ENDIS and whose ENDIS", lambda one, other: (*one, *other))


def _sharing(counted: Counted, partitive: Partitive, predicate: Predicate) -> tuple[BoxCondition, ...]:
    return (ContainsPartitive(*counted, partitive, predicate),)


def _height(number: int) -> tuple[BoxCondition, ...]:
    return (Contains(exactly(number), ANYTHING),)


def _description_of(noun: NounPhrase) -> Description:
    """A noun without predicates, or with the one of not having a colour, as a description."""
    match noun:
        case NounPhrase(description, ()):
            return description
        case NounPhrase(description, (Matches(Description(None, colours, None), False),)) if not description.colours:
            return Description(description.shape, frozenset(Colour) - colours, description.size)
        case _:
            return Description(colours=frozenset(Colour))


def _items(add: Add) -> None:
    """Clauses that count items of the picture."""
    for words in ("somewhere? there is|are", "the PICTURE has|shows|contains", "we see", "you|i can see"):
        add("THERE", words, lambda *_: None)
    add("THERE", "in the PICTURE , there is|are", lambda *_: None)
    add("PICTURE", "picture|image", lambda: None)
    add("PLACE", "in total", lambda: None)
    add("PLACE", "altogether|overall", lambda: None)
    add("PLACE", "in the PICTURE", lambda _: None)
    add("CLAUSE", "THERE QN PLACE?", lambda _, counted, place: ItemCount(*counted))
    add("CLAUSE", "QN is|are present", lambda counted: ItemCount(*counted))
    add("CLAUSE", "QN is|are in the PICTURE", lambda counted, _: ItemCount(*counted))
    add("CLAUSE", "QN can be seen", lambda counted: ItemCount(*counted))
    add("CLAUSE", "QN is in|inside one of the boxes", lambda counted: ItemCount(*counted))
    add("CLAUSE", "the three? boxes hold QN in total", lambda counted: ItemCount(*counted))
    add("CLAUSE", "there is|are not any NOUN", lambda noun: ItemCount(NONE, noun))
    add("CLAUSE", "the PICTURE does not show|have|contain any NOUN", lambda _, noun: ItemCount(NONE, noun))
    add("CLAUSE", "the number of NOUN is RANGE", lambda noun, quantity: ItemCount(quantity, noun))
    add("CLAUSE", "QN PREDICATE", _counted)
    add("CLAUSE", "none of the NOUN PREDICATE", lambda noun, predicate: _count(NONE, noun, predicate))
    add("CLAUSE", "not a single NOUN PREDICATE", lambda noun, predicate: _count(NONE, noun, predicate))
    add(
        "CLAUSE",
        "THERE QN ,? and SHARE them PREDICATE",
        lambda _, counted, partitive, predicate: _shared_count(counted, partitive, predicate),
    )
    add(
        "CLAUSE",
        "THERE QN ,? and it PREDICATE",
        lambda _, counted, predicate: _shared_count(counted, Partitive.ALL, predicate),
    )
    add("CLAUSE", "the only NOUN PREDICATE", _only_one)
    add("CLAUSE", "the one and only NOUN PREDICATE", _only_one)
    add("CLAUSE", "the number of NOUN is EVEN", Parity)
    add("CLAUSE", "THERE a|an EVEN number of NOUN", lambda _, even, noun: Parity(noun, even))


def _counted(counted: Counted, predicate: Predicate) -> Clause:
    return _count(*counted, predicate)


def _count(quantity: Quantity, noun: NounPhrase, predicate: Predicate) -> Clause:
    return ItemCount(quantity, noun.such_that(predicate))


def _shared_count(counted: Counted, partitive: Partitive, predicate: Predicate) -> Clause:
    return PartitiveCount(*counted, partitive, predicate)


def _only_one(noun: NounPhrase, predicate: Predicate) -> Clause:
    return PartitiveCount(exactly(1), noun, Partitive.ALL, predicate)


def _all_items(add: Add) -> None:
    """Clauses about all items of a kind, and about two kinds."""
    add("CLAUSE", "every|each NOUN PREDICATE", EveryItem)
    add("CLAUSE", "all of the NOUN PREDICATE", EveryItem)
    add("CLAUSE", "all the? NOUN PREDICATE", EveryItem)
    add("CLAUSE", "everything in the PICTURE PREDICATE", lambda _, predicate: EveryItem(ANYTHING, predicate))
    add(
        "CLAUSE",
        "everything that PREDICATE PREDICATE",
        lambda one, other: EveryItem(NounPhrase(Description(), (one,)), other),
    )
    add(
        "CLAUSE",
        "only NOUN PREDICATE",
        lambda noun, predicate: EveryItem(NounPhrase(Description(), (predicate,)), _being(noun)),
    )
    add("CLAUSE", "only NOUN can be seen", lambda noun: EveryItem(ANYTHING, _being(noun)))
    add("CLAUSE", "nothing but NOUN can be seen", lambda noun: EveryItem(ANYTHING, _being(noun)))
    add("CLAUSE", "there are only NOUN", lambda noun: EveryItem(ANYTHING, _being(noun)))
    add("CLAUSE", "the PICTURE has|contains nothing but NOUN", lambda _, noun: EveryItem(ANYTHING, _being(noun)))
    add("CLAUSE", "not every NOUN PREDICATE", NotEveryItem)
    add("CLAUSE", "not all NOUN PREDICATE", NotEveryItem)
    add("CLAUSE", "not all of the NOUN PREDICATE", NotEveryItem)
    add("CLAUSE", "THERE ORDER NOUN than OTHER", lambda _, order, one, other: _compared(one, order, other))
    add(
        "CLAUSE",
        "THERE ORDER NOUN than there are NOUN",
        lambda _, order, one, other: CountComparison(one, order, other),
    )
    add(
        "CLAUSE",
        "THERE exactly NUM ORDER NOUN than OTHER",
        lambda _, margin, order, one, other: _compared(one, order, other, margin),
    )
    add("CLAUSE", "the NOUN outnumber the OTHER", lambda one, other: _compared(one, Order.MORE, other))
    add("CLAUSE", "there are as many NOUN as OTHER", lambda one, other: _compared(one, Order.EQUAL, other))
    add("CLAUSE", "there are equally many NOUN and NOUN", lambda one, other: CountComparison(one, Order.EQUAL, other))
    add(
        "CLAUSE",
        "the number of NOUN equals the number of NOUN",
        lambda one, other: CountComparison(one, Order.EQUAL, other),
    )
    add("OTHER", "NOUN", lambda noun: noun)
    add("OTHER", "ONES", lambda colours: colours)
    add("CLAUSE", "all of? the? ITEM have the same ATTRIBUTE", _one_value)
    add("CLAUSE", "every ITEM has the same ATTRIBUTE", _one_value)
    add("CLAUSE", "there is only one ATTRIBUTE in the PICTURE", lambda attribute, _: _one_value(None, attribute))
    add(
        "CLAUSE",
        "all three ATTRIBUTE SHOWN in the PICTURE",
        lambda attribute, *_: SceneVariety(attribute, exactly(3)),
    )
    add("SHOWN", "appear|occur", lambda: None)
    add("SHOWN", "can be seen", lambda: None)
    add("CLAUSE", "THERE ITEM of VARIETY", lambda there, item, variety: SceneVariety(*variety))


def _one_value(_: object, attribute: Attribute) -> Clause:
    return SceneVariety(attribute, exactly(1))


def _being(noun: NounPhrase) -> Matches:
    return Matches(_description_of(noun))


def _compared(
    one: NounPhrase, order: Order, other: NounPhrase | frozenset[Colour], margin: int | None = None
) -> Clause:
    """`other` may be colours alone: "black ones", of the shape last named."""
    if not isinstance(other, NounPhrase):
        other = NounPhrase(Description(one.description.shape, other))
    return CountComparison(one, order, other, margin)


def _boxes(add: Add) -> None:
    """Clauses about boxes and towers."""
    add(
        "QB",
        "Q NUM -block BOX WITH?",
        lambda q, number, towers, more: BoxCount(q, (*_height(number), *(more or ())), towers),
    )
    add(
        "QB",
        "Q COLOURS BOX WITH?",
        lambda q, colours, towers, more: BoxCount(
            q, (ContainsOnly(Description(colours=colours)), *(more or ())), towers
        ),
    )
    add("QB", "Q BOX WITH", lambda quantity, towers, conditions: BoxCount(quantity, conditions, towers))
    add("CLAUSE", "THERE QB", lambda _, boxes: boxes)
    add("CLAUSE", "Q BOX HAVING", lambda quantity, towers, conditions: BoxCount(quantity, conditions, towers))
    add(
        "CLAUSE", "RANGE of the BOX HAVING", lambda quantity, towers, conditions: BoxCount(quantity, conditions, towers)
    )
    add("CLAUSE", "none of the BOX HAVING", lambda towers, conditions: BoxCount(NONE, conditions, towers))
    add(
        "CLAUSE",
        "in|inside some BOX there is|are QN",
        lambda towers, counted: BoxCount(SOME, (Contains(*counted),), towers),
    )
    add("CLAUSE", "every|each BOX HAVING", _each)
    add("CLAUSE", "all of? the? three? BOX HAVING", _each)
    add("CLAUSE", "the NAME BOX HAVING", lambda index, towers, conditions: NamedBox(index, conditions, towers))
    add("CLAUSE", "in|inside the NAME BOX there is|are QN", _in_box)
    add("CLAUSE", "there is|are QN in the NAME BOX", lambda counted, index, towers: _in_box(index, towers, counted))
    add("CLAUSE", "the NAME BOX is TALL", lambda index, towers, conditions: NamedBox(index, conditions, towers))
    add(
        "CLAUSE",
        "the END of the NAME BOX is COLOURS",
        lambda end, index, towers, colours: NamedBox(index, (EndColour(end, colours),), towers),
    )
    add("CLAUSE", "the tallest|highest tower|stack HAVING", lambda conditions: LargestBox(ANYTHING, conditions))
    add(
        "CLAUSE",
        "the END of the tallest|highest tower|stack is COLOURS",
        lambda end, colours: LargestBox(ANYTHING, (EndColour(end, colours),)),
    )
    add("CLAUSE", "the box with the most NOUN HAVING", LargestBox)
    add("CLAUSE", "all the? three? boxes have the same number of NOUN", lambda noun: EqualCounts(noun, same=True))
    add("CLAUSE", "each box has the same number of NOUN", lambda noun: EqualCounts(noun, same=True))
    add("CLAUSE", "there are equally many NOUN in each box", lambda noun: EqualCounts(noun, same=True))
    add("CLAUSE", "no two boxes have the same number of NOUN", lambda noun: EqualCounts(noun, same=False))
    add("CLAUSE", "each box has a different number of NOUN", lambda noun: EqualCounts(noun, same=False))
    _boxes_compared(add)


def _each(towers: bool, conditions: tuple[BoxCondition, ...]) -> Clause:
    return EveryTower(conditions) if towers else BoxCount(exactly(3), conditions)


def _in_box(index: int, towers: bool, counted: Counted) -> Clause:
    return NamedBox(index, (Contains(*counted),), towers)


def _boxes_compared(add: Add) -> None:
    def taller(one: int, _: bool, order: Order, other: int) -> Clause:
        return BoxComparison(ANYTHING, one, order, other, towers=True)

    add("CLAUSE", "the NAME BOX is HEIGHT than the NAME one|tower|stack", taller)
    add(
        "CLAUSE",
        "the NAME BOX is as tall|high as the NAME one|tower|stack",
        lambda one, _, other: taller(one, True, Order.EQUAL, other),
    )
    add(
        "CLAUSE",
        "the NAME BOX and the NAME BOX have the same height",
        lambda one, _, other, __: taller(one, True, Order.EQUAL, other),
    )
    add(
        "CLAUSE",
        "the NAME box has as many NOUN as the NAME one|box",
        lambda one, noun, other: BoxComparison(noun, one, Order.EQUAL, other),
    )
    add(
        "CLAUSE",
        "the NAME box and the NAME box have the same number of NOUN",
        lambda one, other, noun: BoxComparison(noun, one, Order.EQUAL, other),
    )
    add(
        "CLAUSE",
        "the NAME box has ORDER NOUN than the NAME one|box",
        lambda one, order, noun, other: BoxComparison(noun, one, order, other),
    )
    add(
        "CLAUSE",
        "there are ORDER NOUN in the NAME box than in the NAME one|box",
        lambda order, noun, one, other: BoxComparison(noun, one, order, other),
    )


def _joined(add: Add) -> None:
    add("STATEMENT", "CLAUSE", lambda clause: clause)
    add("STATEMENT", "CLAUSE ,? and|while|but CLAUSE", lambda one, other: Compound(True, (one, other)))
    add("STATEMENT", "either CLAUSE or CLAUSE", lambda one, other: Compound(False, (one, other)))
    add("STATEMENT", "CLAUSE , or CLAUSE", lambda one, other: Compound(False, (one, other)))
    add("CLAUSE", "THERE both? QN and|but QN", lambda _, one, other: _both_counts(True, one, other))
    add("CLAUSE", "THERE either? QN or QN", lambda _, one, other: _both_counts(False, one, other))
    add("CLAUSE", "there are neither NOUN nor NOUN", lambda one, other: _both_counts(True, (NONE, one), (NONE, other)))


def _both_counts(every: bool, one: Counted, other: Counted) -> Clause:
    return Compound(every, (ItemCount(*one), ItemCount(*other)))
