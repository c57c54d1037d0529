"""Statements with program and start scenes, each proven sound before it is used.

An entry is sound when its program compiles; is neither always true nor always false on a stock of scenes; becomes
true by legal edits of the empty scene within the horizon, and changes its truth so from each start scene; and when
the statement, read back by a grammar of its own, means what the program says on scenes of the stock, whichever way
it can be read.
"""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

from lilgym_mp.generator.interpretation import ALTERNATIVES, STANDARD, Interpretation, holds
from lilgym_mp.generator.meaning_sampling import random_meaning
from lilgym_mp.generator.program_realisation import program_source
from lilgym_mp.generator.scene_sampling import is_legible
from lilgym_mp.generator.semantics import Clause, with_values_replaced
from lilgym_mp.generator.sentence_realisation import random_style, realise_statement
from lilgym_mp.generator.start_selection import ScenePool, StartScene, TruthTable, start_scenes
from lilgym_mp.generator.statement_grammar import parse_statement
from lilgym_mp.programs import compile_program
from lilgym_mp.scene import Colour, Scene, Shape

Member = TypeVar("Member")

RAREST = 0.004  # share of the stock's scenes that must have each truth value
COMMON_LEVEL = 3  # up to here statements of one form are drafted together, so that train and dev share forms
OF_ONE_FORM = 3  # more of a form, at most
PROBES = 24  # scenes on which a statement is read back


class Draft(NamedTuple):
    """A statement and its program, not yet proven."""

    statement: str
    program: str
    level: int


@dataclass(frozen=True)
class Entry:
    """A sound statement."""

    statement: str
    program: str
    level: int
    edits_from_empty: int  # an upper bound of the fewest
    starts: tuple[StartScene, ...]


def drafts(appearance: str, level: int, rng: random.Random) -> Iterator[Draft]:
    """Endless random statements of a level; up to COMMON_LEVEL each followed by some of its form."""
    while True:
        meaning = random_meaning(appearance, level, rng)
        manner = rng.getrandbits(64)
        yield realise(meaning, appearance, level, random.Random(manner))
        for _ in range(OF_ONE_FORM if level <= COMMON_LEVEL else 0):
            other = with_values_replaced(meaning, _exchange(list(Colour), rng), _exchange(list(Shape), rng))
            if other != meaning:
                yield realise(other, appearance, level, random.Random(manner))


def _exchange(members: list[Member], rng: random.Random) -> dict[Member, Member]:
    return dict(zip(members, rng.sample(members, len(members)), strict=True))


def realise(meaning: Clause, appearance: str, level: int, rng: random.Random) -> Draft:
    """One of the ways to say a meaning."""
    return Draft(realise_statement(meaning, rng, random_style(rng, appearance)), program_source(meaning), level)


def validate_draft(draft: Draft, stock: ScenePool, rng: random.Random) -> Entry | None:
    """The draft with start scenes, or None when it is not sound."""
    readings = parse_statement(draft.statement)
    truth = compile_program(draft.program).evaluate
    probes = rng.sample(stock.scenes, PROBES)
    if not readings or any(holds(reading, scene) != truth(scene) for reading in readings for scene in probes):
        return None
    truths = TruthTable(stock, truth)
    edits = truths.edits_from_empty()
    if edits is None or not RAREST <= truths.share <= 1 - RAREST:
        return None
    starts = start_scenes(truths, rng, lambda scene: is_clear(readings, scene, truth(scene)))
    return Entry(draft.statement, draft.program, draft.level, edits, tuple(starts)) if starts else None


def is_trivial(draft: Draft) -> bool:
    """Whether the statement is true of the empty scene, so that from there an immediate STOP succeeds."""
    return compile_program(draft.program).evaluate(Scene.empty())


def is_clear(readings: Sequence[Clause], scene: Scene, label: bool) -> bool:
    """Whether the statement has that label in the scene however it is read, strictly or loosely.

    Of a statement that nobody can read back, whether all items of the scene are plain to see.
    """
    if not readings:
        return is_plain(scene)
    ways: tuple[Interpretation, ...] = (STANDARD, *ALTERNATIVES)
    return all(holds(clause, scene, way) == label for clause in readings for way in ways)


def clear_scenes(entry: Entry, stock: ScenePool, label: bool, rng: random.Random) -> Iterator[Scene]:
    """Scenes of the stock, not empty, in random order, which clearly have that label."""
    readings, truth = parse_statement(entry.statement), compile_program(entry.program).evaluate
    for scene in rng.sample(stock.scenes, len(stock.scenes)):
        if truth(scene) == label and any(scene.items()) and is_clear(readings, scene, label):
            yield scene


def is_plain(scene: Scene) -> bool:
    """Whether no item of the scene is hard to judge by eye."""
    return all(is_legible(box) for box in scene.boxes)
