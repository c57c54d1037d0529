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
from typing import NamedTuple, cast
from urllib.parse import quote

from lilgym_mp.choices import listed
from lilgym_mp.corpus.faults import CorpusError
from lilgym_mp.corpus.official.fetching import checked_url, fetch
from lilgym_mp.corpus.official.installing import Installation, install, staging_area
from lilgym_mp.corpus.records import JSONFault, as_object, parse_json, read_bytes, read_text

REPOSITORY = "lil-lab/lilgym"
NEWEST = "HEAD"  # the newest commit of the repository's default branch
API_URL, RAW_URL = "https://api.github.com", "https://raw.githubusercontent.com"


class RemoteFile(NamedTuple):
    url: str
    git_sha1: str | None = None  # Git object id, a checksum of the content


class Listing(NamedTuple):
    revision: str | None
    files: dict[str, RemoteFile]  # keyed by released name


@dataclass(frozen=True, slots=True)
class GitHub:
    """A repository on GitHub, at a commit, branch or tag."""

    revision: str = NEWEST
    repository: str = REPOSITORY
    api_url: str = API_URL
    raw_url: str = RAW_URL

    def __str__(self) -> str:
        return f"{self.repository} at {self.revision}"

    def listing(self, names: Sequence[str]) -> Listing:
        """The URLs of the files. Raises CorpusError naming missing ones."""
        api = f"{self.api_url}/repos/{self.repository}"
        commit = _answer(f"{api}/commits/{quote(self.revision)}").get("sha")
        if not isinstance(commit, str):
            raise CorpusError(f"{self}: GitHub's response contains no commit")
        tree = _answer(f"{api}/git/trees/{commit}?recursive=1").get("tree")
        found: dict[str, RemoteFile] = {}
        for path, sha in _blobs(tree):
            name = path.rpartition("/")[2]
            file = RemoteFile(f"{self.raw_url}/{self.repository}/{commit}/{quote(path)}", sha)
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

    def listing(self, names: Sequence[str]) -> Listing:
        checked_url(self.url)
        return Listing(None, {name: RemoteFile(f"{self.url.rstrip('/')}/{name}") for name in names})


def download_official(
    source: GitHub | WebDirectory,
    names: Sequence[str],
    target: Path,
    on_file: Callable[[str, int], object] = lambda name, size: None,
) -> Installation:
    """Downloads the named released files, verifies them, and installs them at `target`; `on_file` is told of each.

    Raises InterruptionError for a broken connection, CorpusError when trying again would not help.
    """
    with staging_area(target) as staged:
        listing = source.listing(names)
        for name in names:
            _fetch_checked(listing.files[name], staged / name)
            on_file(name, (staged / name).stat().st_size)
        return install(staged, target, str(source), listing.revision, names)


def _answer(url: str) -> dict[str, object]:
    """The JSON object in the server's response."""
    try:
        with tempfile.TemporaryDirectory() as directory:
            path = Path(directory) / "answer"
            fetch(url, path)
            answer = as_object(parse_json(read_text(path)[0]))
    except JSONFault as fault:
        raise CorpusError(f"{url}: the response cannot be read: {fault}") from None
    if answer is None:
        raise CorpusError(f"{url}: the response is not a JSON object")
    return answer


def _blobs(tree: object) -> Iterator[tuple[str, str]]:
    """Path and object id of each file in GitHub's tree listing."""
    for entry in cast("list[object]", tree) if isinstance(tree, list) else []:
        match entry:
            case {"type": "blob", "path": str(path), "sha": str(sha)}:
                yield path, sha
            case _:
                continue


def _fetch_checked(remote: RemoteFile, path: Path) -> None:
    """Downloads a file and verifies its checksum."""
    fetch(remote.url, path)
    if remote.git_sha1 not in (None, found := _git_sha1(path)):
        raise CorpusError(f"{remote.url}: checksum mismatch: Git object id {found}, not {remote.git_sha1}")


def _git_sha1(path: Path) -> str:
    content = read_bytes(path)
    return hashlib.sha1(b"blob %d\0" % len(content) + content, usedforsecurity=False).hexdigest()
