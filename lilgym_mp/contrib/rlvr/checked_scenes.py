"""The scenes on which a program must agree with a statement's: those that tell it from programs one edit away."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache, lru_cache
from itertools import chain, islice, zip_longest
from random import Random

from lilgym_mp.corpus.scene_sampling import sampler_of
from lilgym_mp.corpus.scene_walks import ScenePool
from lilgym_mp.programs import (
    Program,
    ProgramError,
    ProgramRuntimeError,
    StepLimitError,
    compile_program,
)
from lilgym_mp.programs.bounded import bounded_truths
from lilgym_mp.programs.values import ENUMS
from lilgym_mp.scene import BOX_COUNT, Scene

CHECKED_SCENES = (100, 70, 40, 20)  # fewer if the program is slow
CROWDED_SCENES = 40  # as large as the largest, on which a program must be fast enough
LEAST_SCENES = 3  # of each truth value among those sampled
STEP_LIMIT = 200_000  # of a program on all checked scenes together; the statement's own needs at most half of them
# Sampled walks, and scenes besides
WALKS = 96
RANDOM = 800
# Scenes of the rarer value that are changed, and how often each
CHANGED_SCENES = 16
CHANGES = 16
# Walks from scenes of the rarer value, for programs one edit away that agree on all of the above
WALKED_SCENES = 32
WALKS_EACH = 6
WALK_STEPS = 5

# Words and signs of which each can stand in for the others
_GROUPS = (
    ("is_yellow", "is_blue", "is_black"),
    ("is_circle", "is_square", "is_triangle"),
    ("is_big", "is_medium", "is_small"),
    ("is_top", "is_bottom", "is_second", "is_third"),
    ("is_touching_wall", "is_closely_touching_wall", "is_touching_corner", "is_closely_touching_corner"),
    ("get_touching", "get_closely_touching", "get_above", "get_below", "get_box_all_above", "get_box_all_below"),
    ("get_set_colors", "get_set_shapes", "get_set_sizes"),
    ("all_same_color", "all_same_shape", "all_same_size"),
    ("le", "ge", "lt", "gt", "equal_int"),
    ("All", "Any"),
    *(tuple(enum.__members__) for enum in ENUMS.values()),
    ("==", "!=", "<", "<=", ">", ">="),
)
_REPLACEMENTS = {
    **{word: tuple(other for other in group if other != word) for group in _GROUPS for word in group},
    "exist": ("1 == count", "1 < count", "1 > count"),
    "and": ("or", "and True or False and", "and False or"),  # the other connective, and either part left out
    "or": ("and", "or False and", "and False or"),
    "not": ("",),
    "NOT": ("",),
}


@lru_cache(maxsize=4_096)
def checked_truths(program: str, appearance: str) -> Mapping[Scene, bool] | None:
    """At most 100 scenes with the program's truth values; None if it is not checkable.

    First scenes that tell it from the programs one edit away, then others, half of them true if possible.
    """
    if not is_checkable(program, appearance):
        return None
    compiled = compile_program(program)
    values = {scene: _value(compiled, scene) for scene in _scenes(appearance)}
    rarer = sum(values.values()) < len(values) / 2
    changed = _changed([scene for scene in values if values[scene] == rarer][:CHANGED_SCENES], appearance)
    values |= {scene: _value(compiled, scene) for scene in changed}
    by_value = ([scene for scene in values if values[scene] == value] for value in (rarer, not rarer))
    candidates = [scene for scene in chain.from_iterable(zip_longest(*by_value)) if scene is not None]
    chosen = dict.fromkeys(chain(_separating(compiled, candidates, values, appearance), candidates))
    for count in CHECKED_SCENES:
        truths = {scene: values[scene] for scene in islice(chosen, count)}
        with suppress(StepLimitError):
            bounded_truths(program, tuple(truths), step_limit=STEP_LIMIT // 2)
            return truths
    return None


@lru_cache(maxsize=4_096)
def is_checkable(program: str, appearance: str) -> bool:
    """Whether other programs can be checked against it: true and false often enough, and fast enough."""
    compiled = compile_program(program)
    counts = Counter[bool]()
    for scene in _scenes(appearance):
        counts[_value(compiled, scene)] += 1
        if min(counts[True], counts[False]) >= LEAST_SCENES:
            break
    else:
        return False
    try:
        compiled.evaluate_reference(_crowded_scene(appearance), step_limit=STEP_LIMIT // 2 // CROWDED_SCENES)
    except StepLimitError:
        return False
    except ProgramRuntimeError:
        pass
    return True


def _separating(
    program: Program, candidates: Sequence[Scene], values: dict[Scene, bool], appearance: str
) -> Iterator[Scene]:
    """Few scenes that tell the program from those one edit away: of the candidates, or near those of the rarer value.

    Adds the values of further scenes to `values`.
    """
    chosen: list[Scene] = []
    further: list[Scene] = []
    for source in dict.fromkeys(mutants(program.source)):
        try:
            mutant = Program(source)
        except ProgramError:
            continue
        if any(_value(mutant, scene) != values[scene] for scene in chosen):
            continue
        found = next((scene for scene in candidates if _value(mutant, scene) != values[scene]), None)
        if found is None:
            further = further or _further(program, candidates[::2][:WALKED_SCENES], values, appearance)
            found = next((scene for scene in further if _value(mutant, scene) != values[scene]), None)
        if found is not None:
            chosen.append(found)
            yield found


def _further(program: Program, scenes: Sequence[Scene], values: dict[Scene, bool], appearance: str) -> list[Scene]:
    """The scenes of walks from these; adds their values to `values`."""
    rng = Random(1)
    changed = sampler_of(appearance).changed
    found: list[Scene] = []
    for start in [*scenes] * WALKS_EACH:
        scene = start
        for _ in range(WALK_STEPS):
            scene = changed(rng, scene)
            found.append(scene)
    values |= {scene: _value(program, scene) for scene in found}
    return found


def _value(program: Program, scene: Scene) -> bool:
    try:
        return program.evaluate(scene)
    except ProgramRuntimeError:
        return False


@cache
def _scenes(appearance: str) -> tuple[Scene, ...]:
    """Random scenes, many of them one edit apart."""
    rng = Random(f"checks {appearance}")
    scenes = [
        *ScenePool.sample(appearance, rng, WALKS).scenes,
        *(sampler_of(appearance).scene(rng) for _ in range(RANDOM)),
    ]
    return tuple(rng.sample(scenes, len(scenes)))


@cache
def _crowded_scene(appearance: str) -> Scene:
    return max(_scenes(appearance), key=lambda scene: sum(1 for _ in scene.items()))


def _changed(scenes: Sequence[Scene], appearance: str) -> Iterator[Scene]:
    """The scenes with an item changed, or with a box repeated."""
    rng = Random(0)
    for scene in scenes:
        for index in range(CHANGES):
            yield sampler_of(appearance).changed(rng, scene)
            yield scene.with_box(rng.randrange(BOX_COUNT), scene.boxes[index % BOX_COUNT])


def mutants(program: str) -> Iterator[str]:
    """The program with one edit: another word, number or sign, or a part left out. Few of them are no programs."""
    for match in re.finditer(r"\bis_\w+\([^()]*\)", program):
        yield f"{program[: match.start()]}True{program[match.end() :]}"
    for match in re.finditer(r"\w+|[<>=!]+", program):
        token = match[0]
        others = _REPLACEMENTS.get(token, ())
        if token.isdecimal():
            others = (str(int(token) + 1), *([str(int(token) - 1)] if int(token) else []))
        yield from (program[: match.start()] + other + program[match.end() :] for other in others)
