"""A grammar of English that parses statements into meanings, written independently of `sentence_realisation`.

A statement that it cannot parse, or that has two parses with different truth values on some scene, is not used.

Main symbols: NP (noun phrase without determiner), QNP (quantified noun phrase), VP (verb phrase), LOCATION (phrase that
follows a noun or "is"), COMPLEMENT (of "is"), BOXES and BOX_VP (QNP and VP about boxes), CONTENT (a box condition).
"""
# Symbols have values of many types, so the lambdas of the rules cannot be typed individually.
# pyright: reportUnknownLambdaType=false, reportUnknownArgumentType=false, reportUnknownVariableType=false

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache

from lilgym_mp.generator.meanings import semantics as sem
from lilgym_mp.generator.meanings.chart_parser import Grammar
from lilgym_mp.generator.quantities import NONE, SOME, Quantity, at_least, at_most, exactly
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
# deliberately not shared with `lexicon`, whose use the grammar verifies
_NUMBER_WORDS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
LEXICON: Mapping[str, Mapping[str, object]] = {
    "NUM": {word: number for number, word in enumerate(_NUMBER_WORDS)} | {str(number): number for number in range(21)},
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
        f"{attribute.replace('colour', 'color')}{s}": attribute for attribute in sem.Attribute for s in ("", "s")
    },
    "BOX_NAME": {"left": 0, "middle": 1, "right": 2},
    "ORDER": {"more": sem.Order.MORE, "fewer": sem.Order.FEWER},
    "TALLER": {
        **dict.fromkeys(("taller", "higher"), sem.Order.MORE),
        **dict.fromkeys(("shorter", "lower"), sem.Order.FEWER),
    },
    "BOX": {"box": False, "boxes": False, **dict.fromkeys(("tower", "towers", "stack", "stacks"), True)},
    "SIDE": {
        "left": sem.Wall.LEFT,
        "right": sem.Wall.RIGHT,
        **dict.fromkeys(("top", "upper"), sem.Wall.TOP),
        **dict.fromkeys(("bottom", "lower"), sem.Wall.BOTTOM),
    },
    "END": {"top": sem.TowerPosition.TOP, **dict.fromkeys(("bottom", "base"), sem.TowerPosition.BOTTOM)},
    "ORDINAL": {"second": sem.TowerPosition.SECOND, "third": sem.TowerPosition.THIRD},
    "EVEN": {"even": True, "odd": False},
}


def parse_statement(statement: str) -> list[sem.Clause]:
    """Every parse of the statement as a meaning; empty if the grammar does not cover it."""
    return _grammar().parses("STATEMENT", _tokens(statement))


def _tokens(statement: str) -> list[str]:
    text = re.sub(r"[.!]+$", "", statement.strip().lower())
    for short, long in EXPANSIONS:
        text = text.replace(short, long)
    return text.split()


@cache
def _grammar() -> Grammar:
    grammar = Grammar(LEXICON)
    for add_rules in (
        _quantities,
        _noun_phrases,
        _wall_predicates,
        _predicates,
        _box_conditions,
        _item_clauses,
        _universal_clauses,
        _box_clauses,
        _compounds,
    ):
        add_rules(grammar.add)
    return grammar


AddRule = Callable[..., None]  # Grammar.add
Quantified = tuple[Quantity, sem.NounPhrase]  # the value of a QNP


def _quantities(add: AddRule) -> None:
    add("SOME", "a|an", lambda: SOME)
    add("Q", "SOME")
    add("Q", "no", lambda: NONE)
    add("Q", "RANGE")
    for words, least in (("several", 3), ("quite a few", 3), ("many", 4), ("a lot of", 4), ("lots of", 4)):
        add("Q", words, lambda least=least: Quantity(least, None, vague=True))
    add("RANGE", "exactly|only|just|precisely? NUM", exactly)
    add("RANGE", "a single", lambda: exactly(1))
    add("RANGE", "a pair of", lambda: exactly(2))
    add("RANGE", "at least NUM", at_least)
    add("RANGE", "no fewer than NUM", at_least)
    add("RANGE", "NUM or more", at_least)
    add("RANGE", "more|greater than NUM", lambda n: at_least(n + 1))
    add("RANGE", "multiple", lambda: at_least(2))
    add("RANGE", "at most NUM", at_most)
    add("RANGE", "no|not more than NUM", at_most)
    add("RANGE", "fewer than NUM", lambda n: at_most(n - 1))
    add("RANGE", "NUM or NUM", Quantity)
    add("RANGE", "between NUM and NUM", Quantity)
    add("RANGE", "at least NUM but no more than NUM", Quantity)


def _noun_phrases(add: AddRule) -> None:
    add("COLOURS", "COLOUR", lambda colour: frozenset({colour}))
    add("COLOURS", "COLOUR or COLOUR", lambda one, other: frozenset({one, other}))
    add("HEAD", "SHAPE")
    add("HEAD", "ITEM")
    add(
        "DESCRIPTION",
        "SIZE? COLOURS? HEAD",
        lambda size, colours, head: sem.Description(head, colours or frozenset(), size),
    )
    add("NP", "DESCRIPTION MODIFIERS?", lambda description, predicates: sem.NounPhrase(description, predicates or ()))
    add("MODIFIERS", "MODIFIER MODIFIERS?", lambda predicate, more: (predicate, *(more or ())))
    add("MODIFIER", "that VP")
    add("MODIFIER", "LOCATION")
    add("MODIFIER", "not LOCATION", _negated)
    add("QNP", "Q NP", lambda quantity, noun: (quantity, noun))
    add("INDEFINITE", "a|an|any|another NP")
    add("ONES", "COLOURS ones")


def _wall_predicates(add: AddRule) -> None:
    add("WALL", "a|an|any wall|edge|side", lambda: None)
    add("WALL", "the SIDE wall|edge|side")
    add("WALL", "the wall|edge|side on the SIDE")
    add("WALL", "the floor", lambda: sem.Wall.BOTTOM)
    add("LOCATION", "touching|against WALL", sem.AtWall)
    add("LOCATION", "touching or almost touching WALL", lambda wall: sem.AtWall(wall, near=True))
    add("LOCATION", "very close to WALL or touching it", lambda wall: sem.AtWall(wall, near=True))
    add("VP", "touches|touch WALL", sem.AtWall)
    add("VP", "does|do not touch WALL", lambda wall: sem.AtWall(wall, positive=False))
    add("VP", "touches|touch or almost touches|touch WALL", lambda wall: sem.AtWall(wall, near=True))
    add("LOCATION", "sitting? in a corner", sem.InCorner)
    add("LOCATION", "in a corner of a box", sem.InCorner)
    add("LOCATION", "sitting? in corners", sem.InCorner)
    add("LOCATION", "tucked into a corner", sem.InCorner)


def _predicates(add: AddRule) -> None:
    add("LOCATION", "in|inside the BOX_NAME box", sem.InBox)
    add("LOCATION", "outside the BOX_NAME box", lambda index: sem.InBox(index, positive=False))
    add("LOCATION", "at the very? END of a|their tower|stack|towers|stacks", sem.AtPosition)
    add("LOCATION", "in ORDINAL position from the bottom", sem.AtPosition)
    add("LOCATION", "ORDINAL from the bottom", sem.AtPosition)
    for words, relation in (
        ("touching", sem.Relation.TOUCHING),
        ("in contact with", sem.Relation.TOUCHING),
        ("touching or almost touching", sem.Relation.NEAR),
        ("directly on top of", sem.Relation.ON),
        ("right on top of", sem.Relation.ON),
        ("directly on|above", sem.Relation.ON),
        ("directly|right under|below", sem.Relation.UNDER),
    ):
        add("LOCATION", f"{words} INDEFINITE", lambda noun, relation=relation: sem.RelatedTo(relation, noun))
        add("LOCATION", f"{words} SIMILAR", lambda other, relation=relation: sem.RelatedByAttribute(relation, *other))
    for words, relation in (
        ("somewhere? above", sem.Relation.ABOVE),
        ("higher up than", sem.Relation.ABOVE),
        ("somewhere? below", sem.Relation.BELOW),
        ("lower down than", sem.Relation.BELOW),
    ):
        place = "in the same tower|stack|box"
        add("LOCATION", f"{words} INDEFINITE {place}", lambda noun, relation=relation: sem.RelatedTo(relation, noun))
        add(
            "LOCATION",
            f"{words} SIMILAR {place}",
            lambda other, relation=relation: sem.RelatedByAttribute(relation, *other),
        )
    add("SIMILAR", "a|an|another ITEM of the same ATTRIBUTE", lambda _, attribute: (attribute, True))
    add("SIMILAR", "a|an ITEM of a different ATTRIBUTE", lambda _, attribute: (attribute, False))
    add("SIMILAR", "a|an ITEM of another ATTRIBUTE", lambda _, attribute: (attribute, False))
    add("VP", "touches|touch INDEFINITE", lambda noun: sem.RelatedTo(sem.Relation.TOUCHING, noun))
    add("VP", "is|are|sits|sit|lies|lie|stands|stand|rests|rest LOCATION")
    add("VP", "is|are not LOCATION", _negated)
    add("VP", "is|are COMPLEMENT", sem.Matches)
    add("VP", "is|are not COMPLEMENT", lambda description: sem.Matches(description, positive=False))
    add("COMPLEMENT", "either? COLOURS", lambda colours: sem.Description(colours=colours))
    add("COMPLEMENT", "SIZE", lambda size: sem.Description(size=size))
    add("COMPLEMENT", "SIZE and COLOURS", lambda size, colours: sem.Description(size=size, colours=colours))
    add(
        "COMPLEMENT",
        "a|an? SIZE? COLOURS? SHAPE",
        lambda size, colours, shape: sem.Description(shape, colours or frozenset(), size),
    )


def _negated(predicate: sem.Predicate) -> sem.Predicate:
    return replace(predicate, positive=False)


def _box_conditions(add: AddRule) -> None:
    """Box conditions: CONTENT is an item of CONTENTS, the object of "has" or "with". The values are conditions."""
    add("VARIETY", "a single ATTRIBUTE", lambda attribute: (attribute, exactly(1)))
    add("VARIETY", "all three ATTRIBUTE", lambda attribute: (attribute, exactly(3)))
    add("VARIETY", "RANGE different? ATTRIBUTE", lambda quantity, attribute: (attribute, quantity))
    add("CONTENT", "QNP", lambda quantified: (sem.Contains(*quantified),))
    add("CONTENT", "only DESCRIPTION", lambda description: (sem.ContainsOnly(description),))
    add("CONTENT", "nothing but NP", lambda noun: (sem.ContainsOnly(_description_of(noun)),))
    add("CONTENT", "only NP", lambda noun: (sem.ContainsOnly(_description_of(noun)),))
    add("CONTENT", "ITEM of VARIETY", lambda _, variety: (sem.BoxVariety(*variety),))
    add("CONTENT", "QNP of VARIETY", lambda quantified, variety: (sem.Contains(*quantified), sem.BoxVariety(*variety)))
    add(
        "CONTENT",
        "QNP , both|all of them COMPLEMENT",
        lambda quantified, description: (sem.Contains(*quantified), sem.ContainsOnly(description)),
    )
    add("CONTENT", "QNP , PARTITIVE which VP", _contains_partitive)
    add(
        "CONTENT",
        "QNP , which VP",
        lambda quantified, predicate: _contains_partitive(quantified, sem.Partitive.ALL, predicate),
    )
    add("CONTENT", "a|an COLOURS END", lambda colours, end: (sem.EndColour(end, colours),))
    add("CONTENT", "a|an COLOURS block at the END", lambda colours, end: (sem.EndColour(end, colours),))
    add("CONTENT", "a|an COLOURS block on END", lambda colours, end: (sem.EndColour(end, colours),))
    add("CONTENT", "a top|base and a top|base of the same color", lambda: (sem.MatchingEnds(same=True),))
    add("CONTENT", "a top|base and a top|base of different colors", lambda: (sem.MatchingEnds(same=False),))
    add("PARTITIVE", "both|all of", lambda: sem.Partitive.ALL)
    add("PARTITIVE", "none|neither of", lambda: sem.Partitive.NONE)
    add("PARTITIVE", "at least one of", lambda: sem.Partitive.SOME)
    add("PARTITIVE", "exactly|only|just one of", lambda: sem.Partitive.ONE)
    add("CONTENTS", "CONTENT")
    add("CONTENTS", "CONTENT and|but CONTENT", lambda one, other: (*one, *other))
    add("CONTENTS", "CONTENT , CONTENT and|but CONTENT", lambda one, two, three: (*one, *two, *three))
    add("CONTENTS", "CONTENT and CONTENT but CONTENT", lambda one, two, three: (*one, *two, *three))
    add("BOX_VP", "is|are empty", lambda: (sem.Contains(NONE, sem.ANYTHING),))
    add("BOX_VP", "has|have|contains|contain|holds|hold CONTENTS")
    add("TALL", "NUM block|blocks tall|high", _height)
    add("END_CLAUSE", "END block? is COLOURS", lambda end, colours: (sem.EndColour(end, colours),))
    add("BOX_MODIFIER", "with CONTENTS")
    add("BOX_MODIFIER", "that BOX_VP")
    add("BOX_MODIFIER", "of height NUM", _height)
    add("BOX_MODIFIER", "that is|are TALL")
    add("BOX_MODIFIER", "whose END_CLAUSE")
    add("BOX_MODIFIER", "whose END_CLAUSE and whose END_CLAUSE", lambda one, other: (*one, *other))


def _contains_partitive(
    quantified: Quantified, partitive: sem.Partitive, predicate: sem.Predicate
) -> tuple[sem.BoxCondition, ...]:
    return (sem.ContainsPartitive(*quantified, partitive, predicate),)


def _height(number: int) -> tuple[sem.BoxCondition, ...]:
    return (sem.Contains(exactly(number), sem.ANYTHING),)


def _description_of(noun: sem.NounPhrase) -> sem.Description:
    """The noun phrase as a description; its only predicate may be "that is not COLOUR"."""
    match noun:
        case sem.NounPhrase(description, ()):
            return description
        case sem.NounPhrase(description, (sem.Matches(sem.Description(None, colours, None), False),)) if (
            not description.colours
        ):
            return sem.Description(description.shape, frozenset(Colour) - colours, description.size)
        case _:
            return sem.Description(colours=frozenset(Colour))


def _item_clauses(add: AddRule) -> None:
    """Clauses that count items in the picture."""
    for words in ("somewhere? there is|are", "the PICTURE has|shows|contains", "we see", "you|i can see"):
        add("THERE", words, lambda *_: None)
    add("THERE", "in the PICTURE , there is|are", lambda *_: None)
    add("PICTURE", "picture|image", lambda: None)
    add("ADVERBIAL", "in total", lambda: None)
    add("ADVERBIAL", "altogether|overall", lambda: None)
    add("ADVERBIAL", "in the PICTURE", lambda _: None)
    add("CLAUSE", "THERE QNP ADVERBIAL?", lambda _, quantified, place: sem.ItemCount(*quantified))
    add("CLAUSE", "QNP is|are present", lambda quantified: sem.ItemCount(*quantified))
    add("CLAUSE", "QNP is|are in the PICTURE", lambda quantified, _: sem.ItemCount(*quantified))
    add("CLAUSE", "QNP can be seen", lambda quantified: sem.ItemCount(*quantified))
    add("CLAUSE", "QNP is in|inside one of the boxes", lambda quantified: sem.ItemCount(*quantified))
    add("CLAUSE", "the three? boxes hold QNP in total", lambda quantified: sem.ItemCount(*quantified))
    add("CLAUSE", "there is|are not any NP", lambda noun: sem.ItemCount(NONE, noun))
    add("CLAUSE", "the PICTURE does not show|have|contain any NP", lambda _, noun: sem.ItemCount(NONE, noun))
    add("CLAUSE", "the number of NP is RANGE", lambda noun, quantity: sem.ItemCount(quantity, noun))
    add("CLAUSE", "QNP VP", _quantified_subject)
    add("CLAUSE", "none of the NP VP", lambda noun, predicate: _item_count(NONE, noun, predicate))
    add("CLAUSE", "not a single NP VP", lambda noun, predicate: _item_count(NONE, noun, predicate))
    add(
        "CLAUSE",
        "THERE QNP ,? and PARTITIVE them VP",
        lambda _, quantified, partitive, predicate: _partitive_item_count(quantified, partitive, predicate),
    )
    add(
        "CLAUSE",
        "THERE QNP ,? and it VP",
        lambda _, quantified, predicate: _partitive_item_count(quantified, sem.Partitive.ALL, predicate),
    )
    add("CLAUSE", "the only NP VP", _the_only)
    add("CLAUSE", "the one and only NP VP", _the_only)
    add("CLAUSE", "the number of NP is EVEN", sem.Parity)
    add("CLAUSE", "THERE a|an EVEN number of NP", lambda _, even, noun: sem.Parity(noun, even))


def _quantified_subject(quantified: Quantified, predicate: sem.Predicate) -> sem.Clause:
    return _item_count(*quantified, predicate)


def _item_count(quantity: Quantity, noun: sem.NounPhrase, predicate: sem.Predicate) -> sem.Clause:
    return sem.ItemCount(quantity, noun.such_that(predicate))


def _partitive_item_count(quantified: Quantified, partitive: sem.Partitive, predicate: sem.Predicate) -> sem.Clause:
    return sem.PartitiveCount(*quantified, partitive, predicate)


def _the_only(noun: sem.NounPhrase, predicate: sem.Predicate) -> sem.Clause:
    return sem.PartitiveCount(exactly(1), noun, sem.Partitive.ALL, predicate)


def _universal_clauses(add: AddRule) -> None:
    """Universal statements, comparisons of counts, and variety of attribute values."""
    add("CLAUSE", "every|each NP VP", sem.EveryItem)
    add("CLAUSE", "all of the NP VP", sem.EveryItem)
    add("CLAUSE", "all the? NP VP", sem.EveryItem)
    add("CLAUSE", "everything in the PICTURE VP", lambda _, predicate: sem.EveryItem(sem.ANYTHING, predicate))
    add(
        "CLAUSE",
        "everything that VP VP",
        lambda one, other: sem.EveryItem(sem.NounPhrase(sem.Description(), (one,)), other),
    )
    add(
        "CLAUSE",
        "only NP VP",
        lambda noun, predicate: sem.EveryItem(sem.NounPhrase(sem.Description(), (predicate,)), _matches(noun)),
    )
    add("CLAUSE", "only NP can be seen", lambda noun: sem.EveryItem(sem.ANYTHING, _matches(noun)))
    add("CLAUSE", "nothing but NP can be seen", lambda noun: sem.EveryItem(sem.ANYTHING, _matches(noun)))
    add("CLAUSE", "there are only NP", lambda noun: sem.EveryItem(sem.ANYTHING, _matches(noun)))
    add(
        "CLAUSE", "the PICTURE has|contains nothing but NP", lambda _, noun: sem.EveryItem(sem.ANYTHING, _matches(noun))
    )
    add("CLAUSE", "not every NP VP", sem.NotEveryItem)
    add("CLAUSE", "not all NP VP", sem.NotEveryItem)
    add("CLAUSE", "not all of the NP VP", sem.NotEveryItem)
    add("CLAUSE", "THERE ORDER NP than OTHER", lambda _, order, one, other: _count_comparison(one, order, other))
    add(
        "CLAUSE",
        "THERE ORDER NP than there are NP",
        lambda _, order, one, other: sem.CountComparison(one, order, other),
    )
    add(
        "CLAUSE",
        "THERE exactly NUM ORDER NP than OTHER",
        lambda _, margin, order, one, other: _count_comparison(one, order, other, margin),
    )
    add("CLAUSE", "the NP outnumber the OTHER", lambda one, other: _count_comparison(one, sem.Order.MORE, other))
    add("CLAUSE", "there are as many NP as OTHER", lambda one, other: _count_comparison(one, sem.Order.EQUAL, other))
    add(
        "CLAUSE",
        "there are equally many NP and NP",
        lambda one, other: sem.CountComparison(one, sem.Order.EQUAL, other),
    )
    add(
        "CLAUSE",
        "the number of NP equals the number of NP",
        lambda one, other: sem.CountComparison(one, sem.Order.EQUAL, other),
    )
    add("OTHER", "NP")
    add("OTHER", "ONES")
    add("CLAUSE", "all of? the? ITEM have the same ATTRIBUTE", _single_value)
    add("CLAUSE", "every ITEM has the same ATTRIBUTE", _single_value)
    add("CLAUSE", "there is only one ATTRIBUTE in the PICTURE", lambda attribute, _: _single_value(None, attribute))
    add(
        "CLAUSE",
        "all three ATTRIBUTE SHOWN in the PICTURE",
        lambda attribute, *_: sem.SceneVariety(attribute, exactly(3)),
    )
    add("SHOWN", "appear|occur", lambda: None)
    add("SHOWN", "can be seen", lambda: None)
    add("CLAUSE", "THERE ITEM of VARIETY", lambda there, item, variety: sem.SceneVariety(*variety))


def _single_value(_: object, attribute: sem.Attribute) -> sem.Clause:
    return sem.SceneVariety(attribute, exactly(1))


def _matches(noun: sem.NounPhrase) -> sem.Matches:
    return sem.Matches(_description_of(noun))


def _count_comparison(
    one: sem.NounPhrase, order: sem.Order, other: sem.NounPhrase | frozenset[Colour], margin: int | None = None
) -> sem.Clause:
    """`other` may be colours only ("black ones"); the shape is then that of `one`."""
    if not isinstance(other, sem.NounPhrase):
        other = sem.NounPhrase(sem.Description(one.description.shape, other))
    return sem.CountComparison(one, order, other, margin)


def _box_clauses(add: AddRule) -> None:
    """Clauses about boxes and towers."""
    add(
        "BOXES",
        "Q NUM -block BOX BOX_MODIFIER?",
        lambda q, number, towers, more: sem.BoxCount(q, (*_height(number), *(more or ())), towers),
    )
    add(
        "BOXES",
        "Q COLOURS BOX BOX_MODIFIER?",
        lambda q, colours, towers, more: sem.BoxCount(
            q, (sem.ContainsOnly(sem.Description(colours=colours)), *(more or ())), towers
        ),
    )
    add("BOXES", "Q BOX BOX_MODIFIER", lambda quantity, towers, conditions: sem.BoxCount(quantity, conditions, towers))
    add("CLAUSE", "THERE BOXES", lambda _, boxes: boxes)
    add("CLAUSE", "Q BOX BOX_VP", lambda quantity, towers, conditions: sem.BoxCount(quantity, conditions, towers))
    add(
        "CLAUSE",
        "RANGE of the BOX BOX_VP",
        lambda quantity, towers, conditions: sem.BoxCount(quantity, conditions, towers),
    )
    add("CLAUSE", "none of the BOX BOX_VP", lambda towers, conditions: sem.BoxCount(NONE, conditions, towers))
    add(
        "CLAUSE",
        "in|inside some BOX there is|are QNP",
        lambda towers, quantified: sem.BoxCount(SOME, (sem.Contains(*quantified),), towers),
    )
    add("CLAUSE", "every|each BOX BOX_VP", _every_box)
    add("CLAUSE", "all of? the? three? BOX BOX_VP", _every_box)
    add("CLAUSE", "the BOX_NAME BOX BOX_VP", lambda index, towers, conditions: sem.NamedBox(index, conditions, towers))
    add("CLAUSE", "in|inside the BOX_NAME BOX there is|are QNP", _contains_in_named_box)
    add(
        "CLAUSE",
        "there is|are QNP in the BOX_NAME BOX",
        lambda quantified, index, towers: _contains_in_named_box(index, towers, quantified),
    )
    add("CLAUSE", "the BOX_NAME BOX is TALL", lambda index, towers, conditions: sem.NamedBox(index, conditions, towers))
    add(
        "CLAUSE",
        "the END of the BOX_NAME BOX is COLOURS",
        lambda end, index, towers, colours: sem.NamedBox(index, (sem.EndColour(end, colours),), towers),
    )
    add("CLAUSE", "the tallest|highest tower|stack BOX_VP", lambda conditions: sem.LargestBox(sem.ANYTHING, conditions))
    add(
        "CLAUSE",
        "the END of the tallest|highest tower|stack is COLOURS",
        lambda end, colours: sem.LargestBox(sem.ANYTHING, (sem.EndColour(end, colours),)),
    )
    add("CLAUSE", "the box with the most NP BOX_VP", sem.LargestBox)
    add("CLAUSE", "all the? three? boxes have the same number of NP", lambda noun: sem.EqualCounts(noun, same=True))
    add("CLAUSE", "each box has the same number of NP", lambda noun: sem.EqualCounts(noun, same=True))
    add("CLAUSE", "there are equally many NP in each box", lambda noun: sem.EqualCounts(noun, same=True))
    add("CLAUSE", "no two boxes have the same number of NP", lambda noun: sem.EqualCounts(noun, same=False))
    add("CLAUSE", "each box has a different number of NP", lambda noun: sem.EqualCounts(noun, same=False))
    _box_comparisons(add)


def _every_box(towers: bool, conditions: tuple[sem.BoxCondition, ...]) -> sem.Clause:
    return sem.EveryTower(conditions) if towers else sem.BoxCount(exactly(3), conditions)


def _contains_in_named_box(index: int, towers: bool, quantified: Quantified) -> sem.Clause:
    return sem.NamedBox(index, (sem.Contains(*quantified),), towers)


def _box_comparisons(add: AddRule) -> None:
    def taller(one: int, _: bool, order: sem.Order, other: int) -> sem.Clause:
        return sem.BoxComparison(sem.ANYTHING, one, order, other, towers=True)

    add("CLAUSE", "the BOX_NAME BOX is TALLER than the BOX_NAME one|tower|stack", taller)
    add(
        "CLAUSE",
        "the BOX_NAME BOX is as tall|high as the BOX_NAME one|tower|stack",
        lambda one, _, other: taller(one, True, sem.Order.EQUAL, other),
    )
    add(
        "CLAUSE",
        "the BOX_NAME BOX and the BOX_NAME BOX have the same height",
        lambda one, _, other, __: taller(one, True, sem.Order.EQUAL, other),
    )
    add(
        "CLAUSE",
        "the BOX_NAME box has as many NP as the BOX_NAME one|box",
        lambda one, noun, other: sem.BoxComparison(noun, one, sem.Order.EQUAL, other),
    )
    add(
        "CLAUSE",
        "the BOX_NAME box and the BOX_NAME box have the same number of NP",
        lambda one, other, noun: sem.BoxComparison(noun, one, sem.Order.EQUAL, other),
    )
    add(
        "CLAUSE",
        "the BOX_NAME box has ORDER NP than the BOX_NAME one|box",
        lambda one, order, noun, other: sem.BoxComparison(noun, one, order, other),
    )
    add(
        "CLAUSE",
        "there are ORDER NP in the BOX_NAME box than in the BOX_NAME one|box",
        lambda order, noun, one, other: sem.BoxComparison(noun, one, order, other),
    )


def _compounds(add: AddRule) -> None:
    add("STATEMENT", "CLAUSE")
    add("STATEMENT", "CLAUSE ,? and|while|but CLAUSE", lambda one, other: sem.Compound(True, (one, other)))
    add("STATEMENT", "either CLAUSE or CLAUSE", lambda one, other: sem.Compound(False, (one, other)))
    add("STATEMENT", "CLAUSE , or CLAUSE", lambda one, other: sem.Compound(False, (one, other)))
    add("CLAUSE", "THERE both? QNP and|but QNP", lambda _, one, other: _compound_counts(True, one, other))
    add("CLAUSE", "THERE either? QNP or QNP", lambda _, one, other: _compound_counts(False, one, other))
    add("CLAUSE", "there are neither NP nor NP", lambda one, other: _compound_counts(True, (NONE, one), (NONE, other)))


def _compound_counts(every: bool, one: Quantified, other: Quantified) -> sem.Clause:
    return sem.Compound(every, (sem.ItemCount(*one), sem.ItemCount(*other)))
