"""Atomic writing of result files, and early checks that they can be written."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

SUFFIX = ".episodes.jsonl.gz"  # of files of recorded episodes


class EpisodesError(ValueError):
    """A file does not contain recorded episodes, or is damaged."""


class OutputError(ValueError):
    """Results cannot be written to a path."""


def writable_directory(path: Path) -> Path:
    """Creates the directory if needed and checks that files can be written to it. Raises OutputError if not."""
    probe = path / f".write-test-{os.getpid()}"
    try:
        path.mkdir(parents=True, exist_ok=True)
        probe.write_bytes(b"")
        probe.unlink()
    except OSError as error:
        raise OutputError(f"cannot write results to {path}: {error.strerror or error}") from None
    return path


def writable_file(path: Path) -> Path:
    """Checks that `path` can be written, and creates its directory. Raises OutputError if not."""
    if path.is_dir():
        raise OutputError(f"cannot write results to {path}: it is a directory; name a file")
    writable_directory(path.parent)
    return path


def fresh_file(path: Path, *, force: bool) -> Path:
    """As `writable_file`; also raises OutputError if the file exists, unless `force`."""
    if path.is_file() and not force:
        raise OutputError(f"{path} exists; --force overwrites it")
    return writable_file(path)


def write_atomically(path: Path, write: Callable[[Path], object]) -> None:
    """Has `write` create a temporary file in the same directory, with the same suffix, then renames it to `path`."""
    temporary = path.with_name(f".{os.getpid()}.tmp.{path.name}")
    try:
        write(temporary)
        temporary.replace(path)
    except OSError as error:  # writing to an open file raises errors that do not name it
        error.filename = str(path)
        raise
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Writes the text atomically."""
    write_atomically(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def write_json(path: Path, data: Any) -> None:
    """Writes indented JSON atomically."""
    write_text(path, json.dumps(data, ensure_ascii=False, indent=1) + "\n")
