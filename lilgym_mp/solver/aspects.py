"""What a program looks at: the questions about single items on which its truth hangs.

A program that asks of items only what each is by itself (its look, its walls) cannot tell two scenes apart whose
boxes hold items with the same answers. Such programs are solved on those answers, before any geometry.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from typing import cast

import numpy as np

from lilgym_mp.arrays import BoolArray, Int64Array
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
    children,
)
from lilgym_mp.programs.values import BoxView, ItemView, Side
from lilgym_mp.programs.words import Word
from lilgym_mp.scene import Box, Item
from lilgym_mp.solver.item_samples import every_item, sample_number

ATTRIBUTES = {"color": "colour", "shape": "shape", "size": "size"}  # the language's word: the field of Item
LOGIC_WORDS: dict[str, Callable[..., BoolArray]] = {"AND": np.logical_and, "OR": np.logical_or, "NOT": np.logical_not}
BLIND_GROUPS = ("sets", "comparison", "logic", "built-ins")  # of words that handle items without looking at them
KEPT_QUESTIONS = 4_096
KEPT_TREES = 4_096


@dataclass(frozen=True, slots=True, eq=False)
class Question:
    """A test of one item by itself. It is equal to itself alone; the same test is the same object."""

    codes: Int64Array  # (1323,) what it says of each sample of `item_samples`, as a number

    def __call__(self, item: Item) -> int:
        return int(self.codes[sample_number(item)])


@dataclass(frozen=True, slots=True)
class Aspects:
    """What a program asks of an item by itself, and what else matters to it."""

    questions: tuple[Question, ...]
    ordered: bool  # the order of a box's items may matter
    relations: tuple[Word, ...]  # words for what items are to each other
    towers: bool  # it asks whether a box is a tower

    @property
    def relational(self) -> bool:
        """Whether the answers do not settle the program's truth."""
        return self.towers or bool(self.relations)


@lru_cache(maxsize=KEPT_TREES)
def aspects(tree: Node) -> Aspects:
    """What the program with this tree looks at; in doubt, more than it does."""
    found = dict.fromkeys(_aspects(tree))
    return Aspects(
        questions=tuple(aspect for aspect in found if not isinstance(aspect, Word | _Concern)),
        ordered=_Concern.ORDER in found,
        relations=tuple(aspect for aspect in found if isinstance(aspect, Word)),
        towers=_Concern.TOWERS in found,
    )


def joined(seen: Sequence[Aspects]) -> Aspects:
    """What several programs together look at."""
    return Aspects(
        questions=tuple(dict.fromkeys(question for one in seen for question in one.questions)),
        ordered=any(one.ordered for one in seen),
        relations=tuple(dict.fromkeys(word for one in seen for word in one.relations)),
        towers=any(one.towers for one in seen),
    )


class _Concern(Enum):
    """What matters to a program beside questions and relations."""

    ORDER = "the order of items"
    TOWERS = "whether a box is a tower"


_Aspect = Question | Word | _Concern


def _aspects(node: Node) -> Iterator[_Aspect]:
    """Everything in the tree that matters, again and again perhaps."""
    predicate = _as_predicate(node)
    if predicate is not None:
        yield _truth_of(predicate)
        return
    match node:
        case Call(word=word) | WordName(word=word):
            yield from _aspects_of_word(word, node)
        case Member(name=name) if name in ATTRIBUTES:
            yield _attribute(name)
        case Member(name="is_tower"):
            yield _Concern.TOWERS
        case Subscript(of=of) | Slice(of=of) if of != SceneName("all_boxes"):
            yield _Concern.ORDER
        case Arithmetic(operator="+", left=left, right=right) if not (_is_number(left) and _is_number(right)):
            yield _Concern.ORDER
        case _:
            pass
    for child in children(node):
        yield from _aspects(child)


def _aspects_of_word(word: Word, node: Call | WordName) -> Iterator[_Aspect]:
    attribute = next((name for name in ATTRIBUTES if name in word.name), None)
    if word.group == "attributes" and attribute is not None:
        value = node.arguments[1] if isinstance(node, Call) and word.name.startswith("filter") else None
        yield _has(attribute, cast("Enum", value.value)) if isinstance(value, Constant) else _attribute(attribute)
        if word.name.startswith("query"):
            yield _Concern.ORDER
    elif isinstance(node, Call) and _is_question(word) and _sides_known(node):
        yield _truth_of(Call(word, (Variable("x"), *node.arguments[1:])))
    elif word.group != "attributes" and word.group not in BLIND_GROUPS:
        yield word
    if word.name == "min":
        yield _Concern.ORDER


def _is_number(node: Node) -> bool:
    match node:
        case Constant() | Arithmetic():
            return True
        case Call(word=word):
            return word.result == "int"
        case _:
            return False


def _as_predicate(node: Node) -> Node | None:
    """The node as a truth about the variable x, when it is one about one item by itself; else None."""
    match node:
        case WordName(word=word) if _is_question(word) and all(p.optional for p in word.parameters[1:]):
            return Call(word, (Variable("x"), *(None for _ in word.parameters[1:])))
        case Call() | Logic() | Not() if len(names := set(_asked_about(node))) == 1 and None not in names:
            return _renamed(node)
        case _:
            return None


def _asked_about(node: Node) -> Iterator[str | None]:
    """The variables that a combination of questions asks about; None among them where it is none."""
    match node:
        case Call(word=word, arguments=(Variable(name=name), *_)) if _is_question(word):
            yield name if _sides_known(node) else None
        case Logic() | Not():
            for child in children(node):
                yield from _asked_about(child)
        case Call(word=word) if word.name in LOGIC_WORDS:
            for child in children(node):
                yield from _asked_about(child)
        case _:
            yield None


def _sides_known(call: Call) -> bool:
    sides = call.arguments[1:]
    return all(side is None or (isinstance(side, Constant) and isinstance(side.value, Side)) for side in sides)


def _is_question(word: Word) -> bool:
    """Whether a word is a truth about one item by itself, with sides at most as further arguments."""
    kinds = [parameter.type.name for parameter in word.parameters]
    alone = kinds[:1] == ["item"] and set(kinds[1:]) <= {"Side"}
    return alone and word.result == "bool" and word.depends_on_item_only


def _renamed(node: Node) -> Node:
    match node:
        case Variable():
            return Variable("x")
        case Call(word=word, arguments=arguments):
            return Call(word, tuple(argument and _renamed(argument) for argument in arguments))
        case Logic(operator=operator, operands=operands):
            return Logic(operator, tuple(map(_renamed, operands)))
        case Not(operand=operand):
            return Not(_renamed(operand))
        case _:
            return node


@lru_cache(maxsize=KEPT_QUESTIONS)
def _truth_of(predicate: Node) -> Question:
    """Whether the truth about x holds for an item; the same question for the same truth."""
    return Question(_truths(predicate).astype(np.int64))


def _truths(predicate: Node) -> BoolArray:
    """(1323,) what the truth about x says of each sample."""
    match predicate:
        case Not(operand=operand):
            return ~_truths(operand)
        case Logic(operator=operator, operands=operands):
            combine = np.logical_and if operator == "and" else np.logical_or
            return combine.reduce([_truths(operand) for operand in operands])
        case Call(word=word, arguments=(_, *sides)) if _is_question(word):
            return _word_truths(word, tuple(map(_side, sides)))
        case Call(word=word, arguments=arguments):
            operands = [_truths(argument) for argument in arguments if argument is not None]
            return LOGIC_WORDS[word.name](*operands)
        case _:
            raise AssertionError(f"{predicate} is no truth about one item")


def _side(node: Node | None) -> Side | None:
    return cast("Side", node.value) if isinstance(node, Constant) else None


@lru_cache(maxsize=KEPT_QUESTIONS)
def _word_truths(word: Word, sides: tuple[Side | None, ...]) -> BoolArray:
    """(1323,) what a word that tests one item says of each sample; None is a side that is not given."""
    defaults = [parameter.default for parameter in word.parameters[1:]]
    known = [default if side is None else side for side, default in zip(sides, defaults, strict=True)]
    nowhere = BoxView(Box())
    return np.array([word.function(ItemView(item, nowhere, 0), *known) for item in every_item()])


@lru_cache
def _attribute(name: str) -> Question:
    return Question(_field_of_samples(name))


@lru_cache
def _has(name: str, value: Enum) -> Question:
    return Question((_field_of_samples(name) == value.value).astype(np.int64))


def _field_of_samples(name: str) -> Int64Array:
    field = Item._fields.index(ATTRIBUTES[name])
    return np.array([item[field] for item in every_item()])
