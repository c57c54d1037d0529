"""The released format of the official lilGym corpus: one JSON file per appearance, start and split.

Source: docs/spec.md, "Tasks" (`{id: {"sentence", "lf"}}`; FlipIt files add "label" and "structured_rep").
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from lilgym_mp.corpus.faults import CorpusError, FaultLog, NoTasksError
from lilgym_mp.corpus.records import (
    FLIPIT,
    SPLITS,
    STARTS,
    JSONFault,
    Record,
    as_object,
    check_text,
    parse_json,
    read_text,
    shown,
)
from lilgym_mp.scene.appearances import APPEARANCES
from lilgym_mp.scene.choices import listed

NAME = "lilGym"
LABELS = {"true": True, "false": False}


def file_name(appearance: str, start: str, split: str) -> str:
    return f"{appearance}_{start}_{split}.json"


ALL_FILE_NAMES = tuple(
    file_name(appearance, start, split) for appearance in APPEARANCES for start in STARTS for split in SPLITS
)


def released_path(directory: Path, appearance: str, start: str, split: str) -> Path:
    """The released file of one configuration and split.

    Raises NoTasksError naming the missing file and the released files that exist.
    """
    path = directory / file_name(appearance, start, split)
    if not path.exists():
        existing = [name for name in ALL_FILE_NAMES if (directory / name).exists()]
        found = f"of the released files it has {listed(existing)}" if existing else "it has none of the released files"
        raise NoTasksError(f"{directory}: lacks {path.name}; {found}")
    return path


class ReleasedFile:
    """A released JSON file."""

    name = NAME
    is_prevalidated = False

    def __init__(self, path: Path, faults: FaultLog) -> None:
        """Raises CorpusError when the file is not a JSON object of entries; other faults go to `faults`."""
        self.path = path
        self._faults = faults
        text, self.sha256 = read_text(path)
        try:
            content = as_object(parse_json(text))
        except JSONFault as fault:
            raise CorpusError(f"{path}: {fault}") from None
        if content is None:
            raise CorpusError(f"{path}: must be one JSON object, {{id: entry}}")
        self.entries = content

    def contents(self, start: str) -> str:
        return "no valid task"

    def records(self, _appearance: str, start: str, _split: str) -> Iterator[Record]:
        """All records: the file has one configuration and split."""
        faults = self._faults
        for name, value in self.entries.items():
            where, entry = f"{self.path}, entry {name!r}", as_object(value)
            if entry is None:
                faults.add(where, f"an entry must be a JSON object, not {shown(value)}")
                continue
            statement, program = (faults.check(where, check_text, key, entry.get(key)) for key in ("sentence", "lf"))
            record = Record(where, faults.check(where, check_text, "an id", name), statement, program)
            if start == FLIPIT:
                label = faults.check(where, _label, entry.get("label"))
                record = record._replace(label=label, scene=entry.get("structured_rep"), is_flipit=True)
            yield record


def _label(value: object) -> bool:
    if check_text("label", value) not in LABELS:
        raise JSONFault(f"unknown label {value!r}; choose from {listed(LABELS)}")
    return LABELS[str(value)]
