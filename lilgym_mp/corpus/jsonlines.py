"""The project's corpus file format: JSON lines, a header and then one entry per line. See docs/corpus.md."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Iterator, Mapping
from functools import cache, cached_property
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple, cast

from lilgym_mp.corpus.faults import CorpusError, FaultLog
from lilgym_mp.corpus.records import (
    SCRATCH,
    SPLITS,
    TRAIN,
    JSONFault,
    Record,
    as_object,
    check_text,
    parse_json,
    read_text,
    shown,
)
from lilgym_mp.programs import compile_program
from lilgym_mp.scene import Scene
from lilgym_mp.scene.appearances import APPEARANCES
from lilgym_mp.scene.choices import listed

FORMAT = "lilgym_mp-corpus"
VERSION = 1
HEADER_KEYS = frozenset({"format", "version", "name"})
ENTRY_KEYS = frozenset({"id", "appearance", "split", "statement", "program", "starts"})
ENTRY_TEXTS = ("id", "appearance", "split", "statement", "program")
SECTIONS = "sections"  # header key of the builtin file: {"tower train": number of entries, ...} in file order
TAGS = "tags"  # optional entry key
START_KEYS = frozenset({"id", "label", "scene"})
CHOICES: dict[str, Collection[str]] = {"appearance": APPEARANCES, "split": SPLITS}


class Start(NamedTuple):
    """A FlipIt start scene as unparsed JSON, and the statement's truth value in it; None for what is a fault."""

    id: str | None
    label: bool | None
    scene: object


class Entry(NamedTuple):
    """One statement with its program and start scenes: one line of the file. What is None is a fault in the log."""

    where: str
    id: str | None
    appearance: str | None
    split: str | None
    statement: str | None
    program: str | None
    starts: tuple[Start, ...]
    tags: tuple[str, ...] = ()  # annotations of the statement by the corpus's authors
    is_valid: bool = True  # all but its starts

    def task_ids(self, start: str) -> tuple[str, ...]:
        ids = (self.id,) if start == SCRATCH else (scene.id for scene in self.starts)
        return tuple(filter(None, ids))

    def records(self, start: str) -> Iterator[Record]:
        """The entry's one Scratch task, or its FlipIt tasks."""
        if start == SCRATCH:
            yield Record(self.where, self.id, self.statement, self.program, is_valid=self.is_valid)
            return
        for scene in self.starts:
            where = f"{self.where}, start {scene.id!r}"
            yield Record(where, scene.id, self.statement, self.program, scene.label, scene.scene, True, self.is_valid)


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
        self.name = str(self.header.get("name"))

    @cached_property
    def entries(self) -> list[Entry]:
        """All entries that are objects, in file order."""
        return list(self._entries(self._lines[1:]))

    def section(self, appearance: str, split: str) -> list[Entry]:
        """The entries of an appearance and split, in file order; among those of `train` are faulty ones of no split."""
        if self.is_prevalidated:
            return [_trusted_entry(line) for line in self._section_lines(appearance, split)]
        return [each for each in self.entries if (each.appearance, each.split or TRAIN) == (appearance, split)]

    def _section_lines(self, appearance: str, split: str) -> list[str]:
        first = 1
        for name, count in cast("dict[str, int]", self.header[SECTIONS]).items():
            if name == f"{appearance} {split}":
                return [line for _, line in self._lines[first : first + count]]
            first += count
        return []

    def contents(self, start: str) -> str:
        """The appearances and splits that have tasks with such starts, in words."""
        found = {f"{each.appearance} {each.split}" for each in self.entries if each.is_valid and each.task_ids(start)}
        return f"{start} tasks of {', '.join(sorted(found))}" if found else f"no {start} tasks"

    def records(self, appearance: str, start: str, split: str) -> Iterator[Record]:
        for entry in self.section(appearance, split):
            yield from entry.records(start)

    def _where(self, number: int) -> str:
        return f"{self.path}, line {number}"

    def _checked_header(self, number: int, line: str) -> dict[str, object]:
        """Raises CorpusError for another format or version, whose entries cannot be read."""
        expected = f'the first line must be the header {{"format": "{FORMAT}", "version": {VERSION}, ...}}'
        try:
            header = as_object(parse_json(line))
        except JSONFault as fault:
            raise CorpusError(f"{self._where(number)}: {expected}; {fault}") from None
        if header is None or header.get("format") != FORMAT:
            raise CorpusError(f"{self._where(number)}: {expected}, not {shown(line)}")
        if missing := HEADER_KEYS - header.keys():
            self._faults.add(self._where(number), f"the header lacks {listed(missing)}")
        version = header.get("version", VERSION)
        if version != VERSION or isinstance(version, bool):
            raise CorpusError(f"{self._where(number)}: version {version!r} is unknown; this reads {VERSION}")
        for key in ("name", "licence"):
            if key in header and not _is_text(header[key]):
                self._faults.add(self._where(number), f"{key} must be a text, not {shown(header[key])}")
        return header

    def _entries(self, lines: Iterable[tuple[int, str]]) -> Iterator[Entry]:
        """The entries that are objects. Ids and start ids must be distinct."""
        first_seen: dict[str, str] = {}
        for number, line in lines:
            where = self._where(number)
            entry = _entry(where, line, self._faults)
            if entry is None:
                continue
            for name in filter(None, (entry.id, *(start.id for start in entry.starts))):
                if name in first_seen:
                    self._faults.add(entry.where, f"id {name!r} is already used: {first_seen[name]}")
                first_seen[name] = where
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


def _entry(where: str, line: str, faults: FaultLog) -> Entry | None:
    """The entry, with None for what cannot be used; None if it is no object. All its faults go to the log."""
    record = faults.check(where, lambda: _checked_object("an entry", parse_json(line)))
    if record is None:
        return None
    where = f"{where}, entry {record['id']!r}" if isinstance(record.get("id"), str) else where
    has_keys = faults.check(where, _check_keys, "an entry", record, ENTRY_KEYS, TAGS)
    texts = {key: faults.check(where, check_text, key, record[key]) for key in ENTRY_TEXTS if key in record}
    for key, choices in CHOICES.items():
        if texts.get(key) is not None:
            texts[key] = faults.check(where, _chosen, key, texts[key], choices)
    tags = faults.check(where, _tags, record.get(TAGS, []))
    starts = faults.check(where, _list, "starts", record.get("starts", [])) or []
    read_starts = tuple(start for value in starts if (start := _start(where, value, faults)) is not None)
    if texts.get("appearance") is None:  # otherwise programs and scenes are checked with the entry's tasks
        if (program := texts.get("program")) is not None:
            faults.check(where, compile_program, program)
        for start in read_starts:
            faults.check(where, Scene.from_json, start.scene)
    is_valid = has_keys is not None and tags is not None and None not in texts.values()
    name, appearance, split, statement, program = map(texts.get, ENTRY_TEXTS)
    return Entry(where, name, appearance, split, statement, program, read_starts, tags or (), is_valid)


def _checked_object(what: str, value: object) -> dict[str, object]:
    if (record := as_object(value)) is None:
        raise JSONFault(f"{what} must be a JSON object, not {shown(value)}")
    return record


def _chosen(key: str, value: str, choices: Collection[str]) -> str:
    if value not in choices:
        raise JSONFault(f"unknown {key} {value!r}; choose from {listed(choices)}")
    return value


def _list(key: str, value: object) -> list[object]:
    if not isinstance(value, list):
        raise JSONFault(f"{key} must be a list, not {shown(value)}")
    return cast("list[object]", value)


def _tags(value: object) -> tuple[str, ...]:
    tags = cast("list[object]", value if isinstance(value, list) else [value])
    if not isinstance(value, list) or not all(map(_is_text, tags)) or len(set(map(str, tags))) != len(tags):
        raise JSONFault(f"tags must be a list of distinct, non-blank texts, not {shown(tags)}")
    return tuple(map(str, tags))


def _start(where: str, value: object, faults: FaultLog) -> Start | None:
    record = faults.check(where, _checked_object, "a start", value)
    if record is None:
        return None
    where = f"{where}, start {record['id']!r}" if isinstance(record.get("id"), str) else where
    if faults.check(where, _check_keys, "a start", record, START_KEYS) is None:
        return None
    name = faults.check(where, check_text, "a start's id", record["id"])
    return Start(name, faults.check(where, _label, record["label"]), record["scene"])


def _label(value: object) -> bool:
    if not isinstance(value, bool):
        raise JSONFault(f"label must be true or false, not {shown(value)}")
    return value


def _check_keys(what: str, record: Mapping[str, object], keys: frozenset[str], may_have: str = "") -> bool:
    if set(record) - {may_have} != set(keys):
        also = f", and may have {may_have}" if may_have else ""
        raise JSONFault(f"{what} has keys {listed(record)}; it must have {listed(keys)}{also}")
    return True


def _is_text(value: object) -> bool:
    return isinstance(value, str) and bool(value.strip())
