"""The project's own corpus file: a header line, then one entry a line. docs/corpus.md describes it."""

from __future__ import annotations

import gzip
import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple, cast

from lilgym_mp.appearances import APPEARANCES
from lilgym_mp.corpus.faults import CorpusError, FaultLog
from lilgym_mp.corpus.records import (
    SCRATCH,
    SPLITS,
    JSONFault,
    Record,
    as_object,
    listed,
    parse_json,
    read_text,
    shown,
)

FORMAT = "lilgym_mp-corpus"
VERSION = 1
HEADER_KEYS = frozenset({"format", "version", "name", "licence"})
ENTRY_KEYS = frozenset({"id", "appearance", "split", "statement", "program", "starts"})
ENTRY_TEXTS = ("id", "appearance", "split", "statement", "program")
START_KEYS = frozenset({"id", "label", "scene"})


class Start(NamedTuple):
    """A FlipIt start scene, unread, and the statement's truth value in it."""

    id: str
    label: bool
    scene: object


class Entry(NamedTuple):
    """One statement with its program and start scenes: one line of the file."""

    where: str
    id: str
    appearance: str
    split: str
    statement: str
    program: str
    starts: tuple[Start, ...]

    def records(self, start: str) -> Iterator[Record]:
        """The entry's one Scratch task, or its FlipIt tasks."""
        if start == SCRATCH:
            yield Record(self.where, self.id, self.statement, self.program)
            return
        for scene in self.starts:
            where = f"{self.where}, start {scene.id!r}"
            yield Record(where, scene.id, self.statement, self.program, scene.label, scene.scene)


class CorpusFile:
    """A corpus file, plain or gzip, read whole."""

    def __init__(self, path: Path, faults: FaultLog) -> None:
        """Raises CorpusError when the file cannot be read at all; other faults go to `faults`."""
        self.path = path
        text, self.sha256 = read_text(path)
        lines = [(number, line) for number, line in enumerate(text.split("\n"), start=1) if line.strip()]
        self.name = self._header(*lines[0])
        self.entries = list(self._entries(lines[1:], faults))

    def records(self, appearance: str, start: str, split: str) -> Iterator[Record]:
        for entry in self.entries:
            if entry.appearance == appearance and entry.split == split:
                yield from entry.records(start)

    def _where(self, number: int) -> str:
        return f"{self.path}, line {number}"

    def _header(self, number: int, line: str) -> str:
        """The corpus's name. Raises CorpusError: without a header nothing else can be trusted."""
        expected = f'the first line must be the header {{"format": "{FORMAT}", "version": {VERSION}, ...}}'
        try:
            header = as_object(parse_json(line))
        except JSONFault as fault:
            raise CorpusError(f"{self._where(number)}: {expected}; {fault}") from None
        if header is None or header.get("format") != FORMAT:
            raise CorpusError(f"{self._where(number)}: {expected}, not {shown(line)}")
        if missing := HEADER_KEYS - header.keys():
            raise CorpusError(f"{self._where(number)}: the header lacks {listed(missing)}")
        if header["version"] != VERSION or isinstance(header["version"], bool):
            raise CorpusError(f"{self._where(number)}: version {header['version']!r} is unknown; this reads {VERSION}")
        for key in ("name", "licence"):
            if not _is_text(header[key]):
                raise CorpusError(f"{self._where(number)}: {key} must be a text, not {shown(header[key])}")
        return str(header["name"])

    def _entries(self, lines: Iterable[tuple[int, str]], faults: FaultLog) -> Iterator[Entry]:
        """The well-formed entries whose ids, and their starts', are new."""
        first_seen: dict[str, str] = {}
        for number, line in lines:
            where = self._where(number)
            try:
                entry = _entry(where, parse_json(line))
            except JSONFault as fault:
                faults.add(where, str(fault))
                continue
            fresh = True
            for name in (entry.id, *(start.id for start in entry.starts)):
                if name in first_seen:
                    faults.add(entry.where, f"id {name!r} is taken already: {first_seen[name]}")
                    fresh = False
                first_seen[name] = where
            if fresh:
                yield entry


def _entry(where: str, value: object) -> Entry:
    record = _checked_keys("an entry", value, ENTRY_KEYS)
    for key in ENTRY_TEXTS:
        if not _is_text(record[key]):
            raise JSONFault(f"{key} must be a text that is not blank, not {shown(record[key])}")
    for key, choices in (("appearance", APPEARANCES), ("split", SPLITS)):
        if record[key] not in choices:
            raise JSONFault(f"unknown {key} {record[key]!r}; choose from {listed(choices)}")
    if not isinstance(record["starts"], list):
        raise JSONFault(f"starts must be a list, not {shown(record['starts'])}")
    starts = cast("list[object]", record["starts"])
    name, appearance, split, statement, program = (str(record[key]) for key in ENTRY_TEXTS)
    read_starts = tuple(_start(start) for start in starts)
    return Entry(f"{where}, entry {name!r}", name, appearance, split, statement, program, read_starts)


def _start(value: object) -> Start:
    record = _checked_keys("a start", value, START_KEYS)
    name, label = record["id"], record["label"]
    if not isinstance(name, str) or not name.strip():
        raise JSONFault(f"a start's id must be a text that is not blank, not {shown(name)}")
    if not isinstance(label, bool):
        raise JSONFault(f"start {name!r}: label must be true or false, not {shown(label)}")
    return Start(name, label, record["scene"])


def _checked_keys(what: str, value: object, keys: frozenset[str]) -> dict[str, object]:
    record = as_object(value)
    if record is None:
        raise JSONFault(f"{what} must be a JSON object, not {shown(value)}")
    if record.keys() != keys:
        raise JSONFault(f"{what} has keys {listed(record)}; it must have {listed(keys)}")
    return record


def _is_text(value: object) -> bool:
    return isinstance(value, str) and bool(value.strip())


def write_corpus(path: Path, name: str, licence: str, entries: Iterable[Mapping[str, object]]) -> None:
    """Write a corpus file, gzip when `path` ends in .gz; equal entries give equal bytes."""
    header = {"format": FORMAT, "version": VERSION, "name": name, "licence": licence}
    lines = (json.dumps(line, ensure_ascii=False, separators=(",", ":")) for line in (header, *entries))
    data = "".join(line + "\n" for line in lines).encode("utf-8")
    path.write_bytes(gzip.compress(data, compresslevel=9, mtime=0) if path.suffix == ".gz" else data)
