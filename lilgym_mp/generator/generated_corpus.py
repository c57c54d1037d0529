"""The endless corpus: `corpus="generated:3"` is level 3 with seed 0, `"generated:3:7"` level 3 with seed 7.

The split that a statement falls into is decided by its program, so that no two splits, of whatever level and seed,
share a program or a wording of one.
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
from lilgym_mp.corpus.forms import normalised
from lilgym_mp.corpus.places import is_generated
from lilgym_mp.corpus.records import SCRATCH
from lilgym_mp.corpus.scenes import SAMPLERS
from lilgym_mp.corpus.tasks import Provenance, TaskSet
from lilgym_mp.generator.meaning_sampling import LEVELS
from lilgym_mp.generator.start_selection import ScenePool
from lilgym_mp.generator.validation import Draft, Entry, drafts, is_trivial, validate_draft
from lilgym_mp.scene import Scene
from lilgym_mp.task import Task

SIZES = {"train": 250, "dev": 50, "test": 100}  # statements
SPLIT_SHARES = {"train": 7, "dev": 1, "test": 2}  # of all programs
STOCK_SIZE = 32  # chains of scenes
WORDINGS = 3  # of one program, at most, while there are programs enough
PATIENCE = 3_000  # drafts, after which a small level may have WORDINGS more of each program
TRIVIAL_SHARE = 0.05  # of the statements may be true of the empty scene
CACHED_CORPORA = 16
NAME = "lilgym_mp generated corpus"


class CorpusSpec(NamedTuple):
    """Which generated corpus."""

    level: int
    seed: int = 0

    @classmethod
    def parse(cls, corpus: object) -> CorpusSpec | None:
        """The spec that a corpus name gives; None when it is no name of a generated corpus.

        Raises CorpusError for a level that there is not, or a seed that is not a whole number from 0 on.
        """
        if not isinstance(corpus, str) or not is_generated(corpus):
            return None
        parts = corpus.split(":")[1:]
        levels = ", ".join(map(str, LEVELS))
        if len(parts) not in (1, 2) or not all(part.isascii() and part.isdigit() for part in parts):
            raise CorpusError(
                f'no corpus {corpus!r}: a generated corpus is "generated:LEVEL" or "generated:LEVEL:SEED"'
            )
        spec = cls(*map(int, parts))
        if spec.level not in LEVELS:
            raise CorpusError(f"no corpus {corpus!r}: unknown level {spec.level}; choose from {levels}")
        return spec


def load_generated(corpus: str, appearance: str, start: str, split: str) -> TaskSet:
    """The tasks of a corpus named "generated:LEVEL" or "generated:LEVEL:SEED". Raises CorpusError for another name."""
    spec = CorpusSpec.parse(corpus)
    if spec is None:
        raise CorpusError(f"{corpus!r} names no generated corpus; names look like generated:1 or generated:1:7")
    return generated_tasks(corpus, spec, appearance, start, split)


def generated_tasks(corpus: str, spec: CorpusSpec, appearance: str, start: str, split: str) -> TaskSet:
    """The tasks of one configuration and split of a generated corpus: the same whenever and wherever it is made."""
    entries = generated_entries(spec, appearance, split)
    sha256 = hashlib.sha256(repr([(entry.statement, entry.program) for entry in entries]).encode()).hexdigest()
    provenance = Provenance(corpus, NAME, corpus, appearance, start, split, sha256)
    make = _scratch_tasks if start == SCRATCH else _flipit_tasks
    names = (f"{appearance}-{split}-{spec.level}-{spec.seed}-{number}" for number in range(1, len(entries) + 1))
    return TaskSet(
        (task for name, entry in zip(names, entries, strict=True) for task in make(name, entry, appearance)), provenance
    )


def _scratch_tasks(name: str, entry: Entry, appearance: str) -> Iterator[Task]:
    yield Task(name, entry.statement, entry.program, True, APPEARANCES[appearance].check_scene(Scene.empty()))


def _flipit_tasks(name: str, entry: Entry, appearance: str) -> Iterator[Task]:
    for letter, start in zip("abcdefgh", entry.starts, strict=False):
        scene = APPEARANCES[appearance].check_scene(start.scene)
        yield Task(f"{name}-{letter}", entry.statement, entry.program, not start.label, scene)


@lru_cache(maxsize=CACHED_CORPORA)
def generated_entries(spec: CorpusSpec, appearance: str, split: str) -> tuple[Entry, ...]:
    """The sound statements of a generated corpus's split. Raises ValueError for an unknown appearance."""
    choose("appearance", appearance, SAMPLERS)
    rng = random.Random(f"{spec.seed} {spec.level} {appearance}")  # for all splits, so that they share forms
    stock = ScenePool.sample(appearance, rng, STOCK_SIZE)
    choices = random.Random(rng.getrandbits(64))
    chosen = Selection()
    for number, draft in enumerate(drafts(appearance, spec.level, rng)):
        wordings = WORDINGS * (1 + number // PATIENCE)
        if split_of(draft.program) == split and chosen.wants(draft, wordings):
            entry = validate_draft(draft, stock, choices)
            if entry is not None:
                chosen.add(entry)
        if len(chosen.entries) == SIZES[split]:
            break
    return tuple(chosen.entries)


class Selection:
    """Entries no two of which have the same words, few the same program, and few are true of the empty scene."""

    def __init__(self) -> None:
        self.entries: list[Entry] = []
        self._seen: set[str] = set()
        self._wordings: Counter[str] = Counter()
        self._trivial = 0

    def wants(self, draft: Draft, most_wordings: int) -> bool:
        return (
            normalised(draft.statement) not in self._seen
            and self._wordings[draft.program] < most_wordings
            and (not is_trivial(draft) or self._trivial < TRIVIAL_SHARE * len(self.entries))
        )

    def add(self, entry: Entry) -> None:
        self.entries.append(entry)
        self._seen.add(normalised(entry.statement))
        self._wordings[entry.program] += 1
        self._trivial += entry.edits_from_empty == 0


def split_of(program: str) -> str:
    """The split that a program belongs to, by its text alone."""
    place = int.from_bytes(hashlib.sha256(program.encode()).digest()[:4]) % sum(SPLIT_SHARES.values())
    return next(
        split for split, bound in zip(SPLIT_SHARES, accumulate(SPLIT_SHARES.values()), strict=True) if place < bound
    )
