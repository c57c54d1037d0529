"""Known properties of the files in lilGym's release 0.0.1, and verification of files against them.

The numbers of tasks and contexts are those of the paper (docs/spec.md, "Tasks"). Content digests are known for the
files that were available: Scratch train and dev, and FlipIt dev. The other files are verified by the number of entries,
their format, and labels that agree with the programs.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from enum import StrEnum
from pathlib import Path
from typing import NamedTuple

from lilgym_mp.corpus.faults import CorpusError, FaultLog
from lilgym_mp.corpus.records import SPLITS, Record
from lilgym_mp.corpus.released import ReleasedFile
from lilgym_mp.corpus.tasks import TaskReader, contexts

RELEASE = "0.0.1"
STATEMENT_COUNT = 2_661  # distinct statements of all splits and both appearances


class FileFacts(NamedTuple):
    """Known properties of a released file."""

    tasks: int
    contexts: int  # number reported in the paper
    content_sha256: str | None = None  # `content_digest`; None: no copy was available


FILE_FACTS: Mapping[str, FileFacts] = {
    "tower_scratch_train.json": FileFacts(989, 989, "0ad23ecc3d8dbe0a40aec5ab28c86edc7da5b7d4885cbc1a6e0433a2d01ae66d"),
    "tower_scratch_dev.json": FileFacts(163, 163, "94d169ef3717768aed1e6137559f81a4001305df93195da05761288bfa06abad"),
    "tower_scratch_test.json": FileFacts(324, 324),
    "tower_flipit_train.json": FileFacts(5_704, 1_910),
    "tower_flipit_dev.json": FileFacts(676, 317, "377ced6f14bba727d8b8e1f427d70e3b97bbc3c1bb21d1b2f4525536b2d7b8f9"),
    "tower_flipit_test.json": FileFacts(1_383, 619),
    "scatter_scratch_train.json": FileFacts(
        1_241, 1_241, "95a257f2fc84f9919a96e13661a7f6fc2972d4be9c8b1b7d9a535ebb69fb3484"
    ),
    "scatter_scratch_dev.json": FileFacts(87, 87, "9bf8e7aff8430179aecf000670573dc243bf72a7660145e1c5500badcbc0530a"),
    "scatter_scratch_test.json": FileFacts(155, 155),
    "scatter_flipit_train.json": FileFacts(6_696, 2_340),
    "scatter_flipit_dev.json": FileFacts(313, 164, "a7da2aa19f9258cbbfb9fab6e42a0ad77870f811e4b6d049fff9a6326030627d"),
    "scatter_flipit_test.json": FileFacts(591, 285),
}


class Proof(StrEnum):
    """How a file was verified."""

    CONTENT = "content digest"
    NUMBERS = "numbers and labels"


class OfficialFile(NamedTuple):
    """A verified file of the release."""

    name: str
    bytes: int
    sha256: str
    tasks: int
    contexts: int
    proof: Proof

    @property
    def remark(self) -> str | None:
        """A tolerated difference from the numbers in the paper."""
        reported = FILE_FACTS[self.name].contexts
        if self.contexts == reported:
            return None
        return f"{self.name} has {self.contexts} contexts, the paper reports {reported}"


def official_names(splits: Iterable[str] = SPLITS) -> list[str]:
    """The names of the released files of those splits."""
    chosen = tuple(f"_{split}.json" for split in splits)
    return [name for name in FILE_FACTS if name.endswith(chosen)]


def content_digest(records: Iterable[Record]) -> str:
    """Hex SHA-256 of the ordered records, independent of JSON whitespace and key order."""
    digest = hashlib.sha256()
    for record in records:
        content = [record.id, record.statement, record.program, record.label, record.scene]
        digest.update(json.dumps(content, sort_keys=True, separators=(",", ":")).encode() + b"\n")
    return digest.hexdigest()


def check_official_file(path: Path) -> OfficialFile:
    """Verifies a file under its released name.

    Raises CorpusError naming the file and the fault: a fault that `load_tasks` would raise, or another version.
    """
    appearance, start, _ = path.name.removesuffix(".json").split("_")
    facts, faults = FILE_FACTS[path.name], FaultLog(stop_at_first=True)
    file = ReleasedFile(path, start)
    records = list(file.records(faults))
    if len(records) != facts.tasks:
        raise CorpusError(f"{path}: has {len(records)} entries; the file of release {RELEASE} has {facts.tasks}")
    if facts.content_sha256 not in (None, content_digest(records)):
        raise CorpusError(
            f"{path}: is not the file of release {RELEASE}: it has as many entries, but statements, programs, labels "
            f"or scenes differ (content digest {content_digest(records)}, not {facts.content_sha256})"
        )
    tasks = list(TaskReader(appearance, faults).tasks(records))
    proof = Proof.NUMBERS if facts.content_sha256 is None else Proof.CONTENT
    return OfficialFile(path.name, path.stat().st_size, file.sha256, len(tasks), contexts(tasks), proof)
