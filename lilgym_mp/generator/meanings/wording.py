"""Compares what a statement says, as far as the grammar can read it, with its program."""

from __future__ import annotations

from collections.abc import Sequence

from lilgym_mp.generator.meanings.interpretation import ALTERNATIVES, STANDARD, holds
from lilgym_mp.generator.meanings.statement_grammar import parse_statement
from lilgym_mp.programs import compile_program
from lilgym_mp.scene import Scene


def disagreement(statement: str, program: str, scenes: Sequence[Scene]) -> str | None:
    """How the statement says more or less than its program; None if a reading agrees with it in all scenes, or if the
    grammar cannot read the statement."""
    parses = parse_statement(statement)
    evaluate = compile_program(program)
    truths = [evaluate(scene) for scene in scenes]
    readings = ([holds(parse, scene, how) for scene in scenes] for how in (STANDARD, *ALTERNATIVES) for parse in parses)
    first: list[bool] | None = None
    for reading in readings:
        if reading == truths:
            return None
        first = first or reading
    if first is None:
        return None
    pairs = list(zip(first, truths, strict=True))
    more, less = pairs.count((False, True)), pairs.count((True, False))
    parts = [(more, "more than its program, which is true where the statement reads as false")] if more else []
    parts += [(less, "less than its program, which is false where the statement reads as true")] if less else []
    return "says " + " and ".join(f"{text} ({count} of {len(scenes)} scenes)" for count, text in parts)
