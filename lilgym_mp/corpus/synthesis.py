"""FlipIt start scenes for statements that have none: both truth values, in pairs that differ by one item.

A model that sees only how many items there are, or of what colours, cannot tell the two scenes of a pair apart.
"""

from __future__ import annotations

import os
import random
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from lilgym_mp.appearances import APPEARANCES
from lilgym_mp.corpus.exporting import LabelledScene, entry_json
from lilgym_mp.corpus.loading import load_all_tasks
from lilgym_mp.corpus.records import SCRATCH, SPLITS
from lilgym_mp.corpus.scenes import SAMPLERS
from lilgym_mp.programs import ProgramRuntimeError, compile_program
from lilgym_mp.scene import Scene

WALKS = 400  # random scenes from which a scene of the other truth value is looked for
WALK_LENGTH = 8  # changes of one item


class Entry(NamedTuple):
    """A statement with its synthesized start scenes."""

    id: str
    appearance: str
    split: str
    statement: str
    program: str
    starts: tuple[LabelledScene, ...]

    def to_json(self) -> dict[str, object]:
        """The entry as `write_corpus` takes it."""
        starts = ((f"{self.id}:{number}", start) for number, start in enumerate(self.starts, start=1))
        return entry_json(self.id, self.appearance, self.split, self.statement, self.program, starts)


def start_scenes(
    program: str, appearance: str, rng: random.Random, count: int, walks: int = WALKS
) -> tuple[LabelledScene, ...]:
    """At most `count` different scenes with items, by turns true and false of the program.

    As far as such pairs are found, a true scene and the false one after it differ by one item. Where `walks` random
    walks meet one truth value only, all scenes have that one; those where the program has no value are passed over.
    """
    chosen: dict[Scene, bool] = {}
    met: dict[bool, list[Scene]] = {True: [], False: []}
    for pair in _near_misses(program, appearance, rng, met, walks):
        if not any(start.scene in chosen for start in pair):
            chosen.update(pair)
        if len(chosen) >= count:
            break
    for value in (True, False) * count:
        others = (scene for scene in met[value] if scene not in chosen)
        if len(chosen) < count and (scene := next(others, None)) is not None:
            chosen[scene] = value
    return tuple(LabelledScene(scene, label) for scene, label in chosen.items())[:count]


def _near_misses(
    program: str, appearance: str, rng: random.Random, met: dict[bool, list[Scene]], walks: int
) -> Iterator[tuple[LabelledScene, LabelledScene]]:
    """Pairs of scenes that differ by one item and by the program's value; `met` takes what else the walks meet."""
    sampler = SAMPLERS[appearance]
    for _ in range(walks):
        scene = sampler.scene(rng)
        value = _value(program, scene)
        for _ in range(WALK_LENGTH):
            before, value_before = scene, value
            scene = sampler.changed(rng, before)
            value = _value(program, scene)
            if value_before is not None:
                met[value_before].append(before)
            if None not in (value, value_before) and value != value_before:
                true, false = (scene, before) if value else (before, scene)
                yield LabelledScene(true, label=True), LabelledScene(false, label=False)
                break


def _value(program: str, scene: Scene) -> bool | None:
    """The program's value; None where it has none."""
    try:
        return compile_program(program).evaluate(scene)
    except ProgramRuntimeError:
        return None


class Settings(NamedTuple):
    """What is to be synthesized, and from what seed."""

    appearances: Sequence[str] = tuple(APPEARANCES)
    splits: Sequence[str] = tuple(SPLITS)
    starts: int = 4  # for each statement
    seed: int = 0


def synthesize(corpus: str | os.PathLike[str], settings: Settings) -> Iterator[Entry]:
    """Every statement of a corpus's Scratch tasks with start scenes; the same seed gives the same scenes.

    A statement's scenes do not depend on which others there are. Ids are the tasks' own; where two tasks of the corpus
    have the same, every id is preceded by its appearance and split.
    Raises CorpusError as `load_tasks` does, NoTasksError when there are no Scratch tasks.
    """
    sets = list(load_all_tasks(corpus, settings.appearances, [SCRATCH], settings.splits))
    ids = [task.id for tasks in sets for task in tasks]
    unique = len(set(ids)) == len(ids)
    for tasks in sets:
        appearance, split = tasks.provenance.appearance, tasks.provenance.split
        for task in tasks:
            name = task.id if unique else f"{appearance}-{split}-{task.id}"
            rng = random.Random(f"{settings.seed} {appearance} {task.statement} {task.program}")
            starts = start_scenes(task.program, appearance, rng, settings.starts)
            yield Entry(name, appearance, split, task.statement, task.program, starts)
