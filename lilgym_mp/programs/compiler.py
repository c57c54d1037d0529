"""Compiles program source to a callable from scenes to truth values."""

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
    """A compiled program. `program(scene)` is its truth value in the scene, memoised in `scene.memo`.

    Where evaluation raises ProgramRuntimeError, the truth value is False and `errors` counts the message, once per
    scene. Pickling keeps the source only.
    """

    __slots__ = ("_generated", "_key", "_reference", "errors", "has_generated_code", "source", "tree")

    def __init__(self, source: str) -> None:
        """Raises ProgramError when `source` is not a valid program."""
        self.source = source
        self.errors: Counter[str] = Counter()
        self.tree = parse(source)
        self._reference = build_closure(self.tree)
        generated = generate_function(self.tree)
        self.has_generated_code = generated is not None  # else every evaluation uses the reference evaluator
        self._generated = generated or _always_fall_back
        self._key = "program truth " + source

    def __call__(self, scene: Scene) -> bool:
        memo = scene.memo
        truth = memo.get(self._key)
        if truth is None:
            try:
                truth = self._generated(scene)
            except FallbackError:
                truth = self._reference_truth(scene)
            memo[self._key] = truth
        return truth

    def evaluate(self, scene: Scene) -> bool:
        """The truth value in the scene. Raises ProgramRuntimeError where there is none; `errors` is unchanged."""
        try:
            return self._generated(scene)
        except FallbackError:
            return self.evaluate_reference(scene)

    def evaluate_reference(self, scene: Scene) -> bool:
        """`evaluate` by the reference evaluator, which defines the semantics."""
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


def _always_fall_back(scene: Scene) -> bool:
    raise FallbackError


def compile_program(source: str) -> Program:
    """The compiled program, from an LRU cache.

    Raises ProgramError with position and reason when `source` is not a valid program, TypeError when it is not a str.
    """
    if not isinstance(source, str):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise TypeError(f"the source of a program must be a str, not {type(source).__name__}")
    return _compiled(source)


_compiled = lru_cache(maxsize=CACHE_SIZE)(Program)


def explain_program(source: str) -> str:
    """Human-readable text: the error in the source, or the words it uses and its value on the empty scene."""
    try:
        program = compile_program(source)
    except ProgramError as fault:
        return f"invalid program: {fault.explain()}"
    try:
        value = str(program.evaluate(Scene.empty()))
    except ProgramRuntimeError as fault:
        value = f"no value ({fault})"
    words = sorted(_words(program.tree))
    used = f"words: {', '.join(words)}" if words else "words: none"
    return f"valid program\n{used}\non the empty scene: {value}"


def _words(node: Node) -> set[str]:
    found = {node.word.name} if isinstance(node, Call | WordName) else set[str]()
    return found.union(*map(_words, children(node)))
