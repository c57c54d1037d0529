"""What a program looks at: the questions about single items on which its truth hangs.

A program that asks of items only what each is by itself (its look, its walls) cannot tell two scenes apart whose
boxes hold items with the same answers. Such programs are solved on those answers, before any geometry.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from typing import cast

from lilgym_mp.programs.fast import fast_form
from lilgym_mp.programs.lifting import UnsureError
from lilgym_mp.programs.reference import evaluate, reference_form
from lilgym_mp.programs.syntax import (
    Arithmetic,
    Call,
    Constant,
    Lambda,
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
from lilgym_mp.programs.views import Side
from lilgym_mp.programs.words import WORDS, Word
from lilgym_mp.scene import Box, Item, Scene

ATTRIBUTES = {"color": "colour", "shape": "shape", "size": "size"}  # the language's word: the field of Item
LOGIC_WORDS = ("AND", "OR", "NOT")
BLIND_GROUPS = ("sets", "comparison", "logic", "built-ins")  # of words that handle items without looking at them
KEPT_QUESTIONS = 4_096

Question = Callable[[Item], object]


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


def aspects(tree: Node) -> Aspects:
    """What the program with this tree looks at; in doubt, more than it does."""
    found = dict.fromkeys(_aspects(tree))
    return Aspects(
        questions=tuple(aspect for aspect in found if not isinstance(aspect, Word | _Concern)),
        ordered=_Concern.ORDER in found,
        relations=tuple(aspect for aspect in found if isinstance(aspect, Word)),
        towers=_Concern.TOWERS in found,
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
    kinds = [parameter.kind.name for parameter in word.parameters]
    alone = kinds[:1] == ["item"] and set(kinds[1:]) <= {"Side"}
    return alone and word.result == "bool" and word.reach in ("look", "item")


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
    every = SceneName("all_items")
    chosen = Call(WORDS["filter_obj"], (every, Lambda("x", predicate)))
    tree = Call(WORDS["exist"], (chosen,))
    fast, reference = fast_form(tree), reference_form(tree)
    nothing = Box()

    def ask(item: Item) -> bool:
        scene = Scene((Box((item,)), nothing, nothing))
        if fast is not None:
            try:
                return fast(scene)
            except UnsureError:
                pass
        return evaluate(reference, scene)

    return _remembered(ask)


@lru_cache
def _attribute(name: str) -> Question:
    field = Item._fields.index(ATTRIBUTES[name])
    return lambda item: item[field]


@lru_cache
def _has(name: str, value: Enum) -> Question:
    field = Item._fields.index(ATTRIBUTES[name])
    return lambda item: item[field] == value.value


def _remembered(ask: Question) -> Question:
    return lru_cache(maxsize=20_000)(ask)
