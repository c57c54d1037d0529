"""Downloading the official corpus: from its repository on GitHub, or from any directory on a web server.

The files are looked up by name in the repository's listing, wherever in it they lie; the listing's object ids are
checksums of their bytes. No commit of the release was known when this was written, so none is pinned: the commit that
was found is recorded at installation, and `official` says what is demanded of the files' content.
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
from lilgym_mp.corpus.official.fetching import Patience, checked_url, fetch, fetch_text
from lilgym_mp.corpus.official.installing import Installation, install, staging_area
from lilgym_mp.corpus.records import JSONFault, as_object, listed, parse_json, read_bytes

REPOSITORY = "lil-lab/lilgym"
NEWEST = "HEAD"  # the newest commit of the repository's default branch
API_URL, RAW_URL = "https://api.github.com", "https://raw.githubusercontent.com"

FileProgress = Callable[[str, int, int | None], None]  # name, bytes so far, bytes of all where known


class RemoteFile(NamedTuple):
    url: str
    size: int | None = None
    git_sha1: str | None = None  # Git's object id: a checksum of the bytes


class Listing(NamedTuple):
    revision: str | None
    files: dict[str, RemoteFile]  # by released name


class Source(Protocol):
    """Where released files can be had over HTTP."""

    def listing(self, names: Sequence[str], patience: Patience) -> Listing:
        """Where the files are. Raises CorpusError naming those that are missing."""
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

    def listing(self, names: Sequence[str], patience: Patience) -> Listing:
        api = f"{self.api_url}/repos/{self.repository}"
        commit = _answer(f"{api}/commits/{quote(self.revision)}", patience).get("sha")
        if not isinstance(commit, str):
            raise CorpusError(f"{self}: GitHub's answer names no commit")
        tree = _answer(f"{api}/git/trees/{commit}?recursive=1", patience).get("tree")
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
                f"{self}: has no {listed(missing)}; get the files some other way and run `lilgym-mp data import`"
            )
        return Listing(commit, found)


@dataclass(frozen=True, slots=True)
class WebDirectory:
    """A directory on a web server that has the files under their released names; no checksums come with them."""

    url: str

    def __str__(self) -> str:
        return self.url

    def listing(self, names: Sequence[str], patience: Patience) -> Listing:
        checked_url(self.url)
        return Listing(None, {name: RemoteFile(f"{self.url.rstrip('/')}/{name}") for name in names})


def download_official(
    source: Source,
    names: Sequence[str],
    target: Path,
    progress: FileProgress = lambda name, have, total: None,
    patience: Patience | None = None,
) -> Installation:
    """Downloads the released files called `names`, checks them, and installs them at `target`.

    What a broken connection or Ctrl-C leaves is kept beside `target` and used by the next call for the same source.
    Raises InterruptionError for that, CorpusError for everything that another try would not mend.
    """
    patience = patience or Patience()
    with staging_area(target, str(source)) as staged:
        listing = source.listing(names, patience)
        _demand_space(staged, listing.files.values())
        for name in names:
            _fetch_checked(name, listing.files[name], staged, progress, patience)
        return install(staged, target, str(source), listing.revision, names)


def _answer(url: str, patience: Patience) -> dict[str, object]:
    """The JSON object that the server answers."""
    try:
        answer = as_object(parse_json(fetch_text(url, patience)))
    except JSONFault as fault:
        raise CorpusError(f"{url}: the answer cannot be read: {fault}") from None
    if answer is None:
        raise CorpusError(f"{url}: the answer is no JSON object")
    return answer


def _blobs(tree: object) -> Iterator[tuple[str, int, str]]:
    """Path, size and object id of each file in a listing as GitHub gives it."""
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


def _fetch_checked(name: str, remote: RemoteFile, staged: Path, progress: FileProgress, patience: Patience) -> None:
    """Downloads a file whose checksum is right, unless it is there already; once more when what was kept spoilt it."""
    whole, part = staged / name, staged / f"{name}.part"
    if whole.exists() and _is_right(whole, remote):
        return
    whole.unlink(missing_ok=True)
    resumed = part.exists()
    fetch(remote.url, part, lambda have, total: progress(name, have, total or remote.size), patience)
    if resumed and not _is_right(part, remote):
        part.unlink()
        fetch(remote.url, part, lambda have, total: progress(name, have, total or remote.size), patience)
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
