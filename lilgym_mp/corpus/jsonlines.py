"""The project's corpus file format: JSON lines, a header and then one entry per line. See docs/corpus.md."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterator, Mapping
from functools import cache, cached_property, partial
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple, cast

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
ENTRY_TEXTS = ("id", "appearance", "split", "statement", "program")
SECTIONS = "sections"  # header key of the builtin file: {"tower train": number of entries, ...} in file order
TAGS = "tags"  # optional entry key


class Entry(NamedTuple):
    """One statement with its tasks: one line of the file. What is None is a fault in the log."""

    appearance: str | None
    split: str | None
    scratch: Record
    flipit: tuple[Record, ...]

    def records(self, start: str) -> tuple[Record, ...]:
        return (self.scratch,) if start == SCRATCH else self.flipit


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
        self.header = self._checked_header(*self._lines.pop(0))
        self.name = str(self.header.get("name"))

    @cached_property
    def entries(self) -> list[Entry]:
        """All entries that are objects, in file order. Ids and start ids must be distinct."""
        found: list[Entry] = []
        first_seen: dict[str, str] = {}
        for number, line in self._lines:
            entry = _entry(self._where(number), line, self._faults)
            if entry is None:
                continue
            found.append(entry)
            for name in (record.id for record in (entry.scratch, *entry.flipit) if record.id):
                if name in first_seen:
                    self._faults.add(entry.scratch.where, f"id {name!r} is already used: {first_seen[name]}")
                first_seen[name] = self._where(number)
        return found

    def records(self, appearance: str, start: str, split: str) -> Iterator[Record]:
        """The records of a configuration, in file order; among those of `train` are faulty ones of no split."""
        if self.is_prevalidated:
            entries = map(_trusted_entry, self._section(appearance, split))
        else:
            entries = [each for each in self.entries if (each.appearance, each.split or TRAIN) == (appearance, split)]
        for entry in entries:
            yield from entry.records(start)

    def _section(self, appearance: str, split: str) -> Iterator[str]:
        """The lines of the section of the builtin file."""
        first = 0
        for name, count in cast("dict[str, int]", self.header[SECTIONS]).items():
            if name == f"{appearance} {split}":
                yield from (line for _, line in self._lines[first : first + count])
            first += count

    def contents(self, start: str) -> str:
        """The appearances and splits that have tasks with such starts, in words."""
        valid = (each for each in self.entries if each.scratch.is_valid)
        found = {f"{each.appearance} {each.split}" for each in valid if any(one.id for one in each.records(start))}
        return f"{start} tasks of {', '.join(sorted(found))}" if found else f"no {start} tasks"

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


@cache
def shipped_sha256() -> str:
    """The SHA-256 of the builtin corpus file that was validated when it was built."""
    return (files("lilgym_mp.data") / "builtin.sha256").read_text(encoding="ascii").strip()


def _trusted_entry(line: str) -> Entry:
    """`_entry` without validation."""
    entry = json.loads(line)
    name, appearance, split, statement, program = (entry[key] for key in ENTRY_TEXTS)
    tags = tuple(entry.get(TAGS, ()))
    flipit = (
        Record("", start["id"], statement, program, start["label"], start["scene"], is_flipit=True, tags=tags)
        for start in entry["starts"]
    )
    return Entry(appearance, split, Record("", name, statement, program, tags=tags), tuple(flipit))


def _entry(where: str, line: str, faults: FaultLog) -> Entry | None:
    """The entry, with None for what cannot be used; None if it is no object. All its faults go to the log."""
    entry = faults.check(where, lambda: _object("an entry", parse_json(line)))
    if entry is None:
        return None
    where = f"{where}, entry {entry['id']!r}" if isinstance(entry.get("id"), str) else where
    has_keys = faults.check(where, _check_keys, "an entry", entry, ENTRY_FIELDS.keys() - {TAGS}, TAGS)
    values = {key: faults.check(where, check, key, entry[key]) for key, check in ENTRY_FIELDS.items() if key in entry}
    starts: list[object] = values.pop("starts", None) or []
    is_valid = has_keys is not None and None not in values.values()
    name, appearance, split, statement, program = map(values.get, ENTRY_TEXTS)
    scratch = Record(where, name, statement, program, is_valid=is_valid, tags=values.get(TAGS) or ())
    flipit = tuple(start for value in starts if (start := _start(scratch, value, faults)) is not None)
    if appearance is None:  # otherwise programs and scenes are checked with the entry's tasks
        if program is not None:
            faults.check(where, compile_program, program)
        for start in flipit:
            faults.check(where, Scene.from_json, start.scene)
    return Entry(appearance, split, scratch, flipit)


def _start(scratch: Record, value: object, faults: FaultLog) -> Record | None:
    """The task from a start scene."""
    start = faults.check(scratch.where, _object, "a start", value)
    if start is None:
        return None
    where = f"{scratch.where}, start {start.get('id')!r}"
    if faults.check(where, _check_keys, "a start", start, {"id", "label", "scene"}) is None:
        return None
    name = faults.check(where, check_text, "a start's id", start["id"])
    label = faults.check(where, _label, start["label"])
    return scratch._replace(where=where, id=name, label=label, scene=start["scene"], is_flipit=True)


# Checks of values: they return the value, or raise JSONFault


def _object(what: str, value: object) -> dict[str, object]:
    if (record := as_object(value)) is None:
        raise JSONFault(f"{what} must be a JSON object, not {shown(value)}")
    return record


def _choice(choices: Collection[str], key: str, value: object) -> str:
    if check_text(key, value) not in choices:
        raise JSONFault(f"unknown {key} {value!r}; choose from {listed(choices)}")
    return str(value)


def _list(key: str, value: object) -> list[object]:
    if not isinstance(value, list):
        raise JSONFault(f"{key} must be a list, not {shown(value)}")
    return cast("list[object]", value)


def _tags(key: str, value: object) -> tuple[str, ...]:
    tags = cast("list[object]", value if isinstance(value, list) else [value])
    if not isinstance(value, list) or not all(map(_is_text, tags)) or len(set(map(str, tags))) != len(tags):
        raise JSONFault(f"{key} must be a list of distinct, non-blank texts, not {shown(tags)}")
    return tuple(map(str, tags))


def _label(value: object) -> bool:
    if not isinstance(value, bool):
        raise JSONFault(f"label must be true or false, not {shown(value)}")
    return value


def _check_keys(what: str, record: Mapping[str, object], keys: Collection[str], may_have: str = "") -> bool:
    if set(record) - {may_have} != set(keys):
        also = f", and may have {may_have}" if may_have else ""
        raise JSONFault(f"{what} has keys {listed(record)}; it must have {listed(keys)}{also}")
    return True


def _is_text(value: object) -> bool:
    return isinstance(value, str) and bool(value.strip())


ENTRY_FIELDS: Mapping[str, Callable[[str, object], Any]] = {
    **dict.fromkeys(ENTRY_TEXTS, check_text),
    "appearance": partial(_choice, APPEARANCES),
    "split": partial(_choice, SPLITS),
    "starts": _list,
    TAGS: _tags,
}
