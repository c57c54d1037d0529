"""The project's corpus file format: JSON lines, a header and then one entry per line. See docs/corpus.md."""

from __future__ import annotations

import gzip
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from functools import cache, cached_property
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple, cast

from lilgym_mp.appearances import APPEARANCES
from lilgym_mp.choices import listed
from lilgym_mp.corpus.faults import CorpusError, FaultLog
from lilgym_mp.corpus.records import (
    SCRATCH,
    SPLITS,
    JSONFault,
    Record,
    as_object,
    check_text,
    parse_json,
    read_text,
    shown,
)
from lilgym_mp.corpus.tasks import TaskSet
from lilgym_mp.scene import Scene

FORMAT = "lilgym_mp-corpus"
VERSION = 1
HEADER_KEYS = frozenset({"format", "version", "name", "licence"})
ENTRY_KEYS = frozenset({"id", "appearance", "split", "statement", "program", "starts"})
ENTRY_TEXTS = ("id", "appearance", "split", "statement", "program")
SECTIONS = "sections"  # header key of the builtin file: {"tower train": number of entries, ...} in file order
TAGS = "tags"  # optional entry key
START_KEYS = frozenset({"id", "label", "scene"})


class Start(NamedTuple):
    """A FlipIt start scene as unparsed JSON, and the statement's truth value in it."""

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
    tags: tuple[str, ...] = ()  # annotations of the statement by the corpus's authors

    def task_ids(self, start: str) -> tuple[str, ...]:
        return (self.id,) if start == SCRATCH else tuple(scene.id for scene in self.starts)

    def records(self, start: str) -> Iterator[Record]:
        """The entry's one Scratch task, or its FlipIt tasks."""
        if start == SCRATCH:
            yield Record(self.where, self.id, self.statement, self.program)
            return
        for scene in self.starts:
            where = f"{self.where}, start {scene.id!r}"
            yield Record(where, scene.id, self.statement, self.program, scene.label, scene.scene)


class CorpusFile:
    """A corpus file, plain or gzip.

    The file shipped with the package, recognised by its SHA-256, was validated when it was built. With `trust_shipped`,
    only the requested section of it is parsed, without validation.
    """

    def __init__(self, path: Path, faults: FaultLog, *, trust_shipped: bool = False) -> None:
        """Raises CorpusError when the file cannot be read or has no valid header; other faults go to `faults`."""
        self.path = path
        text, self.sha256 = read_text(path)
        self.is_prevalidated = trust_shipped and self.sha256 == shipped_sha256()
        self._lines = [(number, line) for number, line in enumerate(text.split("\n"), start=1) if line.strip()]
        self._faults = faults
        self.header = self._checked_header(*self._lines[0])
        self.name = str(self.header["name"])

    @cached_property
    def entries(self) -> list[Entry]:
        """All valid entries, in file order."""
        return list(self._entries(self._lines[1:]))

    def section(self, appearance: str, split: str) -> list[Entry]:
        """The valid entries of an appearance and split, in file order."""
        if self.is_prevalidated:
            return [_trusted_entry(line) for line in self._section_lines(appearance, split)]
        return [entry for entry in self.entries if entry.appearance == appearance and entry.split == split]

    def _section_lines(self, appearance: str, split: str) -> list[str]:
        first = 1
        for name, count in cast("dict[str, int]", self.header[SECTIONS]).items():
            if name == f"{appearance} {split}":
                return [line for _, line in self._lines[first : first + count]]
            first += count
        return []

    def records(self, appearance: str, start: str, split: str) -> Iterator[Record]:
        for entry in self.section(appearance, split):
            yield from entry.records(start)

    def _where(self, number: int) -> str:
        return f"{self.path}, line {number}"

    def _checked_header(self, number: int, line: str) -> dict[str, object]:
        """Raises CorpusError for an invalid header, without which nothing else can be trusted."""
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
        return header

    def _entries(self, lines: Iterable[tuple[int, str]]) -> Iterator[Entry]:
        """The well-formed entries whose ids and start ids are not duplicates."""
        first_seen: dict[str, str] = {}
        for number, line in lines:
            where = self._where(number)
            try:
                entry = _entry(where, parse_json(line))
            except JSONFault as fault:
                self._faults.add(where, str(fault))
                continue
            fresh = True
            for name in (entry.id, *(start.id for start in entry.starts)):
                if name in first_seen:
                    self._faults.add(entry.where, f"id {name!r} is already used: {first_seen[name]}")
                    fresh = False
                first_seen[name] = where
            if fresh:
                yield entry


@cache
def shipped_sha256() -> str:
    """The SHA-256 of the builtin corpus file that was validated when it was built."""
    return (files("lilgym_mp.data") / "builtin.sha256").read_text(encoding="ascii").strip()


def _trusted_entry(line: str) -> Entry:
    """`_entry` without validation."""
    record = json.loads(line)
    starts = tuple(Start(start["id"], start["label"], start["scene"]) for start in record["starts"])
    name, appearance, split, statement, program = (record[key] for key in ENTRY_TEXTS)
    return Entry("", name, appearance, split, statement, program, starts, tuple(record.get(TAGS, ())))


def _entry(where: str, value: object) -> Entry:
    record = _checked_keys("an entry", value, ENTRY_KEYS, may_have=TAGS)
    for key in ENTRY_TEXTS:
        check_text(key, record[key])
    for key, choices in (("appearance", APPEARANCES), ("split", SPLITS)):
        if record[key] not in choices:
            raise JSONFault(f"unknown {key} {record[key]!r}; choose from {listed(choices)}")
    if not isinstance(record["starts"], list):
        raise JSONFault(f"starts must be a list, not {shown(record['starts'])}")
    starts = cast("list[object]", record["starts"])
    name, appearance, split, statement, program = (str(record[key]) for key in ENTRY_TEXTS)
    read_starts = tuple(_start(start) for start in starts)
    tags = _tags(record[TAGS]) if TAGS in record else ()
    return Entry(f"{where}, entry {name!r}", name, appearance, split, statement, program, read_starts, tags)


def _tags(value: object) -> tuple[str, ...]:
    tags = cast("list[object]", value if isinstance(value, list) else [value])
    if not isinstance(value, list) or not all(map(_is_text, tags)) or len(set(map(str, tags))) != len(tags):
        raise JSONFault(f"tags must be a list of distinct, non-blank texts, not {shown(tags)}")
    return tuple(map(str, tags))


def _start(value: object) -> Start:
    record = _checked_keys("a start", value, START_KEYS)
    name, label = check_text("a start's id", record["id"]), record["label"]
    if not isinstance(label, bool):
        raise JSONFault(f"start {name!r}: label must be true or false, not {shown(label)}")
    return Start(name, label, record["scene"])


def _checked_keys(what: str, value: object, keys: frozenset[str], *, may_have: str = "") -> dict[str, object]:
    record = as_object(value)
    if record is None:
        raise JSONFault(f"{what} must be a JSON object, not {shown(value)}")
    if set(record) - {may_have} != set(keys):
        also = f", and may have {may_have}" if may_have else ""
        raise JSONFault(f"{what} has keys {listed(record)}; it must have {listed(keys)}{also}")
    return record


def _is_text(value: object) -> bool:
    return isinstance(value, str) and bool(value.strip())


class LabelledScene(NamedTuple):
    """A start scene and the statement's truth value in it."""

    scene: Scene
    label: bool


def entry_json(
    entry_id: str,
    appearance: str,
    split: str,
    statement: str,
    program: str,
    starts: Iterable[tuple[str, LabelledScene]],
) -> dict[str, object]:
    """A corpus file entry; `starts` are pairs of id and labelled scene."""
    return {
        "id": entry_id,
        "appearance": appearance,
        "split": split,
        "statement": statement,
        "program": program,
        "starts": [{"id": name, "label": start.label, "scene": start.scene.to_json()} for name, start in starts],
    }


def flipit_entries(tasks: TaskSet) -> Iterator[dict[str, object]]:
    """One entry per statement and program of the FlipIt tasks, with their start scenes under the task ids."""
    appearance, split = tasks.provenance.appearance, tasks.provenance.split
    starts: dict[tuple[str, str], list[tuple[str, LabelledScene]]] = {}
    for task in tasks:
        start = LabelledScene(task.start, not task.target)
        starts.setdefault((task.statement, task.program), []).append((task.id, start))
    for index, ((statement, program), found) in enumerate(starts.items(), start=1):
        yield entry_json(f"{appearance}/{split}/{index}", appearance, split, statement, program, found)


def write_corpus(
    path: str | os.PathLike[str],
    name: str,
    licence: str,
    entries: Iterable[Mapping[str, object]],
    sections: Mapping[str, int] | None = None,
) -> None:
    """Writes a corpus file, gzipped if `path` ends in .gz; equal entries give equal bytes."""
    header: dict[str, object] = {"format": FORMAT, "version": VERSION, "name": name, "licence": licence}
    if sections is not None:
        header[SECTIONS] = dict(sections)
    lines = (json.dumps(line, ensure_ascii=False, separators=(",", ":")) for line in (header, *entries))
    data = "".join(line + "\n" for line in lines).encode("utf-8")
    file = Path(path)
    file.write_bytes(gzip.compress(data, compresslevel=9, mtime=0) if file.suffix == ".gz" else data)
