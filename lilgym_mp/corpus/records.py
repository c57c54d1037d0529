"""Tasks as a file has them, before their scenes and programs are looked at; what both file formats share."""

from __future__ import annotations

import gzip
import hashlib
import io
import json
import os
import stat
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple, cast

from lilgym_mp.corpus.faults import CorpusError

SCRATCH, FLIPIT = "scratch", "flipit"
STARTS = {SCRATCH: SCRATCH, FLIPIT: FLIPIT}
SPLITS = {split: split for split in ("train", "dev", "test")}
GZIP_MAGIC = b"\x1f\x8b"
MAX_BYTES = 256 * 1024 * 1024  # of one file, packed or unpacked; the largest of the release have some ten million


class Record(NamedTuple):
    """One task, unread: `label` and `scene` are None for a Scratch task."""

    where: str
    id: str
    statement: str
    program: str
    label: bool | None = None
    scene: object = None  # the released `structured_rep`


class FileText(NamedTuple):
    """A file's text and the SHA-256 of its bytes as they are on disk."""

    text: str
    sha256: str


def read_text(path: Path) -> FileText:
    """The UTF-8 text of a plain or gzip file.

    Raises CorpusError naming the file: missing, unreadable, too large, broken gzip, not UTF-8, empty.
    """
    data = read_bytes(path)
    sha256 = hashlib.sha256(data).hexdigest()
    if path.suffix == ".gz" or data.startswith(GZIP_MAGIC):
        data = _unzipped(path, data)
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as fault:
        raise CorpusError(f"{path}: not UTF-8 text: byte 0x{data[fault.start]:02x} at offset {fault.start}") from None
    if not text.strip():
        raise CorpusError(f"{path}: the file is empty")
    return FileText(text, sha256)


def read_bytes(path: Path) -> bytes:
    """The bytes of a regular file of at most MAX_BYTES.

    Raises CorpusError for any other, so that no device and no pipe is waited for and no memory is filled.
    """
    try:
        with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise CorpusError(f"{path}: cannot be read: not a regular file")
            data = file.read(MAX_BYTES + 1)
    except (OSError, ValueError) as fault:
        if isinstance(fault, CorpusError):
            raise
        raise CorpusError(f"{path}: cannot be read: {getattr(fault, 'strerror', None) or fault}") from None
    if len(data) > MAX_BYTES:
        raise CorpusError(f"{path}: has more than {MAX_BYTES} bytes; no corpus file may")
    return data


def _unzipped(path: Path, data: bytes) -> bytes:
    try:
        with gzip.GzipFile(fileobj=io.BytesIO(data)) as file:
            unzipped = file.read(MAX_BYTES + 1)
    except (OSError, EOFError, zlib.error) as fault:
        raise CorpusError(f"{path}: broken gzip file: {fault}") from None
    if len(unzipped) > MAX_BYTES:
        raise CorpusError(f"{path}: has more than {MAX_BYTES} bytes when unpacked; no corpus file may")
    return unzipped


class JSONFault(ValueError):
    """Text that is not one JSON value without repeated keys."""


def parse_json(text: str) -> object:
    """The JSON value in `text`. Raises JSONFault, for a key that stands twice in one object too."""
    try:
        return json.loads(text, object_pairs_hook=_object)
    except json.JSONDecodeError as fault:
        raise JSONFault(f"not JSON: {fault}") from None
    except RecursionError:
        raise JSONFault("not JSON of ours: nested too deeply") from None
    except ValueError as fault:
        raise JSONFault(str(fault)) from None


def _object(pairs: list[tuple[str, object]]) -> dict[str, object]:
    result = dict(pairs)
    if len(result) != len(pairs):
        keys = [key for key, _ in pairs]
        repeated = next(key for index, key in enumerate(keys) if key in keys[:index])
        raise ValueError(f"key {repeated!r} stands twice in one object")
    return result


def as_object(value: object) -> dict[str, object] | None:
    """`value` when it is a JSON object, else None."""
    return cast("dict[str, object]", value) if isinstance(value, dict) else None


def check_text(what: str, value: object) -> str:
    """`value`, a text to show people. Raises JSONFault for others, blank ones and those that a terminal might obey."""
    if not isinstance(value, str) or not value.strip():
        raise JSONFault(f"{what} must be a text that is not blank, not {shown(value)}")
    if not value.isprintable():
        raise JSONFault(f"{what} has characters that cannot be printed: {shown(value)}")
    return value


def listed(names: Iterable[object]) -> str:
    """Names sorted and joined, for errors."""
    return ", ".join(sorted(str(name) for name in names))


def shown(value: object) -> str:
    """`value` as errors show it: cut when long."""
    text = repr(value)
    return text if len(text) <= 80 else text[:77] + "..."
