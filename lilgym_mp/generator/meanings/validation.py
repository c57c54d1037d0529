"""Drafts statements with their programs, and validates them with start scenes.

A draft is valid if its program compiles; is neither always true nor always false on a pool of scenes; becomes true by
legal edits of the empty scene within the horizon, and flips from each start scene; and if every parse of the statement
has the program's truth value on scenes of the pool.
"""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

from lilgym_mp.generator.meanings.interpretation import ALTERNATIVES, STANDARD, holds
from lilgym_mp.generator.meanings.program_realisation import program_source
from lilgym_mp.generator.meanings.sampling import random_meaning
from lilgym_mp.generator.meanings.scene_sampling import is_legible
from lilgym_mp.generator.meanings.semantics import Clause, with_values_replaced
from lilgym_mp.generator.meanings.sentence_realisation import random_style, realise_statement
from lilgym_mp.generator.meanings.start_selection import ScenePool, StartScene, TruthTable, select_starts
from lilgym_mp.generator.meanings.statement_grammar import parse_statement
from lilgym_mp.programs import compile_program
from lilgym_mp.scene import Colour, Scene, Shape

Value = TypeVar("Value")

MIN_SHARE = 0.004  # share of the pool's scenes that must have each truth value
VARIANTS = 3  # most variants of a draft: drafts of the same form, so that train and dev share forms
MAX_VARIANT_LEVEL = 3  # drafts of higher levels have no variants
PROBE_SCENES = 24  # scenes on which the parses are compared with the program


class Draft(NamedTuple):
    """A statement and its program, not yet validated."""

    statement: str
    program: str
    level: int


@dataclass(frozen=True)
class Entry:
    """A valid statement with its program and start scenes."""

    statement: str
    program: str
    level: int
    edits_from_empty: int  # upper bound of the edits that make the statement true
    starts: tuple[StartScene, ...]


def drafts(appearance: str, level: int, rng: random.Random) -> Iterator[Draft]:
    """Endless random drafts, at low levels each followed by variants with other colours and shapes."""
    while True:
        meaning = random_meaning(appearance, level, rng)
        wording_seed = rng.getrandbits(64)
        yield realise(meaning, appearance, level, random.Random(wording_seed))
        for _ in range(VARIANTS if level <= MAX_VARIANT_LEVEL else 0):
            colours, shapes = _random_permutation(list(Colour), rng), _random_permutation(list(Shape), rng)
            variant = with_values_replaced(meaning, colours, shapes)
            if variant != meaning:
                yield realise(variant, appearance, level, random.Random(wording_seed))


def realise(meaning: Clause, appearance: str, level: int, rng: random.Random) -> Draft:
    """The meaning in a random wording and style, with its program."""
    return Draft(realise_statement(meaning, rng, random_style(rng, appearance)), program_source(meaning), level)


def validate_draft(draft: Draft, pool: ScenePool, rng: random.Random) -> Entry | None:
    """The draft with start scenes, or None if it is not valid."""
    parses = parse_statement(draft.statement)
    truth = compile_program(draft.program).evaluate
    probes = rng.sample(pool.scenes, PROBE_SCENES)
    if not parses or any(holds(parse, scene) != truth(scene) for parse in parses for scene in probes):
        return None
    truths = TruthTable(pool, truth)
    edits = truths.edits_from_empty()
    if edits is None or not MIN_SHARE <= truths.share_true <= 1 - MIN_SHARE:
        return None
    starts = select_starts(truths, rng, lambda scene: is_clear(parses, scene, truth(scene)))
    return Entry(draft.statement, draft.program, draft.level, edits, tuple(starts)) if starts else None


def is_trivial(draft: Draft) -> bool:
    """Whether the statement is true in the empty scene, where an immediate STOP succeeds."""
    return compile_program(draft.program).evaluate(Scene.empty())


def is_clear(parses: Sequence[Clause], scene: Scene, label: bool) -> bool:
    """Whether the label holds under every parse and interpretation.

    Without parses, whether the scene is legible.
    """
    if not parses:
        return all(is_legible(box) for box in scene.boxes)
    interpretations = (STANDARD, *ALTERNATIVES)
    return all(holds(parse, scene, interpretation) == label for parse in parses for interpretation in interpretations)


def clear_scenes(entry: Entry, pool: ScenePool, label: bool, rng: random.Random) -> Iterator[Scene]:
    """Non-empty scenes of the pool with that label, in random order, for which `is_clear`."""
    parses, truth = parse_statement(entry.statement), compile_program(entry.program).evaluate
    for scene in rng.sample(pool.scenes, len(pool.scenes)):
        if truth(scene) == label and any(scene.items()) and is_clear(parses, scene, label):
            yield scene


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


def _random_permutation(values: list[Value], rng: random.Random) -> dict[Value, Value]:
    return dict(zip(values, rng.sample(values, len(values)), strict=True))
