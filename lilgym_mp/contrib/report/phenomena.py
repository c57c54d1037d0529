"""Linguistic phenomena of statements: semantic ones detected in the program, syntactic ones in the wording.

The categories are those of the lilGym and NLVR papers (Suhr et al. 2017; Wu et al. 2023), whose authors annotated
statements by hand. Here, rules over the program detect the semantic phenomena, and rules over the words the syntactic
ones. RULES and SYNTAX_RULES contain the rules, each described by its docstring, as docs/official_data.md lists them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from enum import StrEnum
from functools import lru_cache
from itertools import combinations

from lilgym_mp.corpus.spelling import plain_words
from lilgym_mp.programs.syntax import (
    Arithmetic,
    Call,
    Comparison,
    Constant,
    Display,
    Lambda,
    Logic,
    Member,
    Node,
    Not,
    SceneName,
    Variable,
    WordName,
    children,
    free_variables,
    parse,
    walk,
)
from lilgym_mp.scene import BOX_COUNT

CACHE_SIZE = 8_192  # cached programs and statements
_OPERATOR_OF_WORD = {"le": "<=", "ge": ">=", "lt": "<", "gt": ">"}  # all other comparison words mean ==
MIRRORED = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}
_COUNTING = ("count", "len")
FILTERING = ("filter_obj", "filter_color", "filter_shape", "filter_size")
_VALUE_SETS = ("get_set_colors", "get_set_shapes", "get_set_sizes", "query_color", "query_shape", "query_size")


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
    """Ambiguous attachment of a part of the statement."""

    COORDINATION = "syntax: coordination"
    PREPOSITION = "syntax: prepositional attachment"


PHENOMENA: tuple[Phenomenon | SyntacticPhenomenon, ...] = (*Phenomenon, *SyntacticPhenomenon)


_SELECTION_WORDS = (*FILTERING, "All", "Any", "contained", "member_of", "equal_set")
_SAMENESS_WORDS = ("all_same", "all_same_color", "all_same_shape", "all_same_size", "all_same_attribute")
_LEVEL_WORDS = ("is_top", "is_bottom", "is_second", "is_third")
_MEMBERSHIP_WORDS = ("get_box_inclusive", "get_box_exclusive", "get_img_exclusive")  # relations that are not spatial


def _has_existence(tree: Node) -> bool:
    """`exist` or `Any`."""
    return uses(tree, "exist", "Any")


def _has_exact_cardinality(tree: Node) -> bool:
    """`==` or `!=` compares a count with a number of at least 1 (2 for a count of colours, shapes or sizes)."""
    return any(
        operator in ("==", "!=") and is_count(left) and (literal_int(right) or 0) > (1 if counts_values(left) else 0)
        for left, operator, right in comparisons(tree)
    )


def _has_soft_cardinality(tree: Node) -> bool:
    """`<`, `<=`, `>` or `>=` compares a count with a number, except when it states that the count is zero."""
    return any(
        operator in MIRRORED
        and is_count(left)
        and literal_int(right) is not None
        and not _says_none(left, operator, right)
        for left, operator, right in comparisons(tree)
    )


def _has_universal(tree: Node) -> bool:
    """`All`, `all`, `equal_set`, or `contained` for a set that depends on the scene; or a selection, or its count, is
    compared with the set it was selected from; or `==` or `>=` compares the number of boxes with a property with 3.
    """
    if uses(tree, "All", "all", "equal_set"):
        return True
    if any(not is_literal(arguments(call)[0]) for call in calls(tree, "contained")):
        return True
    return any(
        _selects_whole(left, right) or _selects_whole(right, left) or _counts_every_box(left, operator, right)
        for left, operator, right in comparisons(tree)
    )


def _selects_whole(part: Node, whole: Node) -> bool:
    """Whether `part` is a selection from `whole`; also for their counts."""
    part, whole = counted_set(part) or part, counted_set(whole) or whole
    return any(structure_key(source) == structure_key(whole) for source in selection_sources(part))


def _counts_every_box(left: Node, operator: str, right: Node) -> bool:
    counted = counted_set(left)
    if counted is None or literal_int(right) != BOX_COUNT or operator not in ("==", ">="):
        return False
    return any(isinstance(source, SceneName) and source.name == "all_boxes" for source in selection_sources(counted))


def _has_coordination(tree: Node) -> bool:
    """`or`, `union`, or a list or set of several literal values; or `and` joins conditions, at least two of which
    select items or boxes (a filter, `All`, `Any`, ...).
    """
    if any(isinstance(node, Logic) and node.operator == "or" for node in walk(tree)):
        return True
    if uses(tree, "OR", "union", "union_all") or any(
        isinstance(node, Display) and len(node.elements) > 1 and is_literal(node) for node in walk(tree)
    ):
        return True
    return any(sum(uses(operand, *_SELECTION_WORDS) for operand in operands) > 1 for operands in conjunctions(tree))


def _says_none(left: Node, operator: str, right: Node) -> bool:
    """Whether the comparison states that a count is zero."""
    return is_count(left) and (operator, literal_int(right)) in (("==", 0), ("<=", 0), ("<", 1))


def _has_negation(tree: Node) -> bool:
    """`not`, `!=`, `not in`, a comparison with False, or a comparison stating that a count is zero."""
    return (
        uses(tree, "NOT")
        or any(isinstance(node, Not) for node in walk(tree))
        or any(
            operator in ("!=", "not in")
            or _says_none(left, operator, right)
            or (isinstance(right, Constant) and right.value is False)
            for left, operator, right in comparisons(tree)
        )
    )


def _has_comparison(tree: Node) -> bool:
    """Two values that both depend on the scene are compared (except a selection with its source); or the number of
    distinct colours, shapes or sizes is compared; or an `all_same` word or `min`.
    """
    if uses(tree, "min", *_SAMENESS_WORDS):
        return True
    return any(
        counts_values(left)
        if is_literal(right)
        else not (is_literal(left) or _selects_whole(left, right) or _selects_whole(right, left))
        for left, operator, right in comparisons(tree)
        if operator not in ("in", "not in")
    )


def _has_spatial_relation(tree: Node) -> bool:
    """A word about walls, corners, touching, above or below, or the level in a tower (`is_top`, `is_second`, ...)."""
    words = [node.word for node in walk(tree) if isinstance(node, Call | WordName)]
    return any(
        word.name in _LEVEL_WORDS
        or (word.group in ("walls", "two items", "related items") and word.name not in _MEMBERSHIP_WORDS)
        for word in words
    )


def _has_presupposition(tree: Node) -> bool:
    """`unique` of anything but an item's neighbours, or `min`; or two conditions joined by `and` refer to the same
    selection.
    """
    if uses(tree, "min"):
        return True
    subjects = [arguments(call)[0] for call in calls(tree, "unique")]
    if not all(isinstance(subject, Call) and subject.word.group == "related items" for subject in subjects):
        return True
    return any(
        selections(one) & selections(other)
        for operands in conjunctions(tree)
        for one, other in combinations(operands, 2)
    )


def _has_coreference(tree: Node) -> bool:
    """A condition on one item refers to the item of an enclosing condition."""
    return any(
        parameter in free_variables(inner)
        for parameter, body in item_conditions(tree)
        for inner in walk(body)
        if isinstance(inner, Lambda) and inner.parameter != parameter
    )


# Syntactic phenomena: each word is tagged with a letter for its part of speech, and regular expressions over the
# letters look for phrases with two possible attachment sites. There is no parser: words outside these lists end every
# phrase.
_SHAPE_NOUNS = ("circle", "square", "triangle", "block", "tower", "stack", "box", "item", "object", "shape")
_PART_NOUNS = ("base", "top", "bottom", "roof", "middle", "side", "wall", "edge", "corner", "line", "position")
_MEASURES = ("color", "colour", "size", "height")
_PLURALS = {"box": "boxes"}
_SINGULARS = (*_SHAPE_NOUNS, *_PART_NOUNS, *_MEASURES)
_WORDS: dict[str, Sequence[str]] = {
    "n": (*_SINGULARS, *(_PLURALS.get(noun, f"{noun}s") for noun in _SINGULARS), "it", "them", "ones"),
    "a": (
        *("yellow", "black", "blue", "grey", "small", "medium", "big", "large"),
        *("same", "different", "single", "first", "second", "third", "left", "right"),
    ),
    "d": (
        *("a", "an", "the", "all", "each", "every", "any", "some", "no", "both", "another", "other", "its", "their"),
        *("exactly", "only", "just", "atleast", "atmost", "more", "less", "fewer", "than", "many", "multiple", "not"),
    ),
    "p": (
        *("with", "without", "at", "on", "in", "inside", "above", "below", "over", "under", "underneath", "beneath"),
        *("as", "near", "between", "from", "by", "beside", "behind"),
    ),
    "o": ("of",),
    "c": ("and", "or"),
    "m": ("touching", "having", "containing", "stacked", "attached", "which", "that", "whose"),
    "v": ("is", "are", "has", "have", "contains", "contain"),
}
_TAGS = {word: tag for tag, words in _WORDS.items() for word in words}
_OTHER = "x"
_LIMITS = {"at": ("least", "most"), "more": ("than",), "less": ("than",), "fewer": ("than",)}

_NOUN_PHRASE = "[da]*n"
_PREPOSITIONAL = re.compile(rf"n[po]{_NOUN_PHRASE}(?:c{_NOUN_PHRASE})*p{_NOUN_PHRASE}")
_COORDINATION = (
    re.compile(rf"np(?:{_NOUN_PHRASE})+c[da]+n(?!v)"),  # a corner with two triangles and a square
    re.compile(rf"{_NOUN_PHRASE}c{_NOUN_PHRASE}[pm]"),  # a triangle and a square near the wall
    re.compile(r"ancn(?!v)"),  # small triangles and squares
)


def _has_ambiguous_coordination(statement: str) -> bool:
    """`and` or `or` joins a noun phrase to one inside a prepositional phrase after another noun; or the second of two
    joined noun phrases is followed by a modifier (a preposition, `touching`, `which`, ...); or only the first of two
    joined nouns is preceded by an adjective.
    """
    tags = _tagged(statement)
    return any(pattern.search(tags) for pattern in _COORDINATION)


def _has_ambiguous_preposition(statement: str) -> bool:
    """A noun is followed by a prepositional phrase (including `of`) and another one (except `of`)."""
    return _PREPOSITIONAL.search(_tagged(statement)) is not None


def _tagged(statement: str) -> str:
    """One part-of-speech letter per word; "at least" and the like are one determiner."""
    words = plain_words(statement)
    tags: list[str] = []
    for index, word in enumerate(words):
        following = words[index + 1] if index + 1 < len(words) else ""
        if word in ("least", "most") and index and words[index - 1] == "at":
            continue
        tags.append("d" if word.isdigit() or following in _LIMITS.get(word, ()) else _TAGS.get(word, _OTHER))
    return "".join(tags)


RULES: Mapping[Phenomenon, Callable[[Node], bool]] = {
    Phenomenon.EXISTENCE: _has_existence,
    Phenomenon.EXACT_CARDINALITY: _has_exact_cardinality,
    Phenomenon.SOFT_CARDINALITY: _has_soft_cardinality,
    Phenomenon.UNIVERSAL: _has_universal,
    Phenomenon.COORDINATION: _has_coordination,
    Phenomenon.NEGATION: _has_negation,
    Phenomenon.COMPARISON: _has_comparison,
    Phenomenon.SPATIAL_RELATION: _has_spatial_relation,
    Phenomenon.PRESUPPOSITION: _has_presupposition,
    Phenomenon.COREFERENCE: _has_coreference,
}
SYNTAX_RULES: Mapping[SyntacticPhenomenon, Callable[[str], bool]] = {
    SyntacticPhenomenon.COORDINATION: _has_ambiguous_coordination,
    SyntacticPhenomenon.PREPOSITION: _has_ambiguous_preposition,
}


@lru_cache(maxsize=CACHE_SIZE)
def phenomena(program: str) -> frozenset[Phenomenon]:
    """The semantic phenomena of a program, by RULES. Raises ProgramError for an invalid program."""
    tree = parse(program)
    return frozenset(phenomenon for phenomenon, rule in RULES.items() if rule(tree))


@lru_cache(maxsize=CACHE_SIZE)
def syntactic_phenomena(statement: str) -> frozenset[SyntacticPhenomenon]:
    """The syntactic phenomena of a statement, by SYNTAX_RULES."""
    return frozenset(phenomenon for phenomenon, rule in SYNTAX_RULES.items() if rule(statement))


# Queries on syntax trees: counts, comparisons, selections, conjunctions


def word_name(node: Node) -> str | None:
    """The name of the word that the node calls or refers to."""
    return node.word.name if isinstance(node, Call | WordName) else None


def word_names(tree: Node) -> set[str]:
    """The names of all words that the tree uses."""
    return {name for node in walk(tree) if (name := word_name(node)) is not None}


def uses(tree: Node, *names: str) -> bool:
    return any(word_name(node) in names for node in walk(tree))


def calls(tree: Node, *names: str) -> Iterator[Call]:
    """The calls of words of those names."""
    return (node for node in walk(tree) if isinstance(node, Call) and node.word.name in names)


def arguments(node: Node) -> tuple[Node, ...]:
    """The explicit arguments of a call; empty for other nodes."""
    return tuple(children(node)) if isinstance(node, Call) else ()


def comparisons(tree: Node) -> Iterator[tuple[Node, str, Node]]:
    """Left side, operator and right side of every comparison, written with an operator or a word.

    A constant operand is moved to the right.
    """
    for node in walk(tree):
        if isinstance(node, Comparison):
            lefts = (node.left, *node.rights)
            found = list(zip(lefts, node.operators, node.rights, strict=False))
        elif isinstance(node, Call) and node.word.group == "comparison":
            left, right = arguments(node)
            found = [(left, _OPERATOR_OF_WORD.get(node.word.name, "=="), right)]
        else:
            continue
        for left, operator, right in found:
            if isinstance(left, Constant) and not isinstance(right, Constant):
                yield right, MIRRORED.get(operator, operator), left
            else:
                yield left, operator, right


def literal_int(node: Node) -> int | None:
    return node.value if isinstance(node, Constant) and type(node.value) is int else None


def is_literal(node: Node) -> bool:
    """Whether the node is a constant, or a list or set of constants."""
    return all(isinstance(part, Constant | Display) for part in walk(node))


def counted_set(node: Node) -> Node | None:
    """The set whose elements the node counts."""
    return arguments(node)[0] if word_name(node) in _COUNTING and arguments(node) else None


def is_count(node: Node) -> bool:
    """Whether the node is a count, or a sum or remainder with a count as an operand."""
    parts = (node.left, node.right) if isinstance(node, Arithmetic) else (node,)
    return any(counted_set(part) is not None for part in parts)


def selection_sources(node: Node) -> Iterator[Node]:
    """The set that the node selects from, followed by the set that one was selected from, and so on."""
    while word_name(node) in FILTERING and arguments(node):
        node = arguments(node)[0]
        yield node


def structure_key(node: Node, bound: tuple[str, ...] = ()) -> tuple[object, ...]:
    """A key that is equal for alpha-equivalent expressions (up to renaming of bound variables)."""
    match node:
        case Variable(name=name):
            return ("bound", bound.index(name)) if name in bound else ("free", name)
        case Lambda(parameter=parameter, body=body):
            return "lambda", structure_key(body, (parameter, *bound))
        case Constant(value=value):
            return "constant", repr(value)
        case SceneName(name=name):
            return "scene", name
        case Member(of=of, name=name):
            return name, structure_key(of, bound)
        case Comparison(operators=names):
            own: tuple[object, ...] = names
        case Logic(operator=name) | Arithmetic(operator=name):
            own = (name,)
        case Display(kind=kind):
            own = (kind.__name__,)
        case _:
            own = (word_name(node),)
    return type(node).__name__, *own, *(structure_key(child, bound) for child in children(node))


def conjuncts(node: Node) -> Iterator[Node]:
    """The operands of an `and`, with nested `and`s flattened; the node itself if it is not an `and`."""
    if (isinstance(node, Logic) and node.operator == "and") or (word_name(node) == "AND" and isinstance(node, Call)):
        for operand in children(node):
            yield from conjuncts(operand)
    else:
        yield node


def conjunctions(tree: Node) -> Iterator[list[Node]]:
    """The operands of every `and` in the tree."""
    for node in walk(tree):
        operands = list(conjuncts(node))
        if len(operands) > 1:
            yield operands


def counts_values(node: Node) -> bool:
    """Whether the node counts colours, shapes or sizes."""
    counted = counted_set(node)
    return counted is not None and word_name(counted) in _VALUE_SETS


def selections(tree: Node) -> set[tuple[object, ...]]:
    """Keys of the sets that the tree selects, without those that depend on variables bound in the tree."""
    bound_inside = {node.parameter for node in walk(tree) if isinstance(node, Lambda)}
    return {
        structure_key(node)
        for node in walk(tree)
        if any(selection_sources(node)) and not bound_inside & free_variables(node)
    }


def item_conditions(tree: Node) -> Iterator[tuple[str, Node]]:
    """Parameter and body of every lambda applied to a set other than the boxes."""
    for node in walk(tree):
        match arguments(node):
            case (collection, Lambda(parameter=parameter, body=body)):
                origins = (collection, *selection_sources(collection))
                if not any(isinstance(origin, SceneName) and origin.name == "all_boxes" for origin in origins):
                    yield parameter, body
            case _:
                continue
