"""Atomic writing of result files, early checks that they can be written, and the types of what is read from them."""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields
from functools import cache
from itertools import count
from pathlib import Path
from types import UnionType
from typing import Any, TypeVar, Union, cast, get_args, get_origin, get_type_hints

from lilgym_mp.scene.arrays import AnyMapping

try:
    import fcntl
except ModuleNotFoundError:  # Windows, where directories are not locked
    fcntl = None

SUFFIX = ".episodes.jsonl.gz"  # of files of recorded episodes
LOCK_FILE = ".lock"  # in a directory that a process is writing results to
MAX_NUMBER = 1e15
LONGEST_SUFFIX = 32


class EpisodesError(ValueError):
    """A file does not contain recorded episodes, or is damaged."""


class OutputError(ValueError):
    """Results cannot be written to a path."""


def writable_directory(path: Path) -> Path:
    """Creates the directory if needed and checks that files can be written to it. Raises OutputError if not."""
    _check_name(path)
    probe = path / f".write-test-{os.getpid()}"
    try:
        path.mkdir(parents=True, exist_ok=True)
        probe.write_bytes(b"")
        probe.unlink()
    except OSError as error:
        raise OutputError(f"cannot write results to {path}: {error.strerror or error}") from None
    return path


@contextmanager
def locked(directory: Path) -> Iterator[None]:
    """Within the block no other process can have the directory. Raises OutputError naming the one that does."""
    if fcntl is None:
        yield
        return
    path = directory / LOCK_FILE
    with path.open("a+", encoding="utf-8") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)  # until the file is closed, or the process killed
        except BlockingIOError:
            file.seek(0)
            raise OutputError(f"{directory} is in use by process {file.read()}; wait for it, or stop it") from None
        if os.fstat(file.fileno()).st_nlink == 0:  # its last owner removed it before it was locked here
            with locked(directory):
                yield
            return
        file.truncate(0)
        file.write(str(os.getpid()))
        file.flush()
        try:
            yield
        finally:
            path.unlink(missing_ok=True)


def _check_name(path: Path) -> None:
    """Raises OutputError for a name that cannot be written in files and messages."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise OutputError(f"cannot write results to {str(path)!r}: the name is not UTF-8") from None


def numbered(path: Path) -> Iterator[Path]:
    """`path`, path-2, path-3, ... without end."""
    yield path
    yield from (path.with_name(f"{path.name}-{number}") for number in count(2))


def fresh_file(path: Path, *, force: bool) -> Path:
    """Checks that `path` can be written, and creates its directory.

    Raises OutputError if not, and if the file exists, unless `force`.
    """
    if path.is_file() and not force:
        raise OutputError(f"{path} exists; --force overwrites it")
    if path.exists() and not path.is_file():  # a device, a pipe, a directory: not to be replaced
        raise OutputError(f"cannot write results to {path}: it is not a regular file; name a file")
    path = path.resolve()  # a link stays one
    writable_directory(path.parent)
    _check_name(path)
    return path


def write_atomically(path: Path, write: Callable[[Path], object]) -> None:
    """Has `write` create a temporary file in the same directory, with the same suffix, then renames it to `path`.

    A link is followed, and an existing file's mode kept.
    """
    target = path.resolve()
    temporary = target.with_name(f".{os.getpid()}.tmp.{target.name[-LONGEST_SUFFIX:]}")  # no longer than names may be
    try:
        write(temporary)
        if target.exists():
            temporary.chmod(stat.S_IMODE(target.stat().st_mode))
        temporary.replace(target)
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


def read_json(path: Path) -> Any:
    """What a JSON file contains. Raises OSError, ValueError."""
    return json.loads(path.read_text(encoding="utf-8"))


def json_line(data: Any) -> str:
    """A line of a file of JSON lines."""
    return json.dumps(data, ensure_ascii=False, default=list) + "\n"


def write_lines(path: Path, rows: Iterable[Any]) -> None:
    """Writes JSON lines atomically."""
    write_text(path, "".join(map(json_line, rows)))


def read_lines(path: Path) -> list[Any]:
    """What the lines of a file of JSON lines contain, without an unfinished last one. Raises OSError, ValueError."""
    *lines, _ = path.read_text(encoding="utf-8").split("\n")
    return [json.loads(line) for line in lines if line]


Record = TypeVar("Record")
_hints = cache(get_type_hints)


def checked(record: Record, hints: AnyMapping | None = None) -> Record:
    """The dataclass instance itself. Raises ValueError naming a field whose value is not of its type.

    Whole numbers must not be negative, and numbers must be finite and no larger than MAX_NUMBER. `hints`: the types of
    the fields, by default as its class states them.
    """
    hints = hints or _hints(type(record))
    for each in fields(cast("Any", record)):
        value = getattr(record, each.name)
        if not _is_of(value, hints[each.name]):
            raise ValueError(f"{each.name} must be of type {each.type}, not {value!r:.80}")
    return record


# Reads the types that the dataclasses state, because checks written out by field would be a second list of the 35
# fields of Header and Episode, and a library that checks types would be a dependency for these two. Reading an episode
# takes 128 us, of which checking takes 75.
def _is_of(value: Any, hint: Any) -> bool:
    arguments = get_args(hint)
    if get_origin(hint) in (UnionType, Union):
        return any(_is_of(value, each) for each in arguments)
    if get_origin(hint) is tuple:
        return isinstance(value, tuple) and all(_is_of(each, arguments[0]) for each in value)
    if get_origin(hint) in (Mapping, dict):
        return isinstance(value, dict) and all(_is_of(each, arguments[1]) for each in value.values())
    if hint in (int, float):
        return type(value) in (int, hint) and (0 if hint is int else -MAX_NUMBER) <= value < MAX_NUMBER
    return hint is Any or isinstance(value, hint)
