"""Downloads the official corpus from its repository on GitHub, or from a directory on any web server.

Files are found by name anywhere in the repository's tree; Git object ids serve as checksums. No commit is pinned,
because that of the release is unknown: the installation records the commit, and `release` verifies the files' content.
"""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol, cast
from urllib.parse import quote

from lilgym_mp.corpus.faults import CorpusError
from lilgym_mp.corpus.official.fetching import Limits, checked_url, fetch
from lilgym_mp.corpus.official.installing import Installation, install, staging_area
from lilgym_mp.corpus.records import JSONFault, as_object, listed, parse_json, read_bytes, read_text

REPOSITORY = "lil-lab/lilgym"
NEWEST = "HEAD"  # the newest commit of the repository's default branch
API_URL, RAW_URL = "https://api.github.com", "https://raw.githubusercontent.com"

FileProgress = Callable[[str, int, int | None], None]  # name, bytes so far, total bytes if known


class RemoteFile(NamedTuple):
    url: str
    size: int | None = None
    git_sha1: str | None = None  # Git object id, a checksum of the content


class Listing(NamedTuple):
    revision: str | None
    files: dict[str, RemoteFile]  # keyed by released name


class Source(Protocol):
    """A server of released files."""

    def listing(self, names: Sequence[str], limits: Limits) -> Listing:
        """The URLs of the files. Raises CorpusError naming missing ones."""
        ...


@dataclass(frozen=True, slots=True)
class GitHub:
    """A repository on GitHub, at a commit, branch or tag."""

    revision: str = NEWEST
    repository: str = REPOSITORY
    api_url: str = API_URL
    raw_url: str = RAW_URL

    def __str__(self) -> str:
        return f"{self.repository} at {self.revision}"

    def listing(self, names: Sequence[str], limits: Limits) -> Listing:
        api = f"{self.api_url}/repos/{self.repository}"
        commit = _answer(f"{api}/commits/{quote(self.revision)}", limits).get("sha")
        if not isinstance(commit, str):
            raise CorpusError(f"{self}: GitHub's response contains no commit")
        tree = _answer(f"{api}/git/trees/{commit}?recursive=1", limits).get("tree")
        found: dict[str, RemoteFile] = {}
        for path, size, sha in _blobs(tree):
            name = path.rpartition("/")[2]
            file = RemoteFile(f"{self.raw_url}/{self.repository}/{commit}/{quote(path)}", size, sha)
            if name in found and found[name].git_sha1 != file.git_sha1:
                raise CorpusError(f"{self}: has several different files {name}: {found[name].url}, {file.url}")
            if name in names:
                found[name] = file
        missing = [name for name in names if name not in found]
        if missing:
            raise CorpusError(
                f"{self}: has no {listed(missing)}; obtain the files elsewhere and run `lilgym-mp data import`"
            )
        return Listing(commit, found)


@dataclass(frozen=True, slots=True)
class WebDirectory:
    """A directory on a web server with files under their released names, without checksums."""

    url: str

    def __str__(self) -> str:
        return self.url

    def listing(self, names: Sequence[str], limits: Limits) -> Listing:
        checked_url(self.url)
        return Listing(None, {name: RemoteFile(f"{self.url.rstrip('/')}/{name}") for name in names})


def download_official(
    source: Source,
    names: Sequence[str],
    target: Path,
    progress: FileProgress = lambda name, have, total: None,
    limits: Limits | None = None,
) -> Installation:
    """Downloads the named released files, verifies them, and installs them at `target`.

    Raises InterruptionError for a broken connection, CorpusError when trying again would not help.
    """
    limits = limits or Limits()
    with staging_area(target) as staged:
        listing = source.listing(names, limits)
        for name in names:
            _fetch_checked(name, listing.files[name], staged, progress, limits)
        return install(staged, target, str(source), listing.revision, names)


def _answer(url: str, limits: Limits) -> dict[str, object]:
    """The JSON object in the server's response."""
    try:
        with tempfile.TemporaryDirectory() as directory:
            path = Path(directory) / "answer"
            fetch(url, path, limits=limits)
            answer = as_object(parse_json(read_text(path).text))
    except JSONFault as fault:
        raise CorpusError(f"{url}: the response cannot be read: {fault}") from None
    if answer is None:
        raise CorpusError(f"{url}: the response is not a JSON object")
    return answer


def _blobs(tree: object) -> Iterator[tuple[str, int, str]]:
    """Path, size and object id of each file in GitHub's tree listing."""
    for entry in cast("list[object]", tree) if isinstance(tree, list) else []:
        match entry:
            case {"type": "blob", "path": str(path), "size": int(size), "sha": str(sha)}:
                yield path, size, sha
            case _:
                continue


def _fetch_checked(name: str, remote: RemoteFile, staged: Path, progress: FileProgress, limits: Limits) -> None:
    """Downloads a file and verifies its checksum."""
    path = staged / name
    fetch(remote.url, path, lambda have: progress(name, have, remote.size), limits)
    if remote.git_sha1 not in (None, found := _git_sha1(path)):
        raise CorpusError(f"{remote.url}: checksum mismatch: Git object id {found}, not {remote.git_sha1}")
    progress(name, path.stat().st_size, path.stat().st_size)


def _git_sha1(path: Path) -> str:
    content = read_bytes(path)
    return hashlib.sha1(b"blob %d\0" % len(content) + content, usedforsecurity=False).hexdigest()
