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

    def __init__(self, path: Path, start: str) -> None:
        """Raises CorpusError when the file is not a JSON object of entries."""
        self.path = path
        self.start = start
        text, self.sha256 = read_text(path)
        try:
            content = as_object(parse_json(text))
        except JSONFault as fault:
            raise CorpusError(f"{path}: {fault}") from None
        if content is None:
            raise CorpusError(f"{path}: must be one JSON object, {{id: entry}}")
        self.content = content

    def contents(self, start: str) -> str:
        return "no valid task"

    def records(self, faults: FaultLog) -> Iterator[Record]:
        for name, value in self.content.items():
            where = f"{self.path}, entry {name!r}"
            try:
                yield _record(where, name, value, self.start)
            except JSONFault as fault:
                faults.add(where, str(fault))


def _record(where: str, name: str, value: object, start: str) -> Record:
    entry = as_object(value)
    if entry is None:
        raise JSONFault(f"an entry must be a JSON object, not {shown(value)}")
    check_text("an id", name)
    statement, program = _text(entry, "sentence"), _text(entry, "lf")
    if start != FLIPIT:
        return Record(where, name, statement, program)
    label = _text(entry, "label")
    if label not in LABELS:
        raise JSONFault(f"unknown label {label!r}; choose from {listed(LABELS)}")
    return Record(where, name, statement, program, LABELS[label], entry.get("structured_rep"))


def _text(entry: dict[str, object], key: str) -> str:
    return check_text(key, entry.get(key))
