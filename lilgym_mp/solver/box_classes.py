"""Equivalence classes of boxes: boxes that are interchangeable for a program.

Most programs are separable: they ask the same few queries of each box, such as whether it is a tower of three, and
combine or count the results. Boxes with equal results, their signature, are interchangeable, and there are only a few
different signatures.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator
from functools import lru_cache

from lilgym_mp.programs import ProgramRuntimeError, compile_program
from lilgym_mp.programs.compiler import generated_truth
from lilgym_mp.programs.errors import FallbackError
from lilgym_mp.programs.reference import Evaluation, build_closure, evaluate
from lilgym_mp.programs.syntax import (
    Call,
    Comparison,
    Constant,
    Display,
    Lambda,
    Node,
    SceneName,
    Subscript,
    WordName,
    children,
    free_variables,
    walk,
)
from lilgym_mp.programs.words import WORDS
from lilgym_mp.scene import Box, Item, Scene

PROGRAM_CACHE_SIZE = 4_096
QUERY_CACHE_SIZE = 4_096
BOXES = SceneName("all_boxes")
ITEMS = SceneName("all_items")
FIRST_BOX = Display(list, (Subscript(BOXES, Constant(0)),))
EMPTY_BOX = Box()

Query = Callable[[Box], Hashable]  # a function of one box


class _NotSeparableError(Exception):
    """The program's value does not depend on queries of single boxes alone."""


@lru_cache(maxsize=PROGRAM_CACHE_SIZE)
def queries_of(program: str) -> tuple[Query, ...] | None:
    """Functions whose equal values mean interchangeable boxes; None if the program is not known to be separable."""
    try:
        return tuple(map(_compiled, dict.fromkeys(_queries(compile_program(program).tree))))
    except _NotSeparableError:
        return None


class BoxClasses:
    """The classes of boxes that are interchangeable for several programs together, indexed in order of discovery.

    If `separable` is false, because some program is not, each box is a class of its own.
    """

    def __init__(self, programs: Iterable[str]) -> None:
        by_program = list(map(queries_of, programs))
        self.separable = None not in by_program
        self.representatives: list[Box] = []  # by class
        self._queries = tuple(dict.fromkeys(query for queries in by_program for query in queries or ()))
        self._by_signature: dict[Hashable, int] = {}
        self._by_box: dict[tuple[Item, ...], int] = {}

    def of(self, box: Box) -> int:
        """The box's class."""
        found = self._by_box.get(box.items)
        if found is None:
            signature = tuple([query(box) for query in self._queries]) if self.separable else box.items
            found = self._by_box[box.items] = self._by_signature.setdefault(signature, len(self.representatives))
            if found == len(self.representatives):
                self.representatives.append(box)
        return found


def _queries(node: Node) -> Iterator[tuple[Node, bool]]:
    """Programs about the first box that determine the node's value, each with whether it is a count.

    Raises _NotSeparableError.
    """
    match node:
        case Call(word=word, arguments=(chain,)) if word.name in ("exist", "count") and chain is not None:
            source, filters = _filters(chain)
            if source == BOXES:
                yield from _filter_queries(filters)
                return
            if source == ITEMS and all(map(_is_box_local, filters)):
                yield Call(WORDS["count"], (chain,)), True
                return
        case Call(word=word, arguments=(chain, function)) if word.name in ("All", "Any") and chain and function:
            source, filters = _filters(chain)
            if source == BOXES and _is_box_local(function):
                yield from _filter_queries(filters)
                yield Call(WORDS["Any"], (FIRST_BOX, function)), False
                return
        case SceneName() | Lambda() | WordName():
            raise _NotSeparableError
        case _:
            pass
    for child in children(node):
        yield from _queries(child)


def _filters(chain: Node) -> tuple[Node, list[Node]]:
    """The innermost argument of a chain of filters, and the functions by which they select, outermost first."""
    match chain:
        case Call(word=word, arguments=(inner, test)) if inner and test and word.name.startswith("filter_"):
            source, tests = _filters(inner)
            return source, [test, *tests]
        case _:
            return chain, []


def _filter_queries(filters: Iterable[Node]) -> Iterator[tuple[Node, bool]]:
    for function in filters:
        if not _is_box_local(function):
            raise _NotSeparableError
        selected = Call(WORDS["filter_obj"], (FIRST_BOX, function))
        yield Call(WORDS["exist"], (selected,)), False


def _is_box_local(function: Node) -> bool:
    """Whether the function's value for a box, or for an item, depends on that box alone."""
    return not free_variables(function) and all(map(_is_local, walk(function)))


def _is_local(node: Node) -> bool:
    match node:
        case SceneName():
            return False
        case Call(word=word) | WordName(word=word):
            return word.depends_on != "scene"
        case _:
            return True


@lru_cache(maxsize=QUERY_CACHE_SIZE)
def _compiled(query: tuple[Node, bool]) -> Query:
    """The query as a function; its result is the program's value for a scene with that box first and two empty boxes,
    or the error message if it raises."""
    tree, is_count = query
    return _count_query(tree) if is_count else _value_query(tree)


def _count_query(count: Node) -> Query:
    """Finds the count by comparisons with 0, 1, 2, ..., since programs have Boolean values."""
    exceeds: list[Query] = []

    def query(box: Box) -> Hashable:
        for number in range(len(box.items)):
            if number == len(exceeds):
                exceeds.append(_value_query(Comparison(count, (">",), (Constant(number),))))
            found = exceeds[number](box)
            if found is not True:
                return number, found
        return len(box.items)

    return query


def _value_query(tree: Node) -> Query:
    fast = generated_truth(tree)
    reference = build_closure(tree)

    def query(box: Box) -> Hashable:
        scene = Scene((box, EMPTY_BOX, EMPTY_BOX))
        try:
            return fast(scene)
        except FallbackError:
            pass
        try:
            return evaluate(reference, Evaluation(scene))
        except ProgramRuntimeError as fault:
            return str(fault)

    return query
