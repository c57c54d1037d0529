"""What a program sees of a whole box, where it looks at the boxes one by one.

Most programs ask each box the same few questions, such as whether it is a tower of three, and count the answers.
Boxes with equal answers, a box's face, can stand for each other, and a handful of faces stand for all boxes.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache

from lilgym_mp.programs import ProgramRuntimeError, compile_program
from lilgym_mp.programs.box_functions import FallbackError
from lilgym_mp.programs.code_generation import generate_function
from lilgym_mp.programs.reference import build_closure, evaluate
from lilgym_mp.programs.syntax import (
    Call,
    Comparison,
    Constant,
    Display,
    Lambda,
    Node,
    SceneName,
    Subscript,
    Variable,
    WordName,
    children,
)
from lilgym_mp.programs.words import WORDS
from lilgym_mp.scene import Box, Item, Scene

KEPT_PROGRAMS = 4_096
KEPT_QUESTIONS = 4_096
BOXES, ITEMS = SceneName("all_boxes"), SceneName("all_items")
FIRST_BOX = Display(list, (Subscript(BOXES, Constant(0)),))
NOTHING = Box()

Answer = Callable[[Box], Hashable]  # to one question about a box


@dataclass(frozen=True, slots=True)
class Face:
    """What one program sees of a box: boxes with equal answers can stand for each other."""

    answers: tuple[Answer, ...]

    def __call__(self, box: Box) -> Hashable:
        return tuple([answer(box) for answer in self.answers])


class _EntangledError(Exception):
    """The program looks at boxes in another way."""


@lru_cache(maxsize=KEPT_PROGRAMS)
def face_of(program: str) -> Face | None:
    """A function of boxes such that boxes with equal values can stand for each other; None where none is known."""
    try:
        questions = tuple(dict.fromkeys(_questions(compile_program(program).tree)))
    except _EntangledError:
        return None
    return Face(tuple(map(_answer, questions)))


class BoxFaces:
    """Numbers what some programs together see of a box: boxes with equal numbers can stand for each other.

    `told` is false where one of the programs looks at boxes in another way; then each box has a number of its own.
    """

    def __init__(self, programs: Iterable[str]) -> None:
        faces = [face_of(program) for program in programs]
        self.told = None not in faces
        self.boxes: list[Box] = []  # the first with each number
        self._answers = tuple(dict.fromkeys(answer for face in faces if face is not None for answer in face.answers))
        self._numbers: dict[Hashable, int] = {}
        self._known: dict[tuple[Item, ...], int] = {}

    def number(self, box: Box) -> int:
        """The number of the box's face."""
        number = self._known.get(box.items)
        if number is None:
            face = tuple([answer(box) for answer in self._answers]) if self.told else box.items
            number = self._known[box.items] = self._numbers.setdefault(face, len(self.boxes))
            if number == len(self.boxes):
                self.boxes.append(box)
        return number


def _questions(node: Node) -> Iterator[tuple[Node, bool]]:
    """Programs about the first box, whether each is a count, that settle the node's value. Raises _EntangledError."""
    match node:
        case Call(word=word, arguments=(chain,)) if word.name in ("exist", "count") and chain is not None:
            if _source(chain) == BOXES:
                yield from _filters(chain)
                return
            if _source(chain) == ITEMS and all(map(_is_closed, _functions(chain))):
                yield Call(WORDS["count"], (chain,)), True
                return
        case Call(word=word, arguments=(chain, function)) if word.name in ("All", "Any") and chain and function:
            if _source(chain) == BOXES and _is_closed(function):
                yield from _filters(chain)
                yield Call(WORDS["Any"], (FIRST_BOX, function)), False
                return
        case SceneName() | Lambda() | WordName():
            raise _EntangledError
        case _:
            pass
    for child in children(node):
        yield from _questions(child)


def _source(chain: Node) -> Node:
    """What a chain of filters starts from."""
    match chain:
        case Call(word=word, arguments=(inner, _)) if word.name.startswith("filter_") and inner is not None:
            return _source(inner)
        case _:
            return chain


def _functions(chain: Node) -> Iterator[Node]:
    """What a chain of filters filters by."""
    match chain:
        case Call(arguments=(inner, function)) if inner is not None and function is not None:
            yield function
            yield from _functions(inner)
        case _:
            return


def _filters(chain: Node) -> Iterator[tuple[Node, bool]]:
    for function in _functions(chain):
        if not _is_closed(function):
            raise _EntangledError
        chosen = Call(WORDS["filter_obj"], (FIRST_BOX, function))
        yield Call(WORDS["exist"], (chosen,)), False


def _is_closed(function: Node) -> bool:
    """Whether its value for a box or item depends on that box alone."""
    return all(_stays_inside(node, bound) for node, bound in _with_bound(function, frozenset()))


def _with_bound(node: Node, bound: frozenset[str]) -> Iterator[tuple[Node, frozenset[str]]]:
    """Every node below, with the variables that are bound there."""
    yield node, bound
    if isinstance(node, Lambda):
        bound |= {node.parameter}
    for child in children(node):
        yield from _with_bound(child, bound)


def _stays_inside(node: Node, bound: frozenset[str]) -> bool:
    match node:
        case SceneName():
            return False
        case Variable(name=name):
            return name in bound
        case Call(word=word) | WordName(word=word):
            return word.depends_on != "scene"
        case _:
            return True


@lru_cache(maxsize=KEPT_QUESTIONS)
def _answer(question: tuple[Node, bool]) -> Answer:
    """The question's value for a box that is first of an otherwise empty scene; the error where it has none."""
    tree, is_count = question
    if is_count:
        return _counted(tree)
    return _asked(tree)


def _counted(count: Node) -> Answer:
    at_least: list[Answer] = []

    def answer(box: Box) -> Hashable:
        for number in range(len(box.items)):
            if number == len(at_least):
                at_least.append(_asked(Comparison(count, (">",), (Constant(number),))))
            found = at_least[number](box)
            if found is not True:
                return number, found
        return len(box.items)

    return answer


def _asked(tree: Node) -> Answer:
    fast, reference = generate_function(tree), build_closure(tree)

    def answer(box: Box) -> Hashable:
        scene = Scene((box, NOTHING, NOTHING))
        try:
            if fast is not None:
                return fast(scene)
        except FallbackError:
            pass
        try:
            return evaluate(reference, scene)
        except ProgramRuntimeError as fault:
            return str(fault)

    return answer
