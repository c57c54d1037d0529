"""Generated corpora: `corpus="generated:3"` is level 3 with seed 0, `"generated:3:7"` level 3 with seed 7.

The truth values of its program in fixed scenes decide a statement's split, so that splits share no meaning, whatever
their levels and seeds.
"""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Iterator
from functools import cache, lru_cache
from itertools import accumulate, islice
from random import Random
from typing import NamedTuple

from lilgym_mp.corpus.faults import CorpusError
from lilgym_mp.corpus.generator.pairs import LEVELS, statements
from lilgym_mp.corpus.locations import GENERATED
from lilgym_mp.corpus.records import SCRATCH
from lilgym_mp.corpus.scene_walks import ScenePool
from lilgym_mp.corpus.synthesis import near_misses
from lilgym_mp.corpus.tasks import Provenance, TaskSet
from lilgym_mp.corpus.tokens import normalised
from lilgym_mp.corpus.writing import LabelledScene
from lilgym_mp.programs import compile_program
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.scene.appearances import make_appearance

SPLIT_SIZES = {"train": 250, "dev": 50, "test": 100}  # numbers of statements
SPLIT_WEIGHTS = {"train": 7, "dev": 1, "test": 2}  # shares of all meanings
POOL_WALKS = 64
MEANING_SCENES = 24  # few, so that nearly equal meanings are not told apart either
START_PAIRS = 2
MAX_WORDINGS = 3  # wordings of one program
PATIENCE = 1_000  # statements after which MAX_WORDINGS more are allowed, for levels with few programs
MAX_TRIVIAL_SHARE = 0.05  # share of statements that are true in the empty scene
CACHED_CORPORA = 16
NAME = "lilgym_mp generated corpus"


class GeneratedStatement(NamedTuple):
    """A statement with its program and start scenes."""

    statement: str
    program: str
    starts: tuple[LabelledScene, ...]


class CorpusSpec(NamedTuple):
    """The parameters of a generated corpus."""

    level: int
    seed: int = 0

    @classmethod
    def parse(cls, corpus: str) -> CorpusSpec:
        """The parameters in a corpus name. Raises CorpusError for a malformed name or an unknown level."""
        found = re.fullmatch(rf"{GENERATED}:([0-9]+)(?::([0-9]+))?", corpus)
        if found is None:
            raise CorpusError(
                f'no corpus {corpus!r}: a generated corpus is "generated:LEVEL" or "generated:LEVEL:SEED"'
            )
        spec = cls(*map(int, found.groups("0")))
        if spec.level not in LEVELS:
            levels = ", ".join(map(str, LEVELS))
            raise CorpusError(f"no corpus {corpus!r}: unknown level {spec.level}; choose from {levels}")
        return spec


@lru_cache(maxsize=CACHED_CORPORA)
def load_generated(corpus: str, appearance: str, start: str, split: str) -> TaskSet:
    """The tasks of "generated:LEVEL" or "generated:LEVEL:SEED", deterministic in the arguments.

    Raises CorpusError for other names.
    """
    spec = CorpusSpec.parse(corpus)
    entries = generated_entries(spec, appearance, split)
    sha256 = hashlib.sha256(repr([(entry.statement, entry.program) for entry in entries]).encode()).hexdigest()
    provenance = Provenance(corpus, NAME, corpus, appearance, start, split, sha256)
    names = (f"{appearance}-{split}-{spec.level}-{spec.seed}-{number}" for number in range(1, len(entries) + 1))
    return TaskSet(
        (task for name, entry in zip(names, entries, strict=True) for task in _tasks(name, entry, appearance, start)),
        provenance,
    )


@lru_cache(maxsize=CACHED_CORPORA)
def generated_entries(
    spec: CorpusSpec, appearance: str, split: str, size: int | None = None
) -> tuple[GeneratedStatement, ...]:
    """The entries of one split of a generated corpus; `size`: how many, instead of SPLIT_SIZES.

    Statements are distinct, few have the same program, and few are true in the empty scene. Raises ValueError for an
    unknown appearance.
    """
    rng = Random(f"{spec.seed} {spec.level} {appearance}")  # the same in all splits, so that they share forms
    drafts = statements(appearance, spec.level, rng)
    starts_rng = Random(rng.getrandbits(64))
    pool = ScenePool.sample(appearance, starts_rng, POOL_WALKS)
    entries: list[GeneratedStatement] = []
    seen: set[str] = set()
    wordings = Counter[str]()
    trivial = 0  # true in the empty scene, where an immediate STOP succeeds
    for index, (statement, program) in enumerate(drafts):
        if normalised(statement) in seen or wordings[program] >= MAX_WORDINGS * (1 + index // PATIENCE):
            continue
        true_in_empty = compile_program(program).evaluate(Scene.empty())
        if (true_in_empty and trivial >= MAX_TRIVIAL_SHARE * len(entries)) or split_of(program, appearance) != split:
            continue
        if starts := _starts(program, pool, starts_rng):
            entries.append(GeneratedStatement(statement, program, starts))
            seen.add(normalised(statement))
            wordings[program] += 1
            trivial += true_in_empty
            if len(entries) == (size or SPLIT_SIZES[split]):
                break
    return tuple(entries)


def _starts(program: str, pool: ScenePool, rng: Random) -> tuple[LabelledScene, ...]:
    """START_PAIRS pairs of a true and a false scene, one legal edit apart; empty if there are none, or if no walk from
    the empty scene makes the program true."""
    pairs = list(islice(near_misses(program, pool.neighbours(rng)), START_PAIRS))
    if len(pairs) < START_PAIRS or not any(map(compile_program(program).evaluate, pool.from_empty())):
        return ()
    return tuple(start for pair in pairs for start in pair)


def split_of(program: str, appearance: str) -> str:
    """The split of a program, by a hash of its truth values in fixed scenes: programs of one meaning share a split.

    "train" for a program with a single truth value there, since rare meanings cannot be told apart.
    """
    evaluate = compile_program(program).evaluate
    truths = bytes(map(evaluate, _meaning_scenes(appearance)))
    if len(set(truths)) == 1:
        return "train"
    remainder = int.from_bytes(hashlib.sha256(truths).digest()[:4]) % sum(SPLIT_WEIGHTS.values())
    bounds = accumulate(SPLIT_WEIGHTS.values())
    return next(split for split, bound in zip(SPLIT_WEIGHTS, bounds, strict=True) if remainder < bound)


@cache
def _meaning_scenes(appearance: str) -> tuple[Scene, ...]:
    rng = Random(f"meanings {appearance}")
    return tuple(rng.sample(ScenePool.sample(appearance, rng, MEANING_SCENES).scenes, MEANING_SCENES))


def _tasks(name: str, entry: GeneratedStatement, appearance: str, start: str) -> Iterator[Task]:
    check_scene = make_appearance(appearance).check_scene
    if start == SCRATCH:
        yield Task(name, entry.statement, entry.program, True, check_scene(Scene.empty()))
        return
    for letter, (scene, label) in zip("abcdefgh", entry.starts, strict=False):
        yield Task(f"{name}-{letter}", entry.statement, entry.program, not label, check_scene(scene))
