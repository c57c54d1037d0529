"""A grammar of English that parses statements into meanings, written independently of `sentence_realisation`.

A statement that it cannot parse, or that has two parses with different truth values on some scene, is not used.

Main symbols: NP (noun phrase without determiner), COUNT (quantified noun phrase), VP (verb phrase), LOCATION (phrase
that follows a noun or "is"), COMPLEMENT (of "is"), BOXES and BOX_VP (COUNT and VP about boxes), CONTENT (a box
condition).
"""
# Symbols have values of many types, so the lambdas of the rules cannot be typed individually.
# pyright: reportUnknownLambdaType=false, reportUnknownArgumentType=false, reportUnknownVariableType=false
# pyright: reportUnknownMemberType=false

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache, partial

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
    "<item>": {f"{name}{s}": None for name in ("item", "object", "thing", "shape", "block") for s in ("", "s")},
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
        _box_comparisons,
        _compounds,
    ):
        add_rules(grammar.add)
    return grammar


AddRule = Callable[..., None]  # Grammar.add


def _quantities(add: AddRule) -> None:
    add("Q", "a|an", lambda: SOME)
    add("Q", "no", lambda: NONE)
    add("Q", "RANGE")
    for words, least in (("several / quite a few", 3), ("many / a lot of / lots of", 4)):
        add("Q", words, partial(Quantity, least, None, vague=True))
    add("RANGE", "exactly|only|just|precisely? NUM", exactly)
    add("RANGE", "a single", lambda: exactly(1))
    add("RANGE", "a pair of", lambda: exactly(2))
    add("RANGE", "at least NUM / no fewer than NUM / NUM or more", at_least)
    add("RANGE", "more|greater than NUM", lambda n: at_least(n + 1))
    add("RANGE", "multiple", lambda: at_least(2))
    add("RANGE", "at most NUM / no|not more than NUM", at_most)
    add("RANGE", "fewer than NUM", lambda n: at_most(n - 1))
    add("RANGE", "NUM or NUM / between NUM and NUM / at least NUM but no more than NUM", Quantity)


def _noun_phrases(add: AddRule) -> None:
    add("COLOURS", "COLOUR / COLOUR or COLOUR", lambda *colours: frozenset(colours))
    add("DESCRIPTION", "SIZE? COLOURS? SHAPE / SIZE? COLOURS? <item>", _description)
    add("NP", "DESCRIPTION / DESCRIPTION MODIFIERS", sem.NounPhrase)
    add("MODIFIERS", "MODIFIER / MODIFIER MODIFIERS", lambda first, more=(): (first, *more))
    add("MODIFIER", "that VP / LOCATION")
    add("MODIFIER", "not LOCATION", _negated)
    add("COUNT", "Q NP", sem.Count)
    add("INDEFINITE", "a|an|any|another NP")


def _description(size: Size | None, colours: frozenset[Colour] | None, shape: Shape | None = None) -> sem.Description:
    return sem.Description(shape, colours or frozenset(), size)


def _wall_predicates(add: AddRule) -> None:
    near = partial(sem.AtWall, near=True)
    add("WALL", "a|an|any wall|edge|side", lambda: None)
    add("WALL", "the SIDE wall|edge|side / the wall|edge|side on the SIDE")
    add("WALL", "the floor", lambda: sem.Wall.BOTTOM)
    add("LOCATION", "touching|against WALL", sem.AtWall)
    add("LOCATION", "touching or almost touching WALL / very close to WALL or touching it", near)
    add("VP", "touches|touch WALL", sem.AtWall)
    add("VP", "does|do not touch WALL", partial(sem.AtWall, positive=False))
    add("VP", "touches|touch or almost touches|touch WALL", near)
    add(
        "LOCATION",
        "sitting? in a corner / in a corner of a box / sitting? in corners / tucked into a corner",
        sem.InCorner,
    )


def _predicates(add: AddRule) -> None:
    add("LOCATION", "in|inside the BOX_NAME box", sem.InBox)
    add("LOCATION", "outside the BOX_NAME box", partial(sem.InBox, positive=False))
    add("LOCATION", "at the very? END of a|their tower|stack|towers|stacks", sem.AtPosition)
    add("LOCATION", "in ORDINAL position from the bottom / ORDINAL from the bottom", sem.AtPosition)
    for words, relation, place in (
        ("touching", sem.Relation.TOUCHING, ""),
        ("in contact with", sem.Relation.TOUCHING, ""),
        ("touching or almost touching", sem.Relation.NEAR, ""),
        ("directly|right on top of", sem.Relation.ON, ""),
        ("directly on|above", sem.Relation.ON, ""),
        ("directly|right under|below", sem.Relation.UNDER, ""),
        ("somewhere? above", sem.Relation.ABOVE, "in the same tower|stack|box"),
        ("higher up than", sem.Relation.ABOVE, "in the same tower|stack|box"),
        ("somewhere? below", sem.Relation.BELOW, "in the same tower|stack|box"),
        ("lower down than", sem.Relation.BELOW, "in the same tower|stack|box"),
    ):
        add("LOCATION", f"{words} INDEFINITE {place}", partial(sem.RelatedTo, relation))
        add("LOCATION", f"{words} SAME {place}", partial(sem.RelatedByAttribute, relation, same=True))
        add("LOCATION", f"{words} DIFFERENT {place}", partial(sem.RelatedByAttribute, relation, same=False))
    add("SAME", "a|an|another <item> of the same ATTRIBUTE")
    add("DIFFERENT", "a|an <item> of a different ATTRIBUTE / a|an <item> of another ATTRIBUTE")
    add("VP", "touches|touch INDEFINITE", partial(sem.RelatedTo, sem.Relation.TOUCHING))
    add("VP", "is|are|sits|sit|lies|lie|stands|stand|rests|rest LOCATION")
    add("VP", "is|are not LOCATION", _negated)
    add("VP", "is|are COMPLEMENT", sem.Matches)
    add("VP", "is|are not COMPLEMENT", partial(sem.Matches, positive=False))
    add("COMPLEMENT", "either? colours:COLOURS / size:SIZE", sem.Description)
    add("COMPLEMENT", "SIZE and COLOURS / a|an? SIZE? COLOURS? SHAPE", _description)


def _negated(predicate: sem.Predicate) -> sem.Predicate:
    return replace(predicate, positive=False)


def _box_conditions(add: AddRule) -> None:
    """Conditions of boxes: CONDITION has one as its value; CONTENT and all below have a tuple of several."""
    add("VARIETY", "a single ATTRIBUTE", partial(sem.Variety, quantity=exactly(1)))
    add("VARIETY", "all three ATTRIBUTE", partial(sem.Variety, quantity=exactly(3)))
    add("VARIETY", "quantity:RANGE different? attribute:ATTRIBUTE", sem.Variety)
    add("PARTITIVE", "both|all of", lambda: sem.Partitive.ALL)
    add("PARTITIVE", "none|neither of", lambda: sem.Partitive.NONE)
    add("PARTITIVE", "at least one of", lambda: sem.Partitive.SOME)
    add("PARTITIVE", "exactly|only|just one of", lambda: sem.Partitive.ONE)
    add("CONDITION", "COUNT / <item> of VARIETY")
    add("CONDITION", "only DESCRIPTION", sem.ContainsOnly)
    add("CONDITION", "nothing but NP / only NP", lambda noun: sem.ContainsOnly(_description_of(noun)))
    add("CONDITION", "count:COUNT , partitive:PARTITIVE which predicate:VP", _partitive)
    add("CONDITION", "count:COUNT , which predicate:VP", _partitive)
    add("CONDITION", "a|an colours:COLOURS position:END", sem.EndColour)
    add("CONDITION", "a|an colours:COLOURS block at the position:END", sem.EndColour)
    add("CONDITION", "a|an colours:COLOURS block on position:END", sem.EndColour)
    add("CONDITION", "a top|base and a top|base of the same color", partial(sem.MatchingEnds, same=True))
    add("CONDITION", "a top|base and a top|base of different colors", partial(sem.MatchingEnds, same=False))
    add("ALL_OF_THEM", "both|all of them COMPLEMENT", sem.ContainsOnly)
    add("CONTENT", "CONDITION / COUNT of VARIETY / COUNT , ALL_OF_THEM", _together)
    listed = "CONTENT , CONTENT and|but CONTENT / CONTENT and CONTENT but CONTENT"
    add("CONTENTS", f"CONTENT / CONTENT and|but CONTENT / {listed}", _concatenated)
    add("BOX_VP", "is|are empty", partial(_together, sem.Count(NONE, sem.ANYTHING)))
    add("BOX_VP", "has|have|contains|contain|holds|hold CONTENTS")
    add("HEIGHT", "NUM", lambda number: (sem.Count(exactly(number), sem.ANYTHING),))
    add("TALL", "HEIGHT block|blocks tall|high")
    add("WHOSE_END", "whose position:END block? is colours:COLOURS", sem.EndColour)
    add("BOX_MODIFIER", "with CONTENTS / that BOX_VP / of height HEIGHT / that is|are TALL")
    add("BOX_MODIFIER", "WHOSE_END / WHOSE_END and WHOSE_END", _together)


def _together(*conditions: sem.BoxCondition) -> sem.BoxConditions:
    return conditions


def _concatenated(*parts: sem.BoxConditions) -> sem.BoxConditions:
    return tuple(condition for part in parts for condition in part)


def _partitive(
    count: sem.Count, predicate: sem.Predicate, partitive: sem.Partitive = sem.Partitive.ALL
) -> sem.PartitiveCount:
    return sem.PartitiveCount(count.quantity, count.noun, partitive, predicate)


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
    clause = partial(add, "CLAUSE")
    add("<there>", "somewhere? there is|are / the <picture> has|shows|contains / we see / you|i can see", _no_value)
    add("<there>", "in the <picture> , there is|are", _no_value)
    add("<picture>", "picture|image", _no_value)
    add("<adverbial>", "in total / altogether|overall / in the <picture>", _no_value)
    clause("<there> COUNT <adverbial>? / COUNT is|are present / COUNT is|are in the <picture>")
    clause("COUNT can be seen / COUNT is in|inside one of the boxes / the three? boxes hold COUNT in total")
    none = "there is|are not any NP / the <picture> does not show|have|contain any NP"
    clause(none, partial(sem.Count, NONE))
    clause("the number of noun:NP is quantity:RANGE", sem.Count)
    clause("COUNT VP", lambda count, predicate: sem.Count(count.quantity, count.noun.such_that(predicate)))
    none = "none of the NP VP / not a single NP VP"
    clause(none, lambda noun, predicate: sem.Count(NONE, noun.such_that(predicate)))
    clause("<there> count:COUNT ,? and partitive:PARTITIVE them predicate:VP", _partitive)
    clause("<there> count:COUNT ,? and it predicate:VP", _partitive)
    only = "the only noun:NP predicate:VP / the one and only noun:NP predicate:VP"
    clause(only, partial(sem.PartitiveCount, exactly(1), partitive=sem.Partitive.ALL))
    clause("the number of NP is EVEN / <there> a|an even:EVEN number of noun:NP", sem.Parity)


def _no_value() -> None: ...


def _universal_clauses(add: AddRule) -> None:
    """Universal statements, comparisons of counts, and variety of attribute values."""
    clause = partial(add, "CLAUSE")
    clause("every|each NP VP / all of the NP VP / all the? NP VP", sem.EveryItem)
    clause("everything in the <picture> VP", partial(sem.EveryItem, sem.ANYTHING))
    clause("everything that VP VP", lambda one, other: sem.EveryItem(sem.ANYTHING.such_that(one), other))
    only = "only NP VP / only NP can be seen / nothing but NP can be seen / there are only NP"
    clause(f"{only} / the <picture> has|contains nothing but NP", _only)
    clause("not every NP VP / not all NP VP / not all of the NP VP", partial(sem.EveryItem, positive=False))
    clause(
        "<there> order:ORDER one:NP than other:OTHER / <there> order:ORDER one:NP than there are other:NP", _comparison
    )
    clause("<there> exactly margin:NUM order:ORDER one:NP than other:OTHER", _comparison)
    clause("the NP outnumber the OTHER", partial(_comparison, sem.Order.MORE))
    equal = "there are as many NP as OTHER / there are equally many NP and NP"
    clause(f"{equal} / the number of NP equals the number of NP", partial(_comparison, sem.Order.EQUAL))
    add("OTHER", "NP / COLOURS ones")
    same = "all of? the? <item> have the same ATTRIBUTE / every <item> has the same ATTRIBUTE"
    one = "there is only one ATTRIBUTE in the <picture>"
    clause(f"{same} / {one}", partial(sem.Variety, quantity=exactly(1)))
    three = "all three ATTRIBUTE appear|occur in the <picture> / all three ATTRIBUTE can be seen in the <picture>"
    clause(three, partial(sem.Variety, quantity=exactly(3)))
    clause("<there> <item> of VARIETY")


def _only(noun: sem.NounPhrase, *predicates: sem.Predicate) -> sem.Clause:
    """Everything that satisfies the predicates is what the noun phrase denotes."""
    return sem.EveryItem(sem.NounPhrase(sem.Description(), predicates), sem.Matches(_description_of(noun)))


def _comparison(
    order: sem.Order, one: sem.NounPhrase, other: sem.NounPhrase | frozenset[Colour], margin: int | None = None
) -> sem.Clause:
    """`other` may be colours only ("black ones"); the shape is then that of `one`."""
    if not isinstance(other, sem.NounPhrase):
        other = sem.NounPhrase(sem.Description(one.description.shape, other))
    return sem.CountComparison(one, order, other, margin)


def _box_clauses(add: AddRule) -> None:
    """Clauses about boxes and towers."""
    clause = partial(add, "CLAUSE")
    add("COLOURED", "COLOURS", lambda colours: (sem.ContainsOnly(sem.Description(colours=colours)),))
    for before in ("HEIGHT -block", "COLOURED"):
        add("BOXES", f"Q {before} BOX / Q {before} BOX BOX_MODIFIER", _described_boxes)
    add("BOXES", "quantity:Q towers:BOX conditions:BOX_MODIFIER", sem.BoxCount)
    clause("<there> BOXES")
    clause("quantity:Q towers:BOX conditions:BOX_VP / quantity:RANGE of the towers:BOX conditions:BOX_VP", sem.BoxCount)
    clause("none of the towers:BOX conditions:BOX_VP", partial(sem.BoxCount, NONE))
    add("CONTAINED", "COUNT", _together)
    clause("in|inside some towers:BOX there is|are conditions:CONTAINED", partial(sem.BoxCount, SOME))
    clause("every|each BOX BOX_VP / all of? the? three? BOX BOX_VP", _every_box)
    box = "the index:BOX_NAME towers:BOX"
    clause(f"{box} conditions:BOX_VP / {box} is conditions:TALL", sem.NamedBox)
    contained = "there is|are conditions:CONTAINED"
    clause(f"in|inside {box} {contained} / {contained} in {box}", sem.NamedBox)
    clause(
        f"the END of {box} is COLOURS",
        lambda end, colours, **box: sem.NamedBox(conditions=(sem.EndColour(end, colours),), **box),
    )
    clause("the tallest|highest tower|stack BOX_VP", partial(sem.LargestBox, sem.ANYTHING))
    clause(
        "the END of the tallest|highest tower|stack is COLOURS",
        lambda end, colours: sem.LargestBox(sem.ANYTHING, (sem.EndColour(end, colours),)),
    )
    clause("the box with the most NP BOX_VP", sem.LargestBox)
    same = "all the? three? boxes have the same number of NP / each box has the same number of NP"
    clause(f"{same} / there are equally many NP in each box", partial(sem.EqualCounts, same=True))
    different = "no two boxes have the same number of NP / each box has a different number of NP"
    clause(different, partial(sem.EqualCounts, same=False))


def _described_boxes(
    quantity: Quantity, first: sem.BoxConditions, towers: bool, more: sem.BoxConditions = ()
) -> sem.Clause:
    return sem.BoxCount(quantity, (*first, *more), towers)


def _every_box(towers: bool, conditions: sem.BoxConditions) -> sem.Clause:
    return sem.EveryTower(conditions) if towers else sem.BoxCount(exactly(3), conditions)


def _box_comparisons(add: AddRule) -> None:
    clause = partial(add, "CLAUSE")
    add("<box>", "BOX", lambda _: None)
    taller = partial(sem.BoxComparison, sem.ANYTHING, towers=True)
    clause("the one:BOX_NAME <box> is order:TALLER than the other:BOX_NAME one|tower|stack", taller)
    as_tall = "the one:BOX_NAME <box> is as tall|high as the other:BOX_NAME one|tower|stack"
    same = "the one:BOX_NAME <box> and the other:BOX_NAME <box> have the same height"
    clause(f"{as_tall} / {same}", partial(taller, order=sem.Order.EQUAL))
    as_many = "the one:BOX_NAME box has as many noun:NP as the other:BOX_NAME one|box"
    same = "the one:BOX_NAME box and the other:BOX_NAME box have the same number of noun:NP"
    clause(f"{as_many} / {same}", partial(sem.BoxComparison, order=sem.Order.EQUAL))
    clause("the one:BOX_NAME box has order:ORDER noun:NP than the other:BOX_NAME one|box", sem.BoxComparison)
    in_box = "there are order:ORDER noun:NP in the one:BOX_NAME box than in the other:BOX_NAME one|box"
    clause(in_box, sem.BoxComparison)


def _compounds(add: AddRule) -> None:
    conjunction, disjunction = partial(_compound, True), partial(_compound, False)
    add("STATEMENT", "CLAUSE")
    add("STATEMENT", "CLAUSE ,? and|while|but CLAUSE", conjunction)
    add("STATEMENT", "either CLAUSE or CLAUSE / CLAUSE , or CLAUSE", disjunction)
    add("NONE", "NP", partial(sem.Count, NONE))
    add("CLAUSE", "<there> both? COUNT and|but COUNT / there are neither NONE nor NONE", conjunction)
    add("CLAUSE", "<there> either? COUNT or COUNT", disjunction)


def _compound(conjunctive: bool, *clauses: sem.Clause) -> sem.Clause:
    return sem.Compound(conjunctive, clauses)
