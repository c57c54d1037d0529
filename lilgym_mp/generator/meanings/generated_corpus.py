"""Generated corpora: `corpus="generated:3"` is level 3 with seed 0, `"generated:3:7"` level 3 with seed 7.

A hash of the program decides a statement's split, so that splits share no program, whatever their levels and seeds.
"""

from __future__ import annotations

import hashlib
import random
from collections import Counter
from collections.abc import Iterator
from functools import lru_cache
from itertools import accumulate
from typing import NamedTuple

from lilgym_mp.appearances import APPEARANCES
from lilgym_mp.choices import choose
from lilgym_mp.corpus.faults import CorpusError
from lilgym_mp.corpus.locations import is_generated
from lilgym_mp.corpus.records import SCRATCH
from lilgym_mp.corpus.scene_sampling import SAMPLERS
from lilgym_mp.corpus.tasks import Provenance, TaskSet
from lilgym_mp.corpus.tokens import normalised
from lilgym_mp.generator.meanings.sampling import LEVELS
from lilgym_mp.generator.meanings.start_selection import ScenePool
from lilgym_mp.generator.meanings.validation import Draft, Entry, drafts, is_trivial, validate_draft
from lilgym_mp.scene import Scene
from lilgym_mp.task import Task

SPLIT_SIZES = {"train": 250, "dev": 50, "test": 100}  # numbers of statements
SPLIT_WEIGHTS = {"train": 7, "dev": 1, "test": 2}  # shares of all programs
POOL_WALKS = 32
MAX_WORDINGS = 3  # wordings of one program
PATIENCE = 3_000  # drafts after which MAX_WORDINGS more are allowed, for levels with few programs
MAX_TRIVIAL_SHARE = 0.05  # share of statements that are true in the empty scene
CACHED_CORPORA = 16
NAME = "lilgym_mp generated corpus"


class CorpusSpec(NamedTuple):
    """The parameters of a generated corpus."""

    level: int
    seed: int = 0

    @classmethod
    def parse(cls, corpus: str) -> CorpusSpec:
        """The parameters in a corpus name. Raises CorpusError for a malformed name or an unknown level."""
        parts = corpus.split(":")[1:]
        if not is_generated(corpus) or len(parts) not in (1, 2) or not all(map(_is_number, parts)):
            raise CorpusError(
                f'no corpus {corpus!r}: a generated corpus is "generated:LEVEL" or "generated:LEVEL:SEED"'
            )
        spec = cls(*map(int, parts))
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
def generated_entries(spec: CorpusSpec, appearance: str, split: str, size: int | None = None) -> tuple[Entry, ...]:
    """The entries of one split of a generated corpus; `size`: how many, instead of SPLIT_SIZES.

    Raises ValueError for an unknown appearance.
    """
    choose("appearance", appearance, SAMPLERS)
    rng = random.Random(f"{spec.seed} {spec.level} {appearance}")  # the same in all splits, so that they share forms
    pool = ScenePool.sample(appearance, rng, POOL_WALKS)
    validation_rng = random.Random(rng.getrandbits(64))
    selection = Selection()
    for index, draft in enumerate(drafts(appearance, spec.level, rng)):
        max_wordings = MAX_WORDINGS * (1 + index // PATIENCE)
        if split_of(draft.program) == split and selection.accepts(draft, max_wordings):
            entry = validate_draft(draft, pool, validation_rng)
            if entry is not None:
                selection.add(entry)
        if len(selection.entries) == (size or SPLIT_SIZES[split]):
            break
    return tuple(selection.entries)


class Selection:
    """Entries with distinct statements, few wordings per program, and few statements true in the empty scene."""

    def __init__(self) -> None:
        self.entries: list[Entry] = []
        self._seen: set[str] = set()
        self._wordings: Counter[str] = Counter()
        self._trivial = 0

    def accepts(self, draft: Draft, max_wordings: int) -> bool:
        return (
            normalised(draft.statement) not in self._seen
            and self._wordings[draft.program] < max_wordings
            and (not is_trivial(draft) or self._trivial < MAX_TRIVIAL_SHARE * len(self.entries))
        )

    def add(self, entry: Entry) -> None:
        self.entries.append(entry)
        self._seen.add(normalised(entry.statement))
        self._wordings[entry.program] += 1
        self._trivial += entry.edits_from_empty == 0


def split_of(program: str) -> str:
    """The split of a program, by a hash of its text."""
    remainder = int.from_bytes(hashlib.sha256(program.encode()).digest()[:4]) % sum(SPLIT_WEIGHTS.values())
    return next(
        split
        for split, bound in zip(SPLIT_WEIGHTS, accumulate(SPLIT_WEIGHTS.values()), strict=True)
        if remainder < bound
    )


def _tasks(name: str, entry: Entry, appearance: str, start: str) -> Iterator[Task]:
    check_scene = APPEARANCES[appearance].check_scene
    if start == SCRATCH:
        yield Task(name, entry.statement, entry.program, True, check_scene(Scene.empty()))
        return
    for letter, (scene, label, _) in zip("abcdefgh", entry.starts, strict=False):
        yield Task(f"{name}-{letter}", entry.statement, entry.program, not label, check_scene(scene))


def _is_number(text: str) -> bool:
    return text.isascii() and text.isdigit()
