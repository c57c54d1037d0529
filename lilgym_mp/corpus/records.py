"""Unchecked task records, and file and JSON reading shared by both corpus formats."""

from __future__ import annotations

import gzip
import hashlib
import json
import re
import zlib
from collections import Counter
from pathlib import Path
from typing import NamedTuple, cast

from lilgym_mp.corpus.faults import CorpusError

SCRATCH = "scratch"
FLIPIT = "flipit"
STARTS = {SCRATCH: SCRATCH, FLIPIT: FLIPIT}
TRAIN = "train"
SPLITS = {split: split for split in (TRAIN, "dev", "test")}
GZIP_MAGIC = b"\x1f\x8b"

_OTHER_SPACES = re.compile(r"[^\S ]+")


class Record(NamedTuple):
    """One task as it stands in a file, unchecked."""

    where: str
    entry: str  # where its statement and program are
    id: object
    statement: object
    program: object
    label: object = None
    scene: object = None  # the released `structured_rep`
    is_flipit: bool = False
    is_valid: bool = True  # whether the rest of its entry is
    has_program: bool = True
    tags: tuple[str, ...] = ()  # annotations of the statement by the corpus's authors


def read_text(path: Path) -> tuple[str, str]:
    """The UTF-8 text of a plain or gzip file, without a byte-order mark, and the SHA-256 of its bytes on disk.

    Raises CorpusError for a file that is missing, unreadable, broken gzip, not UTF-8 or empty.
    """
    data = read_bytes(path)
    return decoded(data, path), hashlib.sha256(data).hexdigest()


def decoded(data: bytes, path: object) -> str:
    """The text in the bytes of the file `path`. Raises CorpusError as `read_text`."""
    try:
        text = (gzip.decompress(data) if data.startswith(GZIP_MAGIC) else data).decode("utf-8-sig")
    except UnicodeDecodeError as fault:
        raise CorpusError(
            f"{path}: not UTF-8 text: byte 0x{fault.object[fault.start]:02x} at offset {fault.start}"
        ) from None
    except (OSError, EOFError, zlib.error) as fault:
        raise CorpusError(f"{path}: broken gzip file: {fault}") from None
    if not text.strip():
        raise CorpusError(f"{path}: the file is empty")
    return text


def read_bytes(path: Path) -> bytes:
    """The bytes of a file. Raises CorpusError if it cannot be read."""
    try:
        return path.read_bytes()
    except (OSError, ValueError) as fault:
        raise CorpusError(f"{path}: cannot be read: {getattr(fault, 'strerror', None) or fault}") from None


def parse_object(what: str, text: str) -> dict[str, object]:
    """The JSON object in `text`. Raises ValueError for invalid JSON, duplicate keys or another value."""
    try:
        return as_object(what, json.loads(text, object_pairs_hook=unique_keys))
    except json.JSONDecodeError as fault:
        raise ValueError(f"not JSON: {fault}") from None
    except RecursionError:
        raise ValueError("not JSON that can be read: nested too deeply") from None


def unique_keys(pairs: list[tuple[str, object]]) -> dict[str, object]:
    """The object of these pairs, for `json.loads`. Raises ValueError for a duplicate key."""
    result = dict(pairs)
    if len(result) != len(pairs):
        repeated = next(key for key, count in Counter(key for key, _ in pairs).items() if count > 1)
        raise ValueError(f"duplicate key {repeated!r} in one object")
    return result


def as_object(what: str, value: object) -> dict[str, object]:
    """`value` if it is a JSON object. Raises ValueError otherwise."""
    if not isinstance(value, dict):
        raise ValueError(f"{what} must be a JSON object, not {shown(value)}")
    return cast("dict[str, object]", value)


def check_prose(what: str, value: object) -> str:
    """`check_text` after tabs, line ends and other white space became spaces, and at both ends nothing."""
    if isinstance(value, str) and not value.isprintable():
        value = _OTHER_SPACES.sub(" ", value).strip()
    return check_text(what, value)


def check_text(what: str, value: object) -> str:
    """`value` if it is a non-blank string of printable characters (safe for terminals). Raises ValueError otherwise."""
    if not isinstance(value, str) or not value.strip():
        raise ValueError(f"{what} must be a non-blank text, not {shown(value)}")
    if not value.replace("\u200c", "").replace("\u200d", "").isprintable():  # joiners, which some scripts need
        raise ValueError(f"{what} has unprintable characters: {shown(value)}")
    return value


def shown(value: object) -> str:
    """The repr of `value`, truncated, for error messages."""
    text = repr(value)
    return text if len(text) <= 80 else text[:77] + "..."
