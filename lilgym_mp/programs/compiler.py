"""Program source to a callable truth."""

from __future__ import annotations

from collections import Counter
from functools import lru_cache

from lilgym_mp.programs.box_functions import FallbackError
from lilgym_mp.programs.code_generation import generate_function
from lilgym_mp.programs.errors import ProgramError, ProgramRuntimeError
from lilgym_mp.programs.reference import build_closure, evaluate
from lilgym_mp.programs.syntax import Call, Node, WordName, children, parse
from lilgym_mp.scene import Scene

CACHE_SIZE = 8_192  # programs


class Program:
    """A compiled program. `program(scene)` is its truth in the scene.

    On a scene where it has no value (ProgramRuntimeError) the truth is False, and `errors` counts the message,
    once a scene. The truth is kept in `scene.memo`. A program is pickled by its source, without the counts.
    """

    __slots__ = ("_fast", "_key", "_reference", "errors", "has_generated_code", "source", "tree")

    def __init__(self, source: str) -> None:
        """Raises ProgramError when `source` is not a program."""
        self.source = source
        self.errors: Counter[str] = Counter()
        self.tree = parse(source)
        self._reference = build_closure(self.tree)
        fast = generate_function(self.tree)
        self.has_generated_code = fast is not None  # whether the program has a fast form
        self._fast = fast or _unsure
        self._key = "program truth " + source

    def __call__(self, scene: Scene) -> bool:
        memo = scene.memo
        truth = memo.get(self._key)
        if truth is None:
            try:
                truth = self._fast(scene)
            except FallbackError:
                truth = self._reference_truth(scene)
            memo[self._key] = truth
        return truth

    def evaluate(self, scene: Scene) -> bool:
        """The truth in the scene; raises ProgramRuntimeError where there is none. Nothing is counted."""
        try:
            return self._fast(scene)
        except FallbackError:
            return self.evaluate_reference(scene)

    def evaluate_reference(self, scene: Scene) -> bool:
        """`evaluate` by the reference form alone, which defines what is right."""
        return evaluate(self._reference, scene)

    def _reference_truth(self, scene: Scene) -> bool:
        try:
            return self.evaluate_reference(scene)
        except ProgramRuntimeError as fault:
            self.errors[str(fault)] += 1
            return False

    def __reduce__(self) -> tuple[type[Program], tuple[str]]:
        return Program, (self.source,)

    def __repr__(self) -> str:
        return f"Program({self.source!r})"


def _unsure(scene: Scene) -> bool:
    """The fast form of programs that have none."""
    raise FallbackError


def compile_program(source: str) -> Program:
    """The program with that source; the same object while it is among the last ones asked for.

    Raises ProgramError, with position and reason, when `source` is not a program, TypeError when it is no text.
    """
    if not isinstance(source, str):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise TypeError(f"the source of a program is a str, not {type(source).__name__}")
    return _compiled(source)


_compiled = lru_cache(maxsize=CACHE_SIZE)(Program)


def explain_program(source: str) -> str:
    """Lines for a person: what is wrong with the source, or the words it uses and its value on no items."""
    try:
        program = compile_program(source)
    except ProgramError as fault:
        return f"not a program: {fault.explain()}"
    try:
        value = str(program.evaluate(Scene.empty()))
    except ProgramRuntimeError as fault:
        value = f"no value ({fault})"
    words = sorted(_words(program.tree))
    used = f"words: {', '.join(words)}" if words else "words: none"
    return f"a program\n{used}\non the empty scene: {value}"


def _words(node: Node) -> set[str]:
    found = {node.word.name} if isinstance(node, Call | WordName) else set[str]()
    return found.union(*map(_words, children(node)))
