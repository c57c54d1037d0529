"""Synthesizes FlipIt start scenes for statements without any: true-false pairs of scenes that differ by one item.

The pairs cannot be classified by item counts or colour statistics alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from random import Random

from lilgym_mp.corpus.loading import load_all_tasks
from lilgym_mp.corpus.locations import PathLike
from lilgym_mp.corpus.records import SCRATCH, SPLITS
from lilgym_mp.corpus.scene_sampling import sampler_of
from lilgym_mp.corpus.writing import LabelledScene, entry_json
from lilgym_mp.programs import ProgramRuntimeError, compile_program
from lilgym_mp.scene import Scene
from lilgym_mp.scene.appearances import APPEARANCES
from lilgym_mp.scene.arrays import AnyDict

WALKS = 400  # random walks through scenes, in search of a change of the truth value
WALK_LENGTH = 8  # single-item changes per walk


def start_scenes(
    program: str, appearance: str, rng: Random, count: int, walks: int = WALKS
) -> tuple[LabelledScene, ...]:
    """At most `count` distinct non-empty scenes, alternately true and false.

    Where such pairs are found, a true scene and the false one after it differ by one item. If the `walks` random walks
    find only one truth value, all scenes have it. Scenes on which the program has no value are skipped.
    """
    seen: dict[bool, list[Scene]] = {True: [], False: []}
    pairs = near_misses(program, (_walk(appearance, rng) for _ in range(walks)), seen)
    chosen = dict(start for pair in islice(pairs, -(-count // 2)) for start in pair)
    for value in (True, False) * count:
        others = (scene for scene in seen[value] if scene not in chosen)
        if len(chosen) < count and (scene := next(others, None)) is not None:
            chosen[scene] = value
    return tuple(LabelledScene(scene, label) for scene, label in chosen.items())[:count]


def near_misses(
    program: str, walks: Iterable[Iterable[Scene]], seen: dict[bool, list[Scene]] | None = None
) -> Iterator[tuple[LabelledScene, LabelledScene]]:
    """Pairs of a true scene and a false one that are neighbours in a walk, the first of each walk; none has a scene of
    an earlier pair. Adds the scenes before each change to `seen`."""
    used: set[Scene] = set()
    evaluate = compile_program(program).evaluate
    first = None
    first_value = None
    for walk in walks:
        scenes = iter(walk)
        scene = next(scenes)
        if scene is not first:  # walks often begin like the one before
            first = scene
            first_value = _value(evaluate, scene)
        value = first_value
        for after in scenes:
            before = scene
            value_before = value
            scene = after
            value = _value(evaluate, after)
            if value_before is not None and seen is not None:
                seen[value_before].append(before)
            if None not in (value, value_before) and value != value_before:
                if not used & {scene, before}:
                    used |= {scene, before}
                    true, false = (scene, before) if value else (before, scene)
                    yield LabelledScene(true, label=True), LabelledScene(false, label=False)
                break


def _walk(appearance: str, rng: Random) -> Iterator[Scene]:
    """A random scene, changed by one item at a time."""
    sampler = sampler_of(appearance)
    yield (scene := sampler.scene(rng))
    for _ in range(WALK_LENGTH):
        yield (scene := sampler.changed(rng, scene))


def _value(evaluate: Callable[[Scene], bool], scene: Scene) -> bool | None:
    """The truth value, None where there is none."""
    try:
        return evaluate(scene)
    except ProgramRuntimeError:
        return None


def synthesize(
    corpus: PathLike,
    appearances: Iterable[str] = APPEARANCES,
    splits: Iterable[str] = SPLITS,
    *,
    starts: int = 4,
    seed: int = 0,
) -> Iterator[AnyDict]:
    """An entry for `write_corpus`, with at most `starts` start scenes, for every statement of a corpus's Scratch tasks.

    The scenes of a statement depend on the seed and the statement only. Ids are those of the tasks; if these are not
    unique in the corpus, they are prefixed with appearance and split.
    Raises CorpusError as `load_tasks` does, NoTasksError when there are no Scratch tasks.
    """
    sets = list(load_all_tasks(corpus, appearances, [SCRATCH], splits))
    ids = [task.id for tasks in sets for task in tasks]
    unique = len(set(ids)) == len(ids)
    for tasks in sets:
        appearance = tasks.provenance.appearance
        split = tasks.provenance.split
        for task in tasks:
            name = task.id if unique else f"{appearance}-{split}-{task.id}"
            rng = Random(f"{seed} {appearance} {task.statement} {task.program}")
            scenes = enumerate(start_scenes(task.program, appearance, rng, starts), start=1)
            found = ((f"{name}:{index}", start) for index, start in scenes)
            yield entry_json(name, appearance, split, task.statement, task.program, found, task.tags)
