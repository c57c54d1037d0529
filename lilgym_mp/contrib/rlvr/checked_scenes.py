"""The scenes on which a program must agree with a statement's: those that tell it from programs one edit away."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from enum import Enum
from functools import cache, lru_cache
from itertools import chain, islice, zip_longest

from lilgym_mp.corpus.scene_sampling import SAMPLERS, ItemTypes, with_item
from lilgym_mp.corpus.scene_walks import ScenePool
from lilgym_mp.programs import Program, ProgramRuntimeError, StepLimitError, bounded_truths, compile_program, syntax
from lilgym_mp.programs.printing import source_of
from lilgym_mp.programs.words import WORDS
from lilgym_mp.scene import BOX_COUNT, Box, Colour, Scene
from lilgym_mp.scene.appearances import APPEARANCES

CHECKED_SCENES = (100, 70, 40, 20)  # fewer if the program is slow
CROWDED_SCENES = 40  # as large as the largest, on which a program must be fast enough
LEAST_SCENES = 3  # of each truth value among those sampled
STEP_LIMIT = 200_000  # of a program on all checked scenes together; the statement's own needs at most half of them
WALKS, RANDOM = 96, 800  # sampled walks, and scenes besides
CHANGED_SCENES, CHANGES = 16, 16  # scenes of the rarer value that are changed, and how often each

COMPARISONS = ("==", "!=", "<", "<=", ">", ">=")
# Words that can stand in for each other
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
)
_SIBLINGS: Mapping[str, tuple[str, ...]] = {
    name: tuple(other for other in group if other != name) for group in _GROUPS for name in group
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
    chosen = dict.fromkeys(chain(_separating(compiled, candidates, values), candidates))
    for count in CHECKED_SCENES:
        truths = {scene: values[scene] for scene in islice(chosen, count)}
        with suppress(StepLimitError):
            bounded_truths(program, tuple(truths), step_limit=STEP_LIMIT // 2)
            return truths
    return None


@lru_cache(maxsize=4_096)
def is_checkable(program: str, appearance: str) -> bool:
    """Whether other programs can be checked against it: true and false often enough, and fast enough."""
    compiled, counts = compile_program(program), Counter[bool]()
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


def _separating(program: Program, candidates: Sequence[Scene], values: Mapping[Scene, bool]) -> Iterator[Scene]:
    """The first candidate that tells the program from each of those one edit away, if any does."""
    for tree in mutants(program.tree):
        mutant = Program(source_of(tree))
        found = next((scene for scene in candidates if _value(mutant, scene) != values[scene]), None)
        if found is not None:
            yield found


def _value(program: Program, scene: Scene) -> bool:
    try:
        return program.evaluate(scene)
    except ProgramRuntimeError:
        return False


@cache
def _scenes(appearance: str) -> tuple[Scene, ...]:
    """Random scenes, many of them one edit apart."""
    rng = random.Random(f"checks {appearance}")
    scenes = [
        *ScenePool.sample(appearance, rng, WALKS).scenes,
        *(SAMPLERS[appearance].scene(rng) for _ in range(RANDOM)),
    ]
    return tuple(rng.sample(scenes, len(scenes)))


@cache
def _crowded_scene(appearance: str) -> Scene:
    return max(_scenes(appearance), key=lambda scene: sum(1 for _ in scene.items()))


def _changed(scenes: Sequence[Scene], appearance: str) -> Iterator[Scene]:
    """The scenes with an item changed, repeated or of another colour, or a box repeated."""
    rng = random.Random(0)
    for scene in scenes:
        for index in range(CHANGES):
            box = index % BOX_COUNT
            items = scene.boxes[box].items
            yield SAMPLERS[appearance].changed(rng, scene)
            yield scene.with_box(rng.randrange(BOX_COUNT), scene.boxes[box])
            if items:
                item = rng.choice(items)
                other = item._replace(colour=rng.choice(list(Colour)))
                yield scene.with_box(box, Box(tuple(other if each is item else each for each in items)))
                if APPEARANCES[appearance].grid is not None:
                    yield with_item(rng, scene, box, ItemTypes((item.shape,), (item.colour,), (item.size,)))


def mutants(node: syntax.Node) -> Iterator[syntax.Node]:
    """Every tree one edit away: another word, number, colour, comparison or connective, or a part left out."""
    yield from _replacements(node)
    for child in syntax.children(node):
        for changed in mutants(child):
            yield syntax.with_children(node, lambda part, old=child, new=changed: new if part is old else part)


def _replacements(node: syntax.Node) -> Iterator[syntax.Node]:
    match node:
        case syntax.Constant(value=Enum() as member):
            yield from (syntax.Constant(other) for other in type(member) if other is not member)
        case syntax.Constant(value=value) if type(value) is int:
            yield from (syntax.Constant(other) for other in (value - 1, value + 1) if other >= 0)
        case syntax.WordName(word=word):
            yield from (syntax.WordName(WORDS[name]) for name in _SIBLINGS.get(word.name, ()))
        case syntax.Not(operand=operand):
            yield operand
        case syntax.Logic(operator=operator, operands=operands):
            yield syntax.Logic("or" if operator == "and" else "and", operands)
            for index in range(len(operands)):
                rest = operands[:index] + operands[index + 1 :]
                yield rest[0] if len(rest) == 1 else syntax.Logic(operator, rest)
        case syntax.Comparison(operators=operators):
            for index, operator in enumerate(operators):
                for other in COMPARISONS if operator in COMPARISONS else ():
                    if other != operator:
                        changed = (*operators[:index], other, *operators[index + 1 :])
                        yield syntax.Comparison(node.left, changed, node.rights)
        case syntax.Call(word=word, arguments=arguments):
            yield from (syntax.Call(WORDS[name], arguments) for name in _SIBLINGS.get(word.name, ()))
            yield from _shortened(word.name, arguments)
        case _:
            pass


def _shortened(name: str, arguments: tuple[syntax.Node | None, ...]) -> Iterator[syntax.Node]:
    """A call without its negation or filter, and counts in place of `exist`."""
    first = arguments[0] if arguments else None
    if first is None:
        return
    if name == "NOT" or name.startswith("filter_"):
        yield first
    elif name == "exist":
        count = syntax.call(WORDS["count"], first)
        yield from (syntax.Comparison(count, (sign,), (syntax.Constant(1),)) for sign in ("==", ">", "<"))
