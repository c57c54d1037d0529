"""Compiles program source to a callable from scenes to truth values."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Callable, Hashable
from functools import lru_cache
from typing import Any

from lilgym_mp.programs.errors import FallbackError, ProgramRuntimeError
from lilgym_mp.programs.syntax import Node, parse
from lilgym_mp.scene import Scene

CACHE_SIZE = 8_192  # programs
MAX_MEMO = 2_048  # values memoised by a box or scene, beyond which those of programs are forgotten
REFERENCE_EVALUATIONS = 2  # of a program, before code is generated for it

Truth = Callable[[Scene], bool]  # may raise FallbackError
_GENERATORS: list[Callable[[Node], Truth | None]] = []  # the latest is used


def register_generator(generate: Callable[[Node], Truth | None]) -> None:
    """Sets what generates code for a syntax tree that is evaluated often; it returns None for an unsupported one.

    Without one, or if it raises ImportError, programs are evaluated by the reference evaluator alone.
    """
    _GENERATORS.append(generate)


class Program:
    """A compiled program. `program(scene)` is its truth value in the scene, memoised in `scene.memo`.

    The reference evaluator computes the first values, generated code the others. Where evaluation raises
    ProgramRuntimeError, the truth value is False and `errors` counts the message, once per scene. Pickling keeps the
    source only.
    """

    __slots__ = ("_evaluations", "_generated", "_key", "_reference", "errors", "source", "tree")

    def __init__(self, source: str) -> None:
        """Parses and checks the source.

        Args:
            source: The program's text.

        Raises:
            ProgramError: When `source` is not a valid program.
        """
        self.source = source
        self.errors: Counter[str] = Counter()
        self.tree = parse(source)
        self._reference: Any = None  # for the reference evaluator, made when it is used
        self._generated: Truth | None = None
        self._evaluations = 0  # before code is generated
        self._key = "program truth " + source

    def __call__(self, scene: Scene) -> bool:
        memo = scene.memo
        truth = memo.get(self._key)
        if truth is None:
            try:
                truth = (self._generated or self._first())(scene)
            except FallbackError:
                truth = self._reference_truth(scene)
            if len(memo) >= MAX_MEMO:
                forget_programs(memo)
            memo[self._key] = truth
        return truth

    @property
    def has_generated_code(self) -> bool:
        """Whether there is generated code; else every evaluation uses the reference evaluator."""
        return (self._generated or self._generate()) is not _always_fall_back

    def evaluate(self, scene: Scene, *, step_limit: int | None = None) -> bool:
        """The truth value in the scene; `errors` is unchanged.

        Args:
            scene: The scene.
            step_limit: Steps of about 0.1 microseconds after which the reference evaluator gives up. Programs of
                unknown origin can take seconds without a limit.

        Raises:
            ProgramRuntimeError: Where there is no truth value.
            StepLimitError: Beyond the step limit.
        """
        if step_limit is not None:
            return self.evaluate_reference(scene, step_limit=step_limit)
        try:
            return (self._generated or self._generate())(scene)
        except FallbackError:
            return self.evaluate_reference(scene)

    def evaluate_reference(self, scene: Scene, *, step_limit: int | None = None) -> bool:
        """`evaluate` by the reference evaluator, which defines the semantics.

        Args:
            scene: The scene.
            step_limit: As for `evaluate`.
        """
        from lilgym_mp.programs.reference import Evaluation, build_closure, evaluate

        self._reference = self._reference or build_closure(self.tree)
        return evaluate(self._reference, Evaluation(scene, step_limit))

    def _first(self) -> Truth:
        """The function for one of the first evaluations."""
        self._evaluations += 1
        return _always_fall_back if self._evaluations <= REFERENCE_EVALUATIONS else self._generate()

    def _generate(self) -> Truth:
        self._generated = generated_truth(self.tree)
        return self._generated

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


def generated_truth(tree: Node) -> Truth:
    """The generated code of a program, which raises FallbackError where the reference evaluator must be used."""
    generated = None
    try:
        generated = _GENERATORS[-1](tree) if _GENERATORS else None
    except ImportError as fault:  # a warning is shown once
        warnings.warn(f"programs are evaluated slowly, by the reference evaluator: {fault}", RuntimeWarning)  # noqa: B028
    return generated or _always_fall_back


def compile_program(source: str) -> Program:
    """The compiled program, from an LRU cache.

    Args:
        source: The program's text.

    Returns:
        The program; `program(scene)` is its truth value in the scene.

    Raises:
        ProgramError: When `source` is not a valid program, with position and reason.
        TypeError: When it is not a str.
    """
    if not isinstance(source, str):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise TypeError(f"the source of a program must be a str, not {type(source).__name__}")
    return _compiled(source)


_compiled = lru_cache(maxsize=CACHE_SIZE)(Program)


def forget_programs(memo: dict[Hashable, Any]) -> None:
    """Removes what programs memoised, whose keys begin with "program "; it is computed again when needed."""
    for key in list(memo):
        if isinstance(key, str) and key.startswith("program "):
            memo.pop(key, None)


def _always_fall_back(scene: Scene) -> bool:
    raise FallbackError
