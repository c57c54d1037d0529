"""Linguistic phenomena of statements: semantic ones detected in the program, syntactic ones in the wording.

The categories are those of the lilGym and NLVR papers (Suhr et al. 2017; Wu et al. 2023), whose authors annotated
statements by hand. Here, rules over the program detect the semantic phenomena, and rules over the words the syntactic
ones. Each rule is described by its docstring, as docs/official_data.md lists them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import lru_cache
from itertools import combinations
from typing import Any

from lilgym_mp.corpus.spelling import plain_words
from lilgym_mp.programs.canonical import named_by_depth
from lilgym_mp.programs.syntax import (
    Arithmetic,
    Call,
    Comparison,
    Constant,
    Display,
    Lambda,
    Logic,
    Node,
    Not,
    SceneName,
    WordName,
    children,
    free_variables,
    parse,
    walk,
    word_names,
)
from lilgym_mp.scene import BOX_COUNT

CACHE_SIZE = 8_192  # cached programs and statements
_MIRRORED = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}
_FILTERS = ("filter_obj", "filter_color", "filter_shape", "filter_size")
_VALUE_SETS = ("get_set_{}s", "query_{}")  # forms of words
_SELECTIONS = (*_FILTERS, "All", "Any", "contained", "member_of", "equal_set")
_SAMENESS = ("all_same", "all_same_color", "all_same_shape", "all_same_size", "all_same_attribute")
_LEVELS = ("is_top", "is_bottom", "is_second", "is_third")
_MEMBERSHIP = ("get_box_inclusive", "get_box_exclusive", "get_img_exclusive")  # relations that are not spatial


def shows_phenomenon(name: str, task: Any) -> bool:
    """Whether `program` or `statement` of a task or an episode shows the phenomenon, one of PHENOMENA."""
    return name in phenomena(task.program) or name in syntactic_phenomena(task.statement)


@lru_cache(maxsize=CACHE_SIZE)
def phenomena(program: str) -> frozenset[str]:
    """The semantic phenomena of a program, by RULES. Raises ProgramError for an invalid program."""
    tree = parse(program)
    return frozenset(name for name, shows in RULES.items() if shows(tree))


@lru_cache(maxsize=CACHE_SIZE)
def syntactic_phenomena(statement: str) -> frozenset[str]:
    """The syntactic phenomena of a statement, by SYNTAX_RULES."""
    return frozenset(name for name, shows in SYNTAX_RULES.items() if shows(statement))


def existence(tree: Node) -> bool:
    """`exist` or `Any`."""
    return _uses(tree, "exist", "Any")


def exact_cardinality(tree: Node) -> bool:
    """`==` or `!=` compares a count with a number of at least 1 (2 for a count of colours, shapes or sizes)."""
    return any(
        operator in ("==", "!=") and _is_count(left) and (_integer(right) or 0) > _counts_values(left)
        for left, operator, right in _comparisons(tree)
    )


def soft_cardinality(tree: Node) -> bool:
    """`<`, `<=`, `>` or `>=` compares a count with a number, except when it states that the count is zero."""
    return any(
        operator in _MIRRORED
        and _is_count(left)
        and _integer(right) is not None
        and not _says_none(left, operator, right)
        for left, operator, right in _comparisons(tree)
    )


def universal(tree: Node) -> bool:
    """`All`, `all`, `equal_set`, or `contained` for a set that depends on the scene; or a selection, or its count, is
    compared with the set it was selected from; or `==` or `>=` compares the number of boxes with a property with 3.
    """
    return (
        _uses(tree, "All", "all", "equal_set")
        or any(not _is_literal(_arguments(call)[0]) for call in _calls(tree, "contained"))
        or any(
            _selects_whole(left, right)
            or (_integer(right) == BOX_COUNT and operator in ("==", ">=") and _has_boxes(_sources(_counted_set(left))))
            for left, operator, right in _comparisons(tree)
        )
    )


def coordination(tree: Node) -> bool:
    """`or`, `union`, or a list or set of several literal values; or `and` joins conditions, at least two of which
    select items or boxes (a filter, `All`, `Any`, ...).
    """
    return (
        _uses(tree, "OR", "union", "union_all")
        or any(
            (isinstance(node, Logic) and node.operator == "or")
            or (isinstance(node, Display) and len(node.elements) > 1 and _is_literal(node))
            for node in walk(tree)
        )
        or any(sum(_uses(operand, *_SELECTIONS) for operand in operands) > 1 for operands in _conjunctions(tree))
    )


def negation(tree: Node) -> bool:
    """`not`, `!=`, `not in`, a comparison with False, or a comparison stating that a count is zero."""
    return (
        _uses(tree, "NOT")
        or any(isinstance(node, Not) for node in walk(tree))
        or any(
            operator in ("!=", "not in")
            or _says_none(left, operator, right)
            or (isinstance(right, Constant) and right.value is False)
            for left, operator, right in _comparisons(tree)
        )
    )


def comparison(tree: Node) -> bool:
    """Two values that both depend on the scene are compared (except a selection with its source); or the number of
    distinct colours, shapes or sizes is compared; or an `all_same` word or `min`.
    """
    return _uses(tree, "min", *_SAMENESS) or any(
        _counts_values(left) if _is_literal(right) else not (_is_literal(left) or _selects_whole(left, right))
        for left, operator, right in _comparisons(tree)
        if operator not in ("in", "not in")
    )


def spatial_relation(tree: Node) -> bool:
    """A word about walls, corners, touching, above or below, or the level in a tower (`is_top`, `is_second`, ...)."""
    return any(
        node.word.name in _LEVELS
        or (node.word.group in ("walls", "two items", "related items") and node.word.name not in _MEMBERSHIP)
        for node in walk(tree)
        if isinstance(node, Call | WordName)
    )


def presupposition(tree: Node) -> bool:
    """`unique` of anything but an item's neighbours, or `min`; or two conditions joined by `and` refer to the same
    selection.
    """
    subjects = (_arguments(call)[0] for call in _calls(tree, "unique"))
    return (
        _uses(tree, "min")
        or any(not (isinstance(each, Call) and each.word.group == "related items") for each in subjects)
        or any(
            _selections(one) & _selections(other)
            for operands in _conjunctions(tree)
            for one, other in combinations(operands, 2)
        )
    )


def coreference(tree: Node) -> bool:
    """A condition on one item refers to the item of an enclosing condition."""
    for node in walk(tree):
        match _arguments(node):
            case (collection, Lambda(name, body)) if not _has_boxes((collection, *_sources(collection))):
                inner = (each for each in walk(body) if isinstance(each, Lambda) and each.parameter != name)
                if any(name in free_variables(each) for each in inner):
                    return True
            case _:
                continue
    return False


# Queries on syntax trees: comparisons, counts, selections, conjunctions


def _uses(tree: Node, *names: str) -> bool:
    return not word_names(tree).isdisjoint(names)


def _calls(tree: Node, *names: str) -> Iterator[Call]:
    """The calls of words of those names."""
    return (node for node in walk(tree) if isinstance(node, Call) and node.word.name in names)


def _arguments(node: Node) -> tuple[Node, ...]:
    """The explicit arguments of a call; empty for other nodes."""
    return tuple(children(node)) if isinstance(node, Call) else ()


def _argument_of(node: Node | None, *names: str) -> Node | None:
    """The first argument if the node calls a word of those names."""
    if isinstance(node, Call) and node.word.name in names:
        return next(children(node), None)
    return None


def _comparisons(tree: Node) -> Iterator[tuple[Node, str, Node]]:
    """Left side, operator and right side of every comparison, written with an operator or a word.

    A constant operand is moved to the right.
    """
    for node in walk(tree):
        found: list[tuple[Node, str, Node]] = []
        if isinstance(node, Comparison):
            found = list(zip((node.left, *node.rights), node.operators, node.rights, strict=False))
        elif isinstance(node, Call) and node.word.group == "comparison":
            left, right = _arguments(node)
            found = [(left, node.word.operator or "==", right)]
        for left, operator, right in found:
            if isinstance(left, Constant) and not isinstance(right, Constant):
                yield right, _MIRRORED.get(operator, operator), left
            else:
                yield left, operator, right


def _integer(node: Node) -> int | None:
    return node.value if isinstance(node, Constant) and type(node.value) is int else None


def _is_literal(node: Node) -> bool:
    """Whether the node is a constant, or a list or set of constants."""
    return all(isinstance(part, Constant | Display) for part in walk(node))


def _counted_set(node: Node) -> Node | None:
    """The set whose elements the node counts."""
    return _argument_of(node, "count", "len")


def _is_count(node: Node) -> bool:
    """Whether the node is a count, or a sum or remainder with a count as an operand."""
    parts = (node.left, node.right) if isinstance(node, Arithmetic) else (node,)
    return any(_counted_set(part) is not None for part in parts)


def _counts_values(node: Node) -> bool:
    """Whether the node counts colours, shapes or sizes."""
    counted = _counted_set(node)
    return isinstance(counted, Call | WordName) and counted.word.form in _VALUE_SETS


def _says_none(left: Node, operator: str, right: Node) -> bool:
    """Whether the comparison states that a count is zero."""
    return _is_count(left) and (operator, _integer(right)) in (("==", 0), ("<=", 0), ("<", 1))


def _sources(node: Node | None) -> Iterator[Node]:
    """The set that the node selects from, followed by the set that one was selected from, and so on."""
    while (node := _argument_of(node, *_FILTERS)) is not None:
        yield node


def _has_boxes(nodes: Iterable[Node]) -> bool:
    """Whether one of the nodes is the collection of all boxes."""
    return any(isinstance(node, SceneName) and node.name == "all_boxes" for node in nodes)


def _selects_whole(left: Node, right: Node) -> bool:
    """Whether one side is a selection from the other; also for their counts."""
    left = _counted_set(left) or left
    right = _counted_set(right) or right
    return any(
        _renamed(source) == _renamed(whole)
        for part, whole in ((left, right), (right, left))
        for source in _sources(part)
    )


def _selections(tree: Node) -> set[Node]:
    """The sets that the tree selects, without those that depend on variables bound in the tree."""
    bound_inside = {node.parameter for node in walk(tree) if isinstance(node, Lambda)}
    return {_renamed(node) for node in walk(tree) if any(_sources(node)) and not bound_inside & free_variables(node)}


def _renamed(node: Node) -> Node:
    """The node with bound variables named by depth: equal for expressions that differ in these names alone."""
    return named_by_depth(node, "${}".format, {}, 0)


def _conjunctions(tree: Node) -> Iterator[list[Node]]:
    """The operands of every `and` in the tree."""
    for node in walk(tree):
        operands = list(_conjuncts(node))
        if len(operands) > 1:
            yield operands


def _conjuncts(node: Node) -> Iterator[Node]:
    """The operands of an `and`, with nested `and`s flattened; the node itself if it is not an `and`."""
    if (isinstance(node, Logic) and node.operator == "and") or (isinstance(node, Call) and node.word.operator == "and"):
        for operand in children(node):
            yield from _conjuncts(operand)
    else:
        yield node


# Syntactic phenomena: each word is tagged with a letter for its part of speech, and regular expressions over the
# letters look for phrases with two possible attachment sites. There is no parser: words outside these lists end every
# phrase.
_NOUNS = (
    "circle square triangle block tower stack item object shape base top bottom roof middle side wall edge corner line"
    " position color colour size height"
)
_WORDS = {
    "n": f"{_NOUNS} {_NOUNS.replace(' ', 's ')}s box boxes it them ones",
    "a": "yellow black blue grey small medium big large same different single first second third left right",
    "d": "a an the all each every any some no both another other its their exactly only just atleast atmost more less"
    " fewer than many multiple not",
    "p": "with without at on in inside above below over under underneath beneath as near between from by beside behind",
    "o": "of",
    "c": "and or",
    "m": "touching having containing stacked attached which that whose",
    "v": "is are has have contains contain",
}
_TAGS = {word: tag for tag, words in _WORDS.items() for word in words.split()}
_OTHER = "x"
_LIMITS = {"at": ("least", "most"), "more": ("than",), "less": ("than",), "fewer": ("than",)}

_NOUN_PHRASE = "[da]*n"
_PREPOSITIONAL = re.compile(rf"n[po]{_NOUN_PHRASE}(?:c{_NOUN_PHRASE})*p{_NOUN_PHRASE}")
_COORDINATION = (
    re.compile(rf"np(?:{_NOUN_PHRASE})+c[da]+n(?!v)"),  # a corner with two triangles and a square
    re.compile(rf"{_NOUN_PHRASE}c{_NOUN_PHRASE}[pm]"),  # a triangle and a square near the wall
    re.compile(r"ancn(?!v)"),  # small triangles and squares
)


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


def ambiguous_coordination(statement: str) -> bool:
    """`and` or `or` joins a noun phrase to one inside a prepositional phrase after another noun; or the second of two
    joined noun phrases is followed by a modifier (a preposition, `touching`, `which`, ...); or only the first of two
    joined nouns is preceded by an adjective.
    """
    tags = _tagged(statement)
    return any(pattern.search(tags) for pattern in _COORDINATION)


def ambiguous_preposition(statement: str) -> bool:
    """A noun is followed by a prepositional phrase (including `of`) and another one (except `of`)."""
    return _PREPOSITIONAL.search(_tagged(statement)) is not None


RULES: Mapping[str, Callable[[Node], bool]] = {
    rule.__name__.replace("_", " "): rule
    for rule in (
        existence,
        exact_cardinality,
        soft_cardinality,
        universal,
        coordination,
        negation,
        comparison,
        spatial_relation,
        presupposition,
        coreference,
    )
}
"""For each semantic phenomenon, whether the syntax tree of a program shows it."""
SYNTAX_RULES: Mapping[str, Callable[[str], bool]] = {
    "syntax: coordination": ambiguous_coordination,
    "syntax: prepositional attachment": ambiguous_preposition,
}
"""For each syntactic phenomenon, an ambiguous attachment, whether a statement shows it."""
PHENOMENA = (*RULES, *SYNTAX_RULES)
