"""Downloads from a local server that misbehaves: broken connections, wrong content, refusals."""

from __future__ import annotations

import errno
import json
import socket
from collections.abc import Callable, Generator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from lilgym_mp.corpus import CorpusError, load_tasks
from lilgym_mp.corpus.faults import InterruptionError
from lilgym_mp.corpus.official.download import GitHub, WebDirectory, download_official
from lilgym_mp.corpus.official.fetching import fetch
from lilgym_mp.corpus.official.installing import read_installation
from tests.file_server import FaultyResponse, FileServer, file_server

CONTENT = bytes(range(256)) * 1000
SCRATCH, FLIPIT = "tower_scratch_test.json", "tower_flipit_test.json"
REPOSITORY, COMMIT = "lil-lab/lilgym", "c0ffee" * 6 + "c0ff"


@pytest.fixture(autouse=True)
def pauses(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Records pooch's pauses between tries instead of sleeping."""
    recorded: list[float] = []
    monkeypatch.setattr("pooch.core.time", SimpleNamespace(sleep=recorded.append))
    return recorded


@pytest.fixture
def web(monkeypatch: pytest.MonkeyPatch) -> Generator[FileServer, None, None]:
    monkeypatch.setenv("no_proxy", "127.0.0.1")
    with file_server() as web:
        web.files["/file"] = CONTENT
        yield web


@pytest.mark.parametrize(
    "fault",
    [
        FaultyResponse(resets=True),
        FaultyResponse(breaks_after=10),
        FaultyResponse(status=503),
        FaultyResponse(status=429, headers={"Retry-After": "3"}),
    ],
    ids=["reset", "truncated", "busy", "too many requests"],
)
def test_fetch__tries_again_after_temporary_failures(
    fault: FaultyResponse, web: FileServer, tmp_path: Path, pauses: list[float]
):
    web.faults["/file"] = [fault, fault]
    fetch(f"{web.url}/file", tmp_path / "file")
    assert (tmp_path / "file").read_bytes() == CONTENT
    assert pauses == [1, 2]
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_fetch__gives_up_after_the_last_try_and_leaves_nothing(web: FileServer, tmp_path: Path):
    web.faults["/file"] = [FaultyResponse(breaks_after=10)] * 4
    with pytest.raises(InterruptionError, match=rf"127\.0\.0\.1.*IncompleteRead.*tries: 4; {web.url}/file"):
        fetch(f"{web.url}/file", tmp_path / "file")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("status", [401, 403, 404, 410, 204, 304])
def test_fetch__a_refusal_is_not_retried(status: int, web: FileServer, tmp_path: Path, pauses: list[float]):
    web.faults["/file"] = [FaultyResponse(status=status)]
    with pytest.raises(CorpusError, match=f"{web.url}/file: the server answers {status}") as error:
        fetch(f"{web.url}/file", tmp_path / "file")
    assert not isinstance(error.value, InterruptionError)
    assert not pauses


def test_fetch__a_body_above_the_limit_is_an_error(web: FileServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("lilgym_mp.corpus.official.fetching.MAX_BYTES", 1000)
    with pytest.raises(CorpusError, match="sends more than 1000 bytes"):
        fetch(f"{web.url}/file", tmp_path / "file")
    assert not list(tmp_path.iterdir())


def test_fetch__unreachable_server_error_names_the_host(tmp_path: Path):
    with socket.create_server(("127.0.0.1", 0)) as closed:
        port = closed.getsockname()[1]
    with pytest.raises(InterruptionError, match=rf"127\.0\.0\.1:{port}: .*Connection refused"):
        fetch(f"http://127.0.0.1:{port}/file", tmp_path / "file")


@pytest.mark.parametrize("url", ["file:///etc/passwd", "ftp://host/file", "host/file", "http://"])
def test_fetch__unsupported_urls_are_errors(url: str, tmp_path: Path):
    with pytest.raises(CorpusError, match="a URL must start with http:// or https://"):
        fetch(url, tmp_path / "file")


@pytest.fixture
def repository(web: FileServer, small_release: dict[str, bytes]) -> GitHub:
    """The small release, in two directories of a repository."""
    files = {f"some/where/{SCRATCH}": small_release[SCRATCH], f"else where/{FLIPIT}": small_release[FLIPIT]}
    web.serve_repository(REPOSITORY, COMMIT, {**files, "README.md": b"Read me."})
    return GitHub(api_url=web.url, raw_url=web.url)


@pytest.fixture
def target(tmp_path: Path) -> Path:
    return tmp_path / "cache" / "lilgym"


Download = Callable[..., Any]


@pytest.fixture
def download(repository: GitHub, target: Path) -> Download:
    return lambda: download_official(repository, [SCRATCH, FLIPIT], target)


def _scratch_path(web: FileServer) -> str:
    return f"/{REPOSITORY}/{COMMIT}/some/where/{SCRATCH}"


def test_download__installs_files_that_load_tasks_reads(download: Download, target: Path):
    installation = download()
    assert [task.id for task in load_tasks(target, "tower", "flipit", "test")] == ["blue-yes", "blue-no", "pair-no"]
    assert (installation.revision, installation.source) == (COMMIT, f"{REPOSITORY} at HEAD")
    assert read_installation(target) == installation
    assert [path.name for path in target.parent.iterdir()] == ["lilgym"]


def test_download__that_failed_leaves_the_previous_installation(download: Download, target: Path, web: FileServer):
    first = download()
    web.faults[_scratch_path(web)] = [FaultyResponse(resets=True)] * 4
    with pytest.raises(InterruptionError):
        download()
    assert read_installation(target) == first
    assert [path.name for path in target.parent.iterdir()] == ["lilgym"]


def test_download__files_with_a_wrong_checksum_are_removed(download: Download, target: Path, web: FileServer):
    content = web.files[_scratch_path(web)]
    web.faults[_scratch_path(web)] = [FaultyResponse(content=content.replace(b"Blue", b"Pink"))]
    with pytest.raises(CorpusError, match=r"tower_scratch_test.json: checksum mismatch: Git object id"):
        download()
    assert list(target.parent.iterdir()) == []


def test_download__missing_files_in_the_repository_are_named(
    web: FileServer, small_release: dict[str, bytes], target: Path
):
    web.serve_repository(REPOSITORY, COMMIT, {f"data/{SCRATCH}": small_release[SCRATCH]})
    with pytest.raises(CorpusError, match=rf"{REPOSITORY} at HEAD: has no {FLIPIT}; .*lilgym-mp data import"):
        download_official(GitHub(api_url=web.url, raw_url=web.url), [SCRATCH, FLIPIT], target)
    assert list(target.parent.iterdir()) == []


def test_download__different_files_of_one_name_are_an_error(
    web: FileServer, small_release: dict[str, bytes], target: Path
):
    web.serve_repository(REPOSITORY, COMMIT, {f"a/{SCRATCH}": small_release[SCRATCH], f"b/{SCRATCH}": b"{}"})
    with pytest.raises(CorpusError, match=f"several different files {SCRATCH}"):
        download_official(GitHub(api_url=web.url, raw_url=web.url), [SCRATCH], target)


@pytest.mark.parametrize("answer", [b"<html>", b"[]", b'{"sha": 1}'])
def test_download__an_invalid_listing_is_an_error(answer: bytes, web: FileServer, target: Path):
    web.files[f"/repos/{REPOSITORY}/commits/HEAD"] = answer
    with pytest.raises(CorpusError, match=r"the response cannot be read|not a JSON object|contains no commit"):
        download_official(GitHub(api_url=web.url, raw_url=web.url), [SCRATCH], target)
    assert not target.exists()


def test_download__rate_limit_error_says_when_to_retry(web: FileServer, target: Path):
    web.faults[f"/repos/{REPOSITORY}/commits/HEAD"] = [
        FaultyResponse(status=403, headers={"X-RateLimit-Remaining": "0"})
    ]
    with pytest.raises(CorpusError, match="rate limit exceeded; try again in an hour"):
        download_official(GitHub(api_url=web.url, raw_url=web.url), [SCRATCH], target)


def test_download__a_web_directory_needs_no_listing(web: FileServer, small_release: dict[str, bytes], target: Path):
    web.files.update({f"/mirror/{name}": content for name, content in small_release.items()})
    installation = download_official(WebDirectory(f"{web.url}/mirror/"), [SCRATCH, FLIPIT], target)
    assert installation.revision is None
    assert {file.name: str(file.proof) for file in installation.files} == {
        SCRATCH: "content digest",
        FLIPIT: "numbers and labels",
    }


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        (
            SCRATCH,
            "Blue is",
            "Pink is",
            r"scratch_test\.json: is not the file of release 0\.0\.1.*content digest",
        ),
        (SCRATCH, '"7"', '"6": {"sentence": "a", "lf": "exist(all_items)"}, "7"', "has 2 entries; the file .* has 1"),
        (FLIPIT, '"false"', '"true"', "label is true but the program is false"),
        (FLIPIT, "{", "", "not JSON"),
    ],
    ids=["another statement", "another number", "a wrong label", "broken"],
)
def test_download__files_of_another_version_are_removed(
    name: str,
    old: str,
    new: str,
    message: str,
    web: FileServer,
    small_release: dict[str, bytes],
    target: Path,
):
    spoilt = {**small_release, name: small_release[name].decode().replace(old, new, 1).encode()}
    web.files.update({f"/{name}": content for name, content in spoilt.items()})
    with pytest.raises(CorpusError, match=message):
        download_official(WebDirectory(web.url), [SCRATCH, FLIPIT], target)
    assert list(target.parent.iterdir()) == []


def test_download__a_full_disk_leaves_no_files(download: Download, target: Path, monkeypatch: pytest.MonkeyPatch):
    def full(*_: object, **options: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("pathlib.Path.write_text", full)
    with pytest.raises(CorpusError, match=r"no space left on the disk of .*; nothing was installed"):
        download()
    assert list(target.parent.iterdir()) == []


def test_download__reports_progress_per_file(repository: GitHub, small_release: dict[str, bytes], target: Path):
    seen: dict[str, int] = {}
    download_official(repository, [SCRATCH, FLIPIT], target, seen.__setitem__)
    assert seen == {name: len(content) for name, content in small_release.items()}


def test_download__uses_the_files_of_the_requested_commit(
    web: FileServer, small_release: dict[str, bytes], target: Path
):
    web.serve_repository(REPOSITORY, COMMIT, {SCRATCH: small_release[SCRATCH]})
    web.files[f"/repos/{REPOSITORY}/commits/v1"] = json.dumps({"sha": COMMIT}).encode()
    source = GitHub(revision="v1", api_url=web.url, raw_url=web.url)
    assert download_official(source, [SCRATCH], target).source == f"{REPOSITORY} at v1"
