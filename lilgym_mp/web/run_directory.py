"""Recordings and trained agents in the directory given by `--runs`, addressed by id.

No part of a request is ever joined to a path: ids are looked up among the files found by listing the directory.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from lilgym_mp.evaluation.episodes import SUFFIX, EpisodesError, Header, Recording, read_episodes, read_header
from lilgym_mp.learning.agent_files import AGENT_FILE

MAX_FILES = 2_000  # listed per kind
MAX_DEPTH = 6  # depth of nested directories
MAX_BYTES = 64 << 20  # compressed size of a recording
RECORDING_CACHE_SIZE = 6


class UnreadableRecording(ValueError):
    """A recording that is damaged or too large; the message contains its listed name, not its path."""


class RecordingFile(NamedTuple):
    """A file of recorded episodes; `fault` says why its header cannot be read."""

    id: str
    name: str  # path relative to the directory, without the suffix
    header: Header | None
    fault: str | None


class AgentRun(NamedTuple):
    """A training run with a saved agent."""

    id: str
    name: str


@dataclass(frozen=True)
class _FoundFile:
    path: Path
    name: str
    stamp: tuple[int, int]  # modification time in ns and size; a change invalidates cache entries


class RunDirectory:
    """Lists the directory on every call, so new and changed files appear without a restart; caches their content."""

    def __init__(self, directory: Path | None) -> None:
        self.directory = directory

    def recordings(self) -> list[RecordingFile]:
        """Every recording, sorted by name; damaged ones are included with their fault."""
        return [_described(key, file) for key, file in self._find(SUFFIX).items()]

    def agent_directories(self) -> dict[str, Path]:
        """The directory of each run with an agent, by id."""
        return {key: file.path.parent for key, file in self._find(AGENT_FILE).items()}

    def agent_runs(self) -> list[AgentRun]:
        return [AgentRun(key, file.name) for key, file in self._find(AGENT_FILE).items()]

    def read(self, recording_id: str) -> Recording | None:
        """The recording with that id, or None. Raises UnreadableRecording."""
        file = self._find(SUFFIX).get(recording_id)
        return None if file is None else _read(file)

    def _find(self, suffix: str) -> dict[str, _FoundFile]:
        """Files by id, a hash of the relative path."""
        if self.directory is None:
            return {}
        found: dict[str, _FoundFile] = {}
        for path in _files(self.directory, suffix):
            try:
                status = path.stat()
            except OSError:
                continue  # removed since it was listed
            relative = path.relative_to(self.directory)
            name = str(relative.parent) if suffix == AGENT_FILE else str(relative).removesuffix(suffix)
            key = hashlib.sha256(os.fsencode(relative)).hexdigest()[:16]
            found[key] = _FoundFile(path, name, (status.st_mtime_ns, status.st_size))
        return found


def _files(directory: Path, suffix: str) -> Iterator[Path]:
    """The files with this name or suffix, sorted; symbolic links to directories are not followed."""
    count = 0
    for parent, directories, files in os.walk(directory):
        directories.sort()
        if len(Path(parent).relative_to(directory).parts) >= MAX_DEPTH:
            directories.clear()
        for name in sorted(files):
            if name == suffix or (suffix == SUFFIX and name.endswith(suffix)):
                count += 1
                if count > MAX_FILES:
                    return
                yield Path(parent, name)


@lru_cache(maxsize=MAX_FILES)
def _described(key: str, file: _FoundFile) -> RecordingFile:
    try:
        header = read_header(file.path)
    except EpisodesError as error:
        return RecordingFile(key, file.name, None, _without_path(error, file))
    fault = None if header else "its first line is not the header of a recording"
    return RecordingFile(key, file.name, header, fault)


@lru_cache(maxsize=RECORDING_CACHE_SIZE)
def _read(file: _FoundFile) -> Recording:
    if file.stamp[1] > MAX_BYTES:
        raise UnreadableRecording(f"{file.name} is larger than {MAX_BYTES >> 20} MiB; record fewer episodes per file")
    try:
        return read_episodes(file.path)
    except EpisodesError as fault:
        raise UnreadableRecording(_without_path(fault, file)) from None


def _without_path(fault: EpisodesError, file: _FoundFile) -> str:
    return str(fault).replace(str(file.path), file.name)
