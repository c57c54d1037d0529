"""Synthesizes FlipIt start scenes for statements without any: true-false pairs of scenes that differ by one item.

The pairs cannot be classified by item counts or colour statistics alone.
"""

from __future__ import annotations

import os
import random
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from lilgym_mp.appearances import APPEARANCES
from lilgym_mp.corpus.jsonlines import LabelledScene, entry_json
from lilgym_mp.corpus.loading import load_all_tasks
from lilgym_mp.corpus.records import SCRATCH, SPLITS
from lilgym_mp.corpus.scene_sampling import SAMPLERS
from lilgym_mp.programs import ProgramRuntimeError, compile_program
from lilgym_mp.scene import Scene

WALKS = 400  # random walks through scenes, in search of a change of the truth value
WALK_LENGTH = 8  # single-item changes per walk


class SynthesizedEntry(NamedTuple):
    """A statement with synthesized start scenes."""

    id: str
    appearance: str
    split: str
    statement: str
    program: str
    starts: tuple[LabelledScene, ...]

    def to_json(self) -> dict[str, object]:
        """The entry for `write_corpus`."""
        starts = ((f"{self.id}:{index}", start) for index, start in enumerate(self.starts, start=1))
        return entry_json(self.id, self.appearance, self.split, self.statement, self.program, starts)


def start_scenes(
    program: str, appearance: str, rng: random.Random, count: int, walks: int = WALKS
) -> tuple[LabelledScene, ...]:
    """At most `count` distinct non-empty scenes, alternately true and false.

    Where such pairs are found, a true scene and the false one after it differ by one item. If the `walks` random walks
    find only one truth value, all scenes have it. Scenes on which the program has no value are skipped.
    """
    chosen: dict[Scene, bool] = {}
    seen: dict[bool, list[Scene]] = {True: [], False: []}
    for pair in _near_misses(program, appearance, rng, seen, walks):
        if not any(start.scene in chosen for start in pair):
            chosen.update(pair)
        if len(chosen) >= count:
            break
    for value in (True, False) * count:
        others = (scene for scene in seen[value] if scene not in chosen)
        if len(chosen) < count and (scene := next(others, None)) is not None:
            chosen[scene] = value
    return tuple(LabelledScene(scene, label) for scene, label in chosen.items())[:count]


def _near_misses(
    program: str, appearance: str, rng: random.Random, seen: dict[bool, list[Scene]], walks: int
) -> Iterator[tuple[LabelledScene, LabelledScene]]:
    """Pairs of scenes that differ by one item and by truth value; adds the scenes before each change to `seen`."""
    sampler = SAMPLERS[appearance]
    for _ in range(walks):
        scene = sampler.scene(rng)
        value = _value(program, scene)
        for _ in range(WALK_LENGTH):
            before, value_before = scene, value
            scene = sampler.changed(rng, before)
            value = _value(program, scene)
            if value_before is not None:
                seen[value_before].append(before)
            if None not in (value, value_before) and value != value_before:
                true, false = (scene, before) if value else (before, scene)
                yield LabelledScene(true, label=True), LabelledScene(false, label=False)
                break


def _value(program: str, scene: Scene) -> bool | None:
    """The program's truth value, None where it has none."""
    try:
        return compile_program(program).evaluate(scene)
    except ProgramRuntimeError:
        return None


def synthesize(
    corpus: str | os.PathLike[str],
    appearances: Iterable[str] = APPEARANCES,
    splits: Iterable[str] = SPLITS,
    *,
    starts: int = 4,
    seed: int = 0,
) -> Iterator[SynthesizedEntry]:
    """An entry with at most `starts` start scenes for every statement of a corpus's Scratch tasks.

    The scenes of a statement depend on the seed and the statement only. Ids are those of the tasks; if these are not
    unique in the corpus, they are prefixed with appearance and split.
    Raises CorpusError as `load_tasks` does, NoTasksError when there are no Scratch tasks.
    """
    sets = list(load_all_tasks(corpus, appearances, [SCRATCH], splits))
    ids = [task.id for tasks in sets for task in tasks]
    unique = len(set(ids)) == len(ids)
    for tasks in sets:
        appearance, split = tasks.provenance.appearance, tasks.provenance.split
        for task in tasks:
            name = task.id if unique else f"{appearance}-{split}-{task.id}"
            rng = random.Random(f"{seed} {appearance} {task.statement} {task.program}")
            scenes = start_scenes(task.program, appearance, rng, starts)
            yield SynthesizedEntry(name, appearance, split, task.statement, task.program, scenes)
