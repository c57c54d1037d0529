"""Atomic installation of the official corpus into the user's cache, with a manifest of its source and checksums."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import tempfile
from collections.abc import Generator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lilgym_mp.choices import listed
from lilgym_mp.corpus.faults import CorpusError, Fault
from lilgym_mp.corpus.official.release import RELEASE, OfficialFile, Proof, check_official_file
from lilgym_mp.corpus.records import JSONFault, as_object, parse_json, read_bytes, read_text

MANIFEST = "installed.json"
FORMAT, VERSION = "lilgym_mp-official", 1
FILES = "files"  # subdirectory of the staging area
NO_SPACE = (errno.ENOSPC, errno.EDQUOT)


@dataclass(frozen=True, slots=True)
class Installation:
    """An installed official corpus."""

    directory: Path
    source: str  # a directory or URL
    revision: str | None  # the commit, if known
    files: tuple[OfficialFile, ...]

    @property
    def remarks(self) -> list[str]:
        """Differences from the numbers in the paper."""
        return [file.remark for file in self.files if file.remark]


@contextmanager
def staging_area(target: Path) -> Generator[Path, None, None]:
    """A temporary directory beside `target` for the files of an installation. OSErrors become CorpusErrors."""
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f"{target.name}-", dir=target.parent) as area:
            staged = Path(area) / FILES
            staged.mkdir()
            yield staged
    except OSError as fault:
        if fault.errno in NO_SPACE:
            raise CorpusError(f"no space left on the disk of {target.parent}; nothing was installed") from None
        raise CorpusError(f"{fault.filename or target}: cannot be written: {fault.strerror or fault}") from None


def install(staged: Path, target: Path, source: str, revision: str | None, names: Sequence[str]) -> Installation:
    """Verifies the staged files and replaces `target` by them.

    Raises CorpusError naming the first file that is not of the release; `target` is then unchanged.
    """
    files: list[OfficialFile] = []
    for name in names:
        try:
            files.append(check_official_file(staged / name))
        except CorpusError as fault:
            raise CorpusError(str(fault).replace(f"{staged}{os.sep}", "")) from None
    installation = Installation(target, source, revision, tuple(files))
    _write_manifest(staged / MANIFEST, installation)
    _swap(staged, target)
    return installation


def read_installation(directory: Path) -> Installation | None:
    """The installation described by the directory's manifest, None without one. Raises CorpusError if it is invalid."""
    path = directory / MANIFEST
    if not path.is_file():
        return None
    try:
        record: Any = as_object(parse_json(read_text(path)[0])) or {}
        if (record["format"], record["version"]) != (FORMAT, VERSION):
            raise JSONFault(f"format {record['format']!r} {record['version']!r} is not {FORMAT!r} {VERSION}")
        files = [OfficialFile(**file)._replace(proof=Proof(file["proof"])) for file in record["files"]]
        return Installation(directory, str(record["source"]), record["revision"], tuple(files))
    except CorpusError:
        raise
    except (ValueError, KeyError, TypeError) as fault:
        raise CorpusError(f"{path}: cannot be read: {fault}") from None


def intact_installation(directory: Path, names: Sequence[str], source: str | None) -> Installation | None:
    """The existing installation if it has the named files, unmodified, and is from `source` (None: any source)."""
    with suppress(CorpusError):
        found = read_installation(directory)
        if found is not None and {file.name for file in found.files} >= set(names) and source in (None, found.source):
            return None if installation_faults(directory) else found
    return None


def installation_faults(directory: Path) -> list[Fault]:
    """The files missing or modified since installation; empty without a manifest."""
    installation = read_installation(directory)
    faults: list[Fault] = []
    for file in installation.files if installation else ():
        path = directory / file.name
        if not path.is_file():
            faults.append(Fault(str(path), "is missing since installation"))
        elif hashlib.sha256(read_bytes(path)).hexdigest() != file.sha256:
            faults.append(Fault(str(path), "has changed since installation (its SHA-256 differs)"))
    return faults


def import_official(directory: Path, names: Sequence[str], target: Path) -> Installation:
    """Installs the named released files from anywhere in a directory or checkout.

    Raises CorpusError naming the files that are missing, ambiguous, or not of the release.
    """
    if not directory.is_dir():
        raise CorpusError(f"{directory}: no such directory; name a checkout of lilGym or a directory of its JSON files")
    found = _paths_by_name(directory, names)
    missing = [name for name in names if name not in found]
    if missing:
        raise CorpusError(
            f"{directory}: lacks {listed(missing)}; it has {listed(found) or 'none of the released files'}"
        )
    source = str(directory.resolve())
    with staging_area(target) as staged:
        for name, path in found.items():
            (staged / name).write_bytes(read_bytes(path))
        return install(staged, target, source, None, names)


def _paths_by_name(directory: Path, names: Sequence[str]) -> dict[str, Path]:
    """The paths of the files by name. Raises CorpusError for several files of one name with different contents."""
    found: dict[str, Path] = {}
    for parent, _, present in sorted(os.walk(directory)):
        for name in set(names).intersection(present):
            path = Path(parent) / name
            if name in found and read_bytes(path) != read_bytes(found[name]):
                raise CorpusError(f"{directory}: has several different files {name}: {found[name]}, {path}")
            found.setdefault(name, path)
    return found


def _write_manifest(path: Path, installation: Installation) -> None:
    record = {
        "format": FORMAT,
        "version": VERSION,
        "release": RELEASE,
        "source": installation.source,
        "revision": installation.revision,
        "files": [file._asdict() for file in installation.files],
    }
    path.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


def _swap(staged: Path, target: Path) -> None:
    """Renames `staged` to `target`; the previous `target` moves beside `staged`, to be removed with it."""
    previous = staged.with_name("previous")
    if target.exists():
        target.rename(previous)
    try:
        staged.rename(target)
    except OSError:
        if previous.exists():
            previous.rename(target)
        raise
