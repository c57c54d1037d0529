"""The recorded episodes and training runs of one directory: found by listing it, addressed by ids.

No part of a request is ever joined to a path: an id is looked up among those that the listing gave.
"""

from __future__ import annotations

import hashlib
import os
import threading
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from lilgym_mp.evaluation.episodes import SUFFIX, EpisodesError, Header, Recording, read_episodes, read_header
from lilgym_mp.learning.agent_files import AGENT_FILE

MOST_FILES = 2_000  # recordings and runs that are listed
MOST_DEPTH = 6  # directories below the one that is given
MOST_BYTES = 64 << 20  # of a file, compressed
KEPT = 6  # recordings that stay read

Stamp = tuple[int, int]  # time of change and size: a file that was written anew is read anew


class Unreadable(ValueError):
    """A file that is there but holds no whole recording; the message names it as the listing does."""


class FoundRecording(NamedTuple):
    """A file of recorded episodes; `fault` says why it cannot be read."""

    id: str
    name: str  # below the directory, without the suffix
    header: Header | None
    fault: str | None


class FoundRun(NamedTuple):
    """A run with an agent."""

    id: str
    name: str


@dataclass(frozen=True)
class _Place:
    path: Path
    name: str
    stamp: Stamp


class Recordings:
    """What is in a directory of runs; files that come or change while the server runs are seen."""

    def __init__(self, directory: Path | None) -> None:
        self.directory = directory
        self._headers: dict[str, tuple[Stamp, FoundRecording]] = {}
        self._read: OrderedDict[str, tuple[Stamp, Recording]] = OrderedDict()
        self._lock = threading.Lock()

    def list(self) -> list[FoundRecording]:
        """Every recording, by name. Damaged ones are among them, with their fault."""
        return [self._described(key, place) for key, place in self._places(SUFFIX).items()]

    def runs(self) -> dict[str, Path]:
        """The directory of each run with an agent, by id."""
        return {key: place.path.parent for key, place in self._places(AGENT_FILE).items()}

    def list_runs(self) -> list[FoundRun]:
        return [FoundRun(key, place.name) for key, place in self._places(AGENT_FILE).items()]

    def read(self, recording_id: str) -> Recording | None:
        """The recording of that id, None where there is none. Raises Unreadable."""
        place = self._places(SUFFIX).get(recording_id)
        if place is None:
            return None
        with self._lock:
            kept = self._read.get(recording_id)
            if kept is not None and kept[0] == place.stamp:
                self._read.move_to_end(recording_id)
                return kept[1]
            recording = _read(place)
            self._read[recording_id] = place.stamp, recording
            if len(self._read) > KEPT:
                self._read.popitem(last=False)
        return recording

    def _described(self, key: str, place: _Place) -> FoundRecording:
        kept = self._headers.get(key)
        if kept is None or kept[0] != place.stamp:
            header, fault = None, None
            try:
                header = read_header(place.path)
                fault = None if header else "its first line is not that of recorded episodes"
            except EpisodesError as error:
                fault = _without_directory(error, place)
            kept = self._headers[key] = place.stamp, FoundRecording(key, place.name, header, fault)
        return kept[1]

    def _places(self, suffix: str) -> dict[str, _Place]:
        if self.directory is None:
            return {}
        found: dict[str, _Place] = {}
        for path in _files(self.directory, suffix):
            try:
                status = path.stat()
            except OSError:
                continue  # removed since
            relative = path.relative_to(self.directory)
            name = str(relative.parent) if suffix == AGENT_FILE else str(relative).removesuffix(suffix)
            key = hashlib.sha256(os.fsencode(relative)).hexdigest()[:16]
            found[key] = _Place(path, name, (status.st_mtime_ns, status.st_size))
        return found


def _files(directory: Path, suffix: str) -> Iterator[Path]:
    """The files so named, in order; links to other directories are not followed."""
    count = 0
    for place, directories, files in os.walk(directory):
        directories.sort()
        if len(Path(place).relative_to(directory).parts) >= MOST_DEPTH:
            directories.clear()
        for name in sorted(files):
            if name == suffix or (suffix == SUFFIX and name.endswith(suffix)):
                count += 1
                if count > MOST_FILES:
                    return
                yield Path(place, name)


def _read(place: _Place) -> Recording:
    if place.stamp[1] > MOST_BYTES:
        raise Unreadable(f"{place.name} is larger than {MOST_BYTES >> 20} MiB; record fewer episodes in one file")
    try:
        return read_episodes(place.path)
    except EpisodesError as fault:
        raise Unreadable(_without_directory(fault, place)) from None


def _without_directory(fault: EpisodesError, place: _Place) -> str:
    return str(fault).replace(str(place.path), place.name)
