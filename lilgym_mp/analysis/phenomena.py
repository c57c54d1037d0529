"""Phenomena of a statement: semantic ones told from the structure of its program, syntactic ones from its words.

The categories are those by which lilGym's and NLVR's authors analyse statements (Suhr et al. 2017; Wu et al. 2023).
They marked statements by hand; here a rule reads the program, which says what the statement means and not how it says
it, or the words, where it matters how it is said. RULES and SYNTAX_RULES hold every rule, in words and as code;
docs/official_data.md shows the words.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import StrEnum
from functools import lru_cache
from itertools import combinations
from typing import NamedTuple

from lilgym_mp.analysis.attachment import has_ambiguous_coordination, has_ambiguous_preposition
from lilgym_mp.analysis.structure import (
    FILTERING,
    MIRRORED,
    are_neighbours,
    arguments,
    calls,
    comparisons,
    conjunctions,
    counted_set,
    counts_values,
    free_variables,
    is_count,
    is_fixed,
    item_conditions,
    nodes,
    selection_sources,
    selections,
    structure_key,
    uses,
    written_number,
    written_truth,
)
from lilgym_mp.programs.syntax import Call, Display, Lambda, Logic, Node, Not, SceneName, WordName, parse
from lilgym_mp.scene import BOX_COUNT

CACHE_SIZE = 8_192  # programs, statements


class Phenomenon(StrEnum):
    EXISTENCE = "existence"
    EXACT_CARDINALITY = "exact cardinality"
    SOFT_CARDINALITY = "soft cardinality"
    UNIVERSAL = "universal"
    COORDINATION = "coordination"
    NEGATION = "negation"
    COMPARISON = "comparison"
    SPATIAL_RELATION = "spatial relation"
    PRESUPPOSITION = "presupposition"
    COREFERENCE = "coreference"


class SyntacticPhenomenon(StrEnum):
    """Words that leave open what a part of the statement attaches to."""

    COORDINATION = "syntax: coordination"
    PREPOSITION = "syntax: prepositional attachment"


PHENOMENA: tuple[Phenomenon | SyntacticPhenomenon, ...] = (*Phenomenon, *SyntacticPhenomenon)


_CHOOSING = (*FILTERING, "All", "Any", "contained", "member_of", "equal_set")
_SAMENESS = ("all_same", "all_same_color", "all_same_shape", "all_same_size", "all_same_attribute")
_STANDING = ("is_top", "is_bottom", "is_second", "is_third")
_COMPANY = ("get_box_inclusive", "get_box_exclusive", "get_img_exclusive")  # related by box, not by place


def _has_existence(tree: Node) -> bool:
    return uses(tree, "exist", "Any")


def _has_exact_cardinality(tree: Node) -> bool:
    return any(
        operator in ("==", "!=") and is_count(left) and (written_number(right) or 0) > (1 if counts_values(left) else 0)
        for left, operator, right in comparisons(tree)
    )


def _has_soft_cardinality(tree: Node) -> bool:
    return any(
        operator in MIRRORED
        and is_count(left)
        and written_number(right) is not None
        and not _says_none(left, operator, right)
        for left, operator, right in comparisons(tree)
    )


def _has_universal(tree: Node) -> bool:
    if uses(tree, "All", "all", "equal_set"):
        return True
    if any(not is_fixed(arguments(call)[0]) for call in calls(tree, "contained")):
        return True
    return any(
        _selects_whole(left, right) or _selects_whole(right, left) or _counts_every_box(left, operator, right)
        for left, operator, right in comparisons(tree)
    )


def _selects_whole(part: Node, whole: Node) -> bool:
    """Whether a selection is compared with what it was selected from, or their numbers are."""
    part, whole = counted_set(part) or part, counted_set(whole) or whole
    return any(structure_key(source) == structure_key(whole) for source in selection_sources(part))


def _counts_every_box(left: Node, operator: str, right: Node) -> bool:
    counted = counted_set(left)
    if counted is None or written_number(right) != BOX_COUNT or operator not in ("==", ">="):
        return False
    return any(isinstance(source, SceneName) and source.name == "all_boxes" for source in selection_sources(counted))


def _has_coordination(tree: Node) -> bool:
    if any(isinstance(node, Logic) and node.operator == "or" for node in nodes(tree)):
        return True
    if uses(tree, "OR", "union", "union_all") or any(
        isinstance(node, Display) and len(node.elements) > 1 and is_fixed(node) for node in nodes(tree)
    ):
        return True
    return any(sum(uses(operand, *_CHOOSING) for operand in operands) > 1 for operands in conjunctions(tree))


def _says_none(left: Node, operator: str, right: Node) -> bool:
    """Whether a comparison says that there are none: exactly 0, at most 0, fewer than 1."""
    return is_count(left) and (operator, written_number(right)) in (("==", 0), ("<=", 0), ("<", 1))


def _has_negation(tree: Node) -> bool:
    return (
        uses(tree, "NOT")
        or any(isinstance(node, Not) for node in nodes(tree))
        or any(
            operator in ("!=", "not in") or _says_none(left, operator, right) or written_truth(right) is False
            for left, operator, right in comparisons(tree)
        )
    )


def _has_comparison(tree: Node) -> bool:
    if uses(tree, "min", *_SAMENESS):
        return True
    return any(
        counts_values(left)
        if is_fixed(right)
        else not (is_fixed(left) or _selects_whole(left, right) or _selects_whole(right, left))
        for left, operator, right in comparisons(tree)
        if operator not in ("in", "not in")
    )


def _has_spatial_relation(tree: Node) -> bool:
    words = [node.word for node in nodes(tree) if isinstance(node, Call | WordName)]
    return any(
        word.name in _STANDING or (word.group in ("walls", "two items", "related items") and word.name not in _COMPANY)
        for word in words
    )


def _has_presupposition(tree: Node) -> bool:
    if uses(tree, "min"):
        return True
    if any(not are_neighbours(*arguments(call)) for call in calls(tree, "unique")):
        return True
    return any(
        selections(one) & selections(other)
        for operands in conjunctions(tree)
        for one, other in combinations(operands, 2)
    )


def _has_coreference(tree: Node) -> bool:
    """Whether a condition on one item speaks of the item of a condition around it."""
    return any(
        parameter in free_variables(inner)
        for parameter, body in item_conditions(tree)
        for inner in nodes(body)
        if isinstance(inner, Lambda) and inner.parameter != parameter
    )


class Rule(NamedTuple):
    """How one phenomenon is recognised: in words, and as a test of a program's tree."""

    words: str
    holds: Callable[[Node], bool]


RULES: Mapping[Phenomenon, Rule] = {
    Phenomenon.EXISTENCE: Rule("`exist` or `Any` is asked of some set", _has_existence),
    Phenomenon.EXACT_CARDINALITY: Rule(
        "a count is compared by `==` or `!=` with a number from 1 on (from 2 on where colours, shapes or sizes are "
        "counted)",
        _has_exact_cardinality,
    ),
    Phenomenon.SOFT_CARDINALITY: Rule(
        "a count is compared by `<`, `<=`, `>` or `>=` with a number, unless that says that there are none",
        _has_soft_cardinality,
    ),
    Phenomenon.UNIVERSAL: Rule(
        "`All`, `all`, `equal_set`, or `contained` of a set that depends on the scene; or a selection, or its count, "
        "is compared with what it was selected from; or the boxes with a property are counted and compared by `==` or "
        "`>=` with 3",
        _has_universal,
    ),
    Phenomenon.COORDINATION: Rule(
        "`or`, `union`, or several values written out in a list or set; or `and` joins several conditions of which "
        "at least two each select among the items or boxes (a filter, `All`, `Any`, ...)",
        _has_coordination,
    ),
    Phenomenon.NEGATION: Rule(
        "`not`, `!=`, `not in`, a comparison with False, or a count that says that there are none", _has_negation
    ),
    Phenomenon.COMPARISON: Rule(
        "two values that both depend on the scene are compared (but not a selection with its whole); or the number of "
        "different colours, shapes or sizes is asked; or an `all_same` word or `min`",
        _has_comparison,
    ),
    Phenomenon.SPATIAL_RELATION: Rule(
        "a word about walls, corners, touching, above or below, or the place in a tower (`is_top`, `is_second`, ...)",
        _has_spatial_relation,
    ),
    Phenomenon.PRESUPPOSITION: Rule(
        "`unique` of something other than an item's neighbours, or `min`; or two conditions joined by `and` speak of "
        "the same selection",
        _has_presupposition,
    ),
    Phenomenon.COREFERENCE: Rule(
        "a condition on one item speaks of the item that a condition around it is about", _has_coreference
    ),
}


class SyntaxRule(NamedTuple):
    """How one syntactic phenomenon is recognised: in words, and as a test of a statement."""

    words: str
    holds: Callable[[str], bool]


SYNTAX_RULES: Mapping[SyntacticPhenomenon, SyntaxRule] = {
    SyntacticPhenomenon.COORDINATION: SyntaxRule(
        "`and` or `or` joins a noun phrase to one that stands in a prepositional phrase after another noun; or the "
        "second of two joined noun phrases has a modifier after it (a preposition, `touching`, `which`, ...); or an "
        "adjective stands before the first of two joined nouns, nothing before the second",
        has_ambiguous_coordination,
    ),
    SyntacticPhenomenon.PREPOSITION: SyntaxRule(
        "a noun with a prepositional phrase (`of` too), whose own noun is followed by another prepositional phrase "
        "(not `of`)",
        has_ambiguous_preposition,
    ),
}


@lru_cache(maxsize=CACHE_SIZE)
def phenomena(program: str) -> frozenset[Phenomenon]:
    """The phenomena that the program's structure shows, by RULES. Raises ProgramError for no program."""
    tree = parse(program)
    return frozenset(phenomenon for phenomenon, rule in RULES.items() if rule.holds(tree))


@lru_cache(maxsize=CACHE_SIZE)
def syntactic_phenomena(statement: str) -> frozenset[SyntacticPhenomenon]:
    """The phenomena that the statement's words show, by SYNTAX_RULES."""
    return frozenset(phenomenon for phenomenon, rule in SYNTAX_RULES.items() if rule.holds(statement))
