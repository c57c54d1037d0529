"""Static analysis of programs: the features of items, boxes and scenes on which a program's value depends.

Many programs test items one by one, for attributes or walls, and nothing else. Such a program cannot distinguish two
scenes whose boxes contain items with equal feature values, so it can be solved on those values alone, before any
geometry is considered.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from typing import cast

import numpy as np

from lilgym_mp.programs import syntax
from lilgym_mp.programs.canonical import ATTRIBUTE_TESTS
from lilgym_mp.programs.syntax import (
    Arithmetic,
    Call,
    Constant,
    Logic,
    Member,
    Node,
    Not,
    SceneName,
    Slice,
    Subscript,
    Variable,
    WordName,
    as_lambda,
    children,
    with_children,
)
from lilgym_mp.programs.values import BoxView, ItemView, Side
from lilgym_mp.programs.words import WORDS, Word
from lilgym_mp.scene import Box
from lilgym_mp.scene.arrays import BoolArray, Int64Array
from lilgym_mp.solver.canonical_items import canonical_items

ATTRIBUTES = {"color": "colour", "shape": "shape", "size": "size"}  # the language's name: the field of Item
LOGIC: Mapping[str, Callable[[list[BoolArray]], BoolArray]] = {
    "and": np.logical_and.reduce,
    "or": np.logical_or.reduce,
    "not": lambda values: ~values[0],
}
FEATURE_CACHE_SIZE = 4_096


@dataclass(frozen=True, slots=True, eq=False)
class ItemFeature:
    """A function of a single item. Compared by identity: equal features are the same cached object."""

    values: Int64Array  # (1323,) its value, as an integer code, for each canonical item


@dataclass(frozen=True, slots=True)
class ProgramFeatures:
    """Everything on which a program's value can depend."""

    item_features: tuple[ItemFeature, ...]
    order_matters: bool  # whether the value may depend on the order of a box's items
    relations: tuple[Word, ...]  # words that relate items to other items
    tests_towers: bool  # whether the program tests if a box is a tower

    @property
    def relational(self) -> bool:
        """Whether item features alone do not determine the program's value."""
        return self.tests_towers or bool(self.relations)


def program_features(*trees: Node) -> ProgramFeatures:
    """The features of the programs with these syntax trees. Conservative: it may include some that do not matter."""
    found = dict.fromkeys(feature for tree in trees for feature in _features(tree))
    return ProgramFeatures(
        item_features=tuple(feature for feature in found if not isinstance(feature, Word | _BoxFeature)),
        order_matters=_BoxFeature.ORDER in found,
        relations=tuple(feature for feature in found if isinstance(feature, Word)),
        tests_towers=_BoxFeature.TOWER in found,
    )


class _BoxFeature(Enum):
    ORDER = "the order of items"
    TOWER = "whether a box is a tower"


_Feature = ItemFeature | Word | _BoxFeature


def _features(node: Node) -> Iterator[_Feature]:
    """Every feature in the tree, with repetitions."""
    predicate = _as_predicate(node)
    if predicate is not None:
        yield _predicate_feature(predicate)
        return
    match node:
        case Call(word=word) | WordName(word=word):
            yield from _word_features(word, node)
        case Member(name=name) if name in ATTRIBUTES:
            yield _attribute_feature(name)
        case Member(name="is_tower"):
            yield _BoxFeature.TOWER
        case Subscript(of=of) | Slice(of=of) if of != SceneName("all_boxes"):
            yield _BoxFeature.ORDER
        case Arithmetic(operator="+", left=left, right=right) if not (_is_number(left) and _is_number(right)):
            yield _BoxFeature.ORDER
        case _:
            pass
    for child in children(node):
        yield from _features(child)


def _word_features(word: Word, node: Call | WordName) -> Iterator[_Feature]:
    if word.reads_order:
        yield _BoxFeature.ORDER
    if word.group == "attributes" and word.attribute:
        match node:
            case Call(arguments=(_, Constant(value=Enum() as value))) if value in ATTRIBUTE_TESTS:
                yield _predicate_feature(syntax.call(WORDS[ATTRIBUTE_TESTS[value]], Variable("x")))
            case _:
                yield _attribute_feature(word.attribute)
    elif isinstance(node, Call) and _is_item_test(word) and _has_constant_sides(node):
        yield _predicate_feature(Call(word, (Variable("x"), *node.arguments[1:])))
    elif word.may_read_positions:
        yield word


def _is_number(node: Node) -> bool:
    match node:
        case Constant() | Arithmetic():
            return True
        case Call(word=word):
            return word.result == "int"
        case _:
            return False


# Predicates on one item


def _as_predicate(node: Node) -> Node | None:
    """The node as a predicate on the variable x, if it combines tests of one and the same item; else None."""
    if isinstance(node, WordName) and (function := as_lambda(node, "x")):
        node = function.body
    names = set(_tested_variables(node))
    return _renamed(node) if len(names) == 1 and None not in names else None


def _tested_variables(node: Node) -> Iterator[str | None]:
    """The variables tested in a logical combination of item tests; None for any part that is not an item test."""
    match node:
        case Call(word=word, arguments=(Variable(name=name), *_)) if _is_item_test(word):
            yield name if _has_constant_sides(node) else None
        case Logic() | Not() | Call(word=Word(operator="and" | "or" | "not")):
            for child in children(node):
                yield from _tested_variables(child)
        case _:
            yield None


def _has_constant_sides(call: Call) -> bool:
    sides = call.arguments[1:]
    return all(side is None or (isinstance(side, Constant) and isinstance(side.value, Side)) for side in sides)


def _is_item_test(word: Word) -> bool:
    """Whether the word is a predicate on one item that depends on nothing else but sides given as arguments.

    Canonical items have all distances from walls that this package's words distinguish, not those of extensions.
    """
    known = not word.is_extension or word.depends_on == "attributes"
    return word.is_item_test and word.depends_on_item_only and known


def _renamed(node: Node) -> Node:
    """The node with every variable renamed to x."""
    return Variable("x") if isinstance(node, Variable) else with_children(node, _renamed)


# Features with their values for all canonical items


@lru_cache(maxsize=FEATURE_CACHE_SIZE)
def _predicate_feature(predicate: Node) -> ItemFeature:
    return ItemFeature(_predicate_values(predicate).astype(np.int64))


def _predicate_values(predicate: Node) -> BoolArray:
    """(1323,) the value of a predicate on x for each canonical item."""
    match predicate:
        case Call(word=word, arguments=(_, *sides)) if _is_item_test(word):
            return _item_test_values(word, tuple(map(_side, sides)))
        case Logic(operator=operator) | Call(word=Word(operator=operator)):
            pass
        case _:
            operator = "not"
    return LOGIC[operator](list(map(_predicate_values, children(predicate))))


def _side(node: Node | None) -> Side | None:
    return cast("Side", node.value) if isinstance(node, Constant) else None


@lru_cache(maxsize=FEATURE_CACHE_SIZE)
def _item_test_values(word: Word, sides: tuple[Side | None, ...]) -> BoolArray:
    """(1323,) the value of an item test for each canonical item; None means a side's default."""
    defaults = [parameter.default for parameter in word.parameters[1:]]
    given = [default if side is None else side for side, default in zip(sides, defaults, strict=True)]
    empty = BoxView(Box())
    return np.array([word.function(ItemView(item, empty, 0), *given) for item in canonical_items()])


@lru_cache
def _attribute_feature(name: str) -> ItemFeature:
    return ItemFeature(np.array([getattr(item, ATTRIBUTES[name]) for item in canonical_items()]))
