"""Writing results so that a file is whole or not there, and finding out early that it cannot be."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any


class OutputError(ValueError):
    """A place that results cannot be written to."""


def writable_directory(path: Path) -> Path:
    """`path`, made if need be, once a file could be written there. Raises OutputError saying why not."""
    probe = path / f".write-test-{os.getpid()}"
    try:
        path.mkdir(parents=True, exist_ok=True)
        probe.write_bytes(b"")
        probe.unlink()
    except OSError as error:
        raise OutputError(f"cannot write results to {path}: {error.strerror or error}") from None
    return path


def writable_file(path: Path) -> Path:
    """`path`, once its directory is there and writable and it is no directory itself. Raises OutputError."""
    if path.is_dir():
        raise OutputError(f"cannot write results to {path}: it is a directory; name a file")
    writable_directory(path.parent)
    return path


def fresh_file(path: Path, *, force: bool) -> Path:
    """`path` as `writable_file` gives it, if there is no such file yet or `force` is said. Raises OutputError."""
    if path.is_file() and not force:
        raise OutputError(f"{path} exists; --force overwrites it")
    return writable_file(path)


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Lets `write` make a file beside `path`, which then takes its place in one move."""
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        write(unfinished)
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Writes `path` whole."""
    write_whole(path, lambda unfinished: unfinished.write_text(text, encoding="utf-8"))


def write_json(path: Path, data: Any) -> None:
    """Writes `path` whole, indented."""
    write_text(path, json.dumps(data, ensure_ascii=False, indent=1) + "\n")
