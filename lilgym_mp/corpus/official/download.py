"""Downloads the official corpus from its repository on GitHub, or from a directory on any web server.

Files are found by name anywhere in the repository's tree; Git object ids serve as checksums. No commit is pinned,
because that of the release is unknown: the installation records the commit, and `release` verifies the files' content.
"""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol, cast
from urllib.parse import quote

from lilgym_mp.corpus.faults import CorpusError
from lilgym_mp.corpus.official.fetching import RetryPolicy, checked_url, fetch, fetch_text
from lilgym_mp.corpus.official.installing import Installation, install, staging_area
from lilgym_mp.corpus.records import JSONFault, as_object, listed, parse_json, read_bytes

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

    def listing(self, names: Sequence[str], retries: RetryPolicy) -> Listing:
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

    def listing(self, names: Sequence[str], retries: RetryPolicy) -> Listing:
        api = f"{self.api_url}/repos/{self.repository}"
        commit = _answer(f"{api}/commits/{quote(self.revision)}", retries).get("sha")
        if not isinstance(commit, str):
            raise CorpusError(f"{self}: GitHub's response contains no commit")
        tree = _answer(f"{api}/git/trees/{commit}?recursive=1", retries).get("tree")
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

    def listing(self, names: Sequence[str], retries: RetryPolicy) -> Listing:
        checked_url(self.url)
        return Listing(None, {name: RemoteFile(f"{self.url.rstrip('/')}/{name}") for name in names})


def download_official(
    source: Source,
    names: Sequence[str],
    target: Path,
    progress: FileProgress = lambda name, have, total: None,
    retries: RetryPolicy | None = None,
) -> Installation:
    """Downloads the named released files, verifies them, and installs them at `target`.

    After a broken connection or Ctrl-C, partial files are kept beside `target`, and the next call for the same source
    resumes. Raises InterruptionError for a broken connection, CorpusError when retrying would not help.
    """
    retries = retries or RetryPolicy()
    with staging_area(target, str(source)) as staged:
        listing = source.listing(names, retries)
        _demand_space(staged, listing.files.values())
        for name in names:
            _fetch_checked(name, listing.files[name], staged, progress, retries)
        return install(staged, target, str(source), listing.revision, names)


def _answer(url: str, retries: RetryPolicy) -> dict[str, object]:
    """The JSON object in the server's response."""
    try:
        answer = as_object(parse_json(fetch_text(url, retries)))
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


def _demand_space(staged: Path, files: Iterable[RemoteFile]) -> None:
    needed = sum(file.size or 0 for file in files)
    free = shutil.disk_usage(staged).free
    if free < needed:
        raise CorpusError(f"no space left on the disk of {staged}: the files need {needed} bytes, {free} are free")


def _fetch_checked(name: str, remote: RemoteFile, staged: Path, progress: FileProgress, retries: RetryPolicy) -> None:
    """Downloads a file and verifies its checksum, unless it exists; a corrupt resumed download is restarted once."""
    whole, part = staged / name, staged / f"{name}.part"
    if whole.exists() and _is_right(whole, remote):
        return
    whole.unlink(missing_ok=True)
    resumed = part.exists()
    fetch(remote.url, part, lambda have, total: progress(name, have, total or remote.size), retries)
    if resumed and not _is_right(part, remote):
        part.unlink()
        fetch(remote.url, part, lambda have, total: progress(name, have, total or remote.size), retries)
    if not _is_right(part, remote):
        found = _git_sha1(part)
        part.unlink()
        raise CorpusError(f"{remote.url}: checksum mismatch: Git object id {found}, not {remote.git_sha1}")
    part.rename(whole)


def _is_right(path: Path, remote: RemoteFile) -> bool:
    return remote.git_sha1 is None or _git_sha1(path) == remote.git_sha1


def _git_sha1(path: Path) -> str:
    content = read_bytes(path)
    return hashlib.sha1(b"blob %d\0" % len(content) + content, usedforsecurity=False).hexdigest()
