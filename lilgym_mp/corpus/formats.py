"""The project's own file format, read to records: JSON lines, a header, then one entry per line (docs/corpus.md)."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterable, Mapping
from functools import cache, partial
from importlib.resources import files
from itertools import islice, product
from pathlib import Path
from typing import Any, NamedTuple, cast

from lilgym_mp.corpus.faults import CorpusError, Fault, checked
from lilgym_mp.corpus.records import (
    FLIPIT,
    SCRATCH,
    SPLITS,
    STARTS,
    TRAIN,
    Record,
    as_object,
    check_text,
    parse_object,
    read_text,
    shown,
)
from lilgym_mp.scene.appearances import APPEARANCES
from lilgym_mp.scene.choices import choose, listed

FORMAT = "lilgym_mp-corpus"
VERSION = 1
HEADER_KEYS = frozenset({"format", "version", "name"})
ENTRY_KEYS = frozenset({"id", "appearance", "split", "statement", "starts"})
START_KEYS = frozenset({"id", "label", "scene"})
SECTIONS = "sections"  # header key of the builtin file: {"tower train": number of entries, ...} in file order
# Optional entry keys
PROGRAM = "program"
TAGS = "tags"
LENIENT_APPEARANCE = "scatter"  # of entries of an unknown one: its scenes may be those of any

Configuration = tuple[str, str, str]  # appearance, start and split


class Source(NamedTuple):
    """A corpus file, with unchecked records by configuration and split."""

    path: Path
    name: str  # the corpus's own name
    sha256: str
    records: Mapping[Configuration, list[Record]]
    is_prevalidated: bool = False

    def contents(self, start: str) -> str:
        """The appearances and splits that have tasks with such starts, in words."""
        found = sorted(
            f"{appearance} {split}" for (appearance, kind, split), has in self.records.items() if has and kind == start
        )
        return f"{start} tasks of {', '.join(found)}" if found else f"no {start} tasks"


def read_corpus_file(path: Path, faults: list[Fault], wanted: Configuration | None = None) -> Source:
    """A corpus file, plain or gzip. Raises CorpusError when it cannot be read or has no valid header.

    The file shipped with the package, recognised by its SHA-256, was validated when it was built. If one configuration
    is `wanted`, only the section of it that has this is parsed, without validation.
    """
    text, sha256 = read_text(path)
    lines = ((f"{path}, line {number}", line) for number, line in enumerate(text.split("\n"), start=1) if line.strip())
    header = _checked_header(*next(lines), faults)
    records: dict[Configuration, list[Record]] = {key: [] for key in product(APPEARANCES, STARTS, SPLITS)}
    name = str(header.get("name"))
    if wanted is None or sha256 != shipped_sha256():
        _add_entries(lines, records, faults)
        return Source(path, name, sha256, records)
    for section, count in cast("dict[str, int]", header[SECTIONS]).items():
        for _, line in islice(lines, count):
            if section == f"{wanted[0]} {wanted[2]}":
                scratch, starts = _records("", json.loads(line), faults)
                records[wanted] += starts if wanted[1] == FLIPIT else [scratch]
    return Source(path, name, sha256, records, is_prevalidated=True)


@cache
def shipped_sha256() -> str:
    """The SHA-256 of the builtin corpus file that was validated when it was built."""
    return (files("lilgym_mp.data") / "builtin.sha256").read_text(encoding="ascii").strip()


def _checked_header(where: str, line: str, faults: list[Fault]) -> dict[str, object]:
    """Raises CorpusError for another format or version, whose entries cannot be read."""
    expected = f'the first line must be the header {{"format": "{FORMAT}", "version": {VERSION}, ...}}'
    try:
        header = parse_object("the header", line)
    except ValueError as fault:
        raise CorpusError(f"{where}: {expected}; {fault}") from None
    if header.get("format") != FORMAT:
        raise CorpusError(f"{where}: {expected}, not {shown(line)}")
    if missing := HEADER_KEYS - header.keys():
        faults.append(Fault(where, f"the header lacks {listed(missing)}"))
    version = header.get("version", VERSION)
    if version != VERSION or isinstance(version, bool):
        raise CorpusError(f"{where}: version {version!r} is unknown; this reads {VERSION}")
    for key in ("name", "licence"):
        if key in header and not _is_text(header[key]):
            faults.append(Fault(where, f"{key} must be a text, not {shown(header[key])}"))
    return header


def _add_entries(
    lines: Iterable[tuple[str, str]], records: dict[Configuration, list[Record]], faults: list[Fault]
) -> None:
    """Adds the records of all entries that are objects. Ids of entries and starts must be distinct."""
    first_seen: dict[str, str] = {}
    for line_where, line in lines:
        entry = checked(faults, line_where, parse_object, "an entry", line)
        if entry is None:
            continue
        where = f"{line_where}, entry {entry['id']!r}" if isinstance(entry.get("id"), str) else line_where
        faults_before = len(faults)
        checked(faults, where, _check_keys, "an entry", entry, ENTRY_KEYS, (PROGRAM, TAGS))
        structure = {
            key: checked(faults, where, check, key, entry[key]) for key, check in CHECKS.items() if key in entry
        }
        entry |= {"starts": structure.get("starts") or (), TAGS: structure.get(TAGS) or ()}
        is_valid = len(faults) == faults_before
        scratch, starts = _records(where, entry, faults)
        for record in (scratch, *starts):
            if isinstance(record.id, str):
                if record.id in first_seen:
                    faults.append(Fault(where, f"id {record.id!r} is already used: {first_seen[record.id]}"))
                first_seen[record.id] = line_where
        place = structure.get("appearance") or LENIENT_APPEARANCE, structure.get("split") or TRAIN
        records[place[0], SCRATCH, place[1]].append(scratch._replace(is_valid=is_valid))
        records[place[0], FLIPIT, place[1]] += (start._replace(is_valid=is_valid) for start in starts)


def _records(where: str, entry: Mapping[str, Any], faults: list[Fault]) -> tuple[Record, list[Record]]:
    """The Scratch task of an entry, and its FlipIt tasks, of those starts that are well formed."""
    name, statement, program = map(entry.get, ("id", "statement", PROGRAM))
    tags = tuple(entry.get(TAGS, ()))
    scratch = Record(where, where, name, statement, program, tags=tags, has_program=program is not None)
    flipit = scratch._replace(is_flipit=True)
    starts: list[Record] = []
    for start in entry["starts"]:
        if checked(faults, where, as_object, "a start", start) is not None:
            place = f"{where}, start {start.get('id')!r}"
            if checked(faults, place, _check_keys, "a start", start, START_KEYS):
                starts.append(flipit._replace(where=place, **start))
    return scratch, starts


# Checks of values: they return the value, or raise ValueError


def _choice(choices: Mapping[str, object], key: str, value: object) -> str:
    choose(key, check_text(key, value), choices)
    return str(value)


def _list(key: str, value: object) -> list[object]:
    if not isinstance(value, list):
        raise ValueError(f"{key} must be a list, not {shown(value)}")
    return cast("list[object]", value)


def _tags(key: str, value: object) -> tuple[str, ...]:
    tags = cast("list[object]", value if isinstance(value, list) else [value])
    if not isinstance(value, list) or not all(map(_is_text, tags)) or len(set(map(str, tags))) != len(tags):
        raise ValueError(f"{key} must be a list of distinct, non-blank texts, not {shown(tags)}")
    return tuple(map(str, tags))


def _check_keys(what: str, record: Mapping[str, object], keys: Collection[str], optional: Collection[str] = ()) -> bool:
    if set(record) - set(optional) != set(keys):
        also = f", and may have {listed(optional)}" if optional else ""
        raise ValueError(f"{what} has keys {listed(record)}; it must have {listed(keys)}{also}")
    return True


def _is_text(value: object) -> bool:
    return isinstance(value, str) and bool(value.strip())


CHECKS: Mapping[str, Callable[[str, object], Any]] = {  # of the values that say what tasks an entry has
    "appearance": partial(_choice, APPEARANCES),
    "split": partial(_choice, SPLITS),
    "starts": _list,
    TAGS: _tags,
}
