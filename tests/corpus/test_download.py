"""Downloads from a local server that misbehaves: broken connections, wrong content, refusals."""

from __future__ import annotations

import errno
import json
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from lilgym_mp.corpus import CorpusError, load_tasks
from lilgym_mp.corpus.faults import InterruptionError
from lilgym_mp.corpus.official.download import GitHub, WebDirectory, download_official
from lilgym_mp.corpus.official.fetching import RetryPolicy, fetch, fetch_text
from lilgym_mp.corpus.official.installing import read_installation
from tests.file_server import FaultyResponse, FileServer

CONTENT = bytes(range(256)) * 1000
SCRATCH, FLIPIT = "tower_scratch_test.json", "tower_flipit_test.json"
REPOSITORY, COMMIT = "lil-lab/lilgym", "c0ffee" * 6 + "c0ff"


def _nothing(have: int, total: int | None) -> None:
    """A progress callback that does nothing."""


@pytest.fixture
def pauses() -> list[float]:
    return []


@pytest.fixture
def retries(pauses: list[float]) -> RetryPolicy:
    """A retry policy that records its pauses instead of sleeping."""
    return RetryPolicy(tries=3, timeout=5.0, pause=pauses.append)


@pytest.fixture
def part(tmp_path: Path) -> Path:
    return tmp_path / "file.part"


def test_fetch__downloads_the_whole_file_and_reports_progress(web: FileServer, part: Path, retries: RetryPolicy):
    web.files["/file"] = CONTENT
    seen: list[tuple[int, int | None]] = []
    fetch(f"{web.url}/file", part, lambda have, total: seen.append((have, total)), retries)
    assert part.read_bytes() == CONTENT
    assert seen[0] == (0, len(CONTENT))
    assert seen[-1] == (len(CONTENT), len(CONTENT))


def test_fetch__resumes_a_partial_download(web: FileServer, part: Path, retries: RetryPolicy):
    web.files["/file"] = CONTENT
    part.write_bytes(CONTENT[:1000])
    fetch(f"{web.url}/file", part, _nothing, retries)
    assert part.read_bytes() == CONTENT
    assert web.requested_ranges("/file") == ["bytes=1000-"]


@pytest.mark.parametrize(
    ("fault", "ranges"),
    [
        (FaultyResponse(breaks_after=5000), [None, "bytes=5000-"]),
        (FaultyResponse(resets=True), [None, None]),
        (FaultyResponse(status=503), [None, None]),
        (FaultyResponse(status=429, headers={"Retry-After": "7"}), [None, None]),
        (FaultyResponse(status=403, headers={"Retry-After": "7"}), [None, None]),
    ],
)
def test_fetch__retries_temporary_failures(
    fault: FaultyResponse, ranges: list[str | None], web: FileServer, part: Path, retries: RetryPolicy
):
    web.files["/file"] = CONTENT
    web.faults["/file"] = [fault]
    fetch(f"{web.url}/file", part, _nothing, retries)
    assert part.read_bytes() == CONTENT
    assert web.requested_ranges("/file") == ranges


@pytest.mark.parametrize(
    "fault",
    [
        FaultyResponse(ignores_range=True),
        FaultyResponse(content_range="bytes 7-8/9"),
        FaultyResponse(content_range="nonsense"),
        FaultyResponse(status=416),
    ],
    ids=["ignores the range", "another range", "no range", "no such range"],
)
def test_fetch__restarts_when_the_server_cannot_resume(
    fault: FaultyResponse, web: FileServer, part: Path, retries: RetryPolicy
):
    web.files["/file"] = CONTENT
    web.faults["/file"] = [fault]
    part.write_bytes(b"x" * 1000)
    fetch(f"{web.url}/file", part, _nothing, retries)
    assert part.read_bytes() == CONTENT


def test_fetch__pauses_grow_and_honour_retry_after(
    web: FileServer, part: Path, retries: RetryPolicy, pauses: list[float]
):
    web.files["/file"] = CONTENT
    web.faults["/file"] = [FaultyResponse(status=500), FaultyResponse(status=503, headers={"Retry-After": "9"})]
    fetch(f"{web.url}/file", part, _nothing, retries)
    assert pauses == [1.0, 9.0]


def test_fetch__progress_resets_the_tries(web: FileServer, part: Path, retries: RetryPolicy):
    web.files["/file"] = CONTENT
    web.faults["/file"] = [FaultyResponse(breaks_after=20_000)] * 6
    fetch(f"{web.url}/file", part, _nothing, retries)
    assert part.read_bytes() == CONTENT


def test_fetch__gives_up_on_a_broken_server_and_keeps_the_partial_file(
    web: FileServer, part: Path, retries: RetryPolicy
):
    web.files["/file"] = CONTENT
    web.faults["/file"] = [FaultyResponse(breaks_after=5000)] + [FaultyResponse(resets=True)] * 3
    with pytest.raises(InterruptionError, match=r"invalid response.*tried 3 times"):
        fetch(f"{web.url}/file", part, _nothing, retries)
    assert part.read_bytes() == CONTENT[:5000]


def test_fetch__gives_up_when_asked_to_wait_too_long(
    web: FileServer, part: Path, retries: RetryPolicy, pauses: list[float]
):
    web.faults["/file"] = [FaultyResponse(status=429, headers={"Retry-After": "3600"})]
    with pytest.raises(InterruptionError, match=r"answers 429.*tried once"):
        fetch(f"{web.url}/file", part, _nothing, retries)
    assert pauses == []


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (FaultyResponse(status=404), r"/file: the server answers 404 Not Found"),
        (FaultyResponse(status=401), r"/file: the server answers 401"),
        (FaultyResponse(content=b"", headers={"Content-Length": str(10**12)}), "more than any file of the release"),
    ],
)
def test_fetch__a_refusal_is_not_retried(
    fault: FaultyResponse, message: str, web: FileServer, part: Path, retries: RetryPolicy
):
    web.faults["/file"] = [fault]
    with pytest.raises(CorpusError, match=message):
        fetch(f"{web.url}/file", part, _nothing, retries)
    assert len(web.requests) == 1


def test_fetch__unreachable_server_error_names_the_host(
    part: Path, retries: RetryPolicy, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("no_proxy", "127.0.0.1")
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        host = f"127.0.0.1:{unused.getsockname()[1]}"
        with pytest.raises(InterruptionError, match=rf"^{host}: cannot be reached: .*refused"):
            fetch(f"http://{host}/file", part, _nothing, retries)


def test_fetch_text__retries_a_truncated_response(web: FileServer, retries: RetryPolicy):
    web.files["/text"] = "caf\u00e9".encode()
    web.faults["/text"] = [FaultyResponse(breaks_after=2)]
    assert fetch_text(f"{web.url}/text", retries) == "caf\u00e9"


@pytest.mark.parametrize("url", ["file:///etc/passwd", "ftp://host/file", "host/file", "http://"])
def test_fetch__unsupported_urls_are_errors(url: str, part: Path, retries: RetryPolicy):
    with pytest.raises(CorpusError, match="a URL must start with http:// or https://"):
        fetch(url, part, _nothing, retries)
    with pytest.raises(CorpusError, match="a URL must start with"):
        fetch_text(url, retries)


@pytest.mark.parametrize("url", ["http://127.0.0.1:port/file", "http://127.0.0.1/two words"])
def test_fetch__an_invalid_url_is_not_retried(url: str, part: Path, retries: RetryPolicy, pauses: list[float]):
    with pytest.raises(CorpusError, match=r"cannot download from .http://127"):
        fetch(url, part, _nothing, retries)
    assert pauses == []


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
def download(repository: GitHub, target: Path, retries: RetryPolicy) -> Download:
    return lambda: download_official(repository, [SCRATCH, FLIPIT], target, retries=retries)


def _scratch_path(web: FileServer) -> str:
    return f"/{REPOSITORY}/{COMMIT}/some/where/{SCRATCH}"


def test_download__installs_files_that_load_tasks_reads(download: Download, target: Path):
    installation = download()
    assert [task.id for task in load_tasks(target, "tower", "flipit", "test")] == ["blue-yes", "blue-no", "pair-no"]
    assert (installation.revision, installation.source) == (COMMIT, f"{REPOSITORY} at HEAD")
    assert read_installation(target) == installation
    assert [path.name for path in target.parent.iterdir()] == ["lilgym"]


def test_download__resumes_after_an_interruption(download: Download, target: Path, web: FileServer):
    broken = FaultyResponse(breaks_after=10)
    web.faults[_scratch_path(web)] = [broken, *[FaultyResponse(resets=True)] * 3]
    with pytest.raises(InterruptionError):
        download()
    assert not target.exists()
    download()
    assert web.requested_ranges(_scratch_path(web))[-1] == "bytes=10-"
    assert read_installation(target) is not None


def test_download__complete_files_are_not_requested_again(download: Download, target: Path, web: FileServer):
    second = next(path for path in web.files if path.endswith(FLIPIT))
    web.faults[second] = [FaultyResponse(resets=True)] * 3
    with pytest.raises(InterruptionError):
        download()
    download()
    assert len(web.requested_ranges(_scratch_path(web))) == 1


def test_download__files_with_a_wrong_checksum_are_removed(download: Download, target: Path, web: FileServer):
    content = web.files[_scratch_path(web)]
    web.faults[_scratch_path(web)] = [FaultyResponse(content=content.replace(b"Blue", b"Pink"))]
    with pytest.raises(CorpusError, match=r"tower_scratch_test.json: checksum mismatch: Git object id"):
        download()
    assert list(target.parent.iterdir()) == []


def test_download__a_corrupt_partial_file_is_restarted(download: Download, target: Path, web: FileServer):
    web.faults[_scratch_path(web)] = [
        FaultyResponse(content=b"?" * 10, headers={"Content-Length": "90"}),
        *[FaultyResponse(resets=True)] * 3,
    ]
    with pytest.raises(InterruptionError):
        download()
    download()
    assert web.requested_ranges(_scratch_path(web))[-2:] == ["bytes=10-", None]
    assert load_tasks(target, "tower", "scratch", "test").ids == ("7",)


def test_download__missing_files_in_the_repository_are_named(
    web: FileServer, small_release: dict[str, bytes], target: Path, retries: RetryPolicy
):
    web.serve_repository(REPOSITORY, COMMIT, {f"data/{SCRATCH}": small_release[SCRATCH]})
    with pytest.raises(CorpusError, match=rf"{REPOSITORY} at HEAD: has no {FLIPIT}; .*lilgym-mp data import"):
        download_official(GitHub(api_url=web.url, raw_url=web.url), [SCRATCH, FLIPIT], target, retries=retries)
    assert list(target.parent.iterdir()) == []


def test_download__different_files_of_one_name_are_an_error(
    web: FileServer, small_release: dict[str, bytes], target: Path, retries: RetryPolicy
):
    web.serve_repository(REPOSITORY, COMMIT, {f"a/{SCRATCH}": small_release[SCRATCH], f"b/{SCRATCH}": b"{}"})
    with pytest.raises(CorpusError, match=f"several different files {SCRATCH}"):
        download_official(GitHub(api_url=web.url, raw_url=web.url), [SCRATCH], target, retries=retries)


@pytest.mark.parametrize("answer", [b"<html>", b"[]", b'{"sha": 1}'])
def test_download__an_invalid_listing_is_an_error(answer: bytes, web: FileServer, target: Path, retries: RetryPolicy):
    web.files[f"/repos/{REPOSITORY}/commits/HEAD"] = answer
    with pytest.raises(CorpusError, match=r"the response cannot be read|not a JSON object|contains no commit"):
        download_official(GitHub(api_url=web.url, raw_url=web.url), [SCRATCH], target, retries=retries)
    assert not target.exists()


def test_download__rate_limit_error_says_when_to_retry(web: FileServer, target: Path, retries: RetryPolicy):
    web.faults[f"/repos/{REPOSITORY}/commits/HEAD"] = [
        FaultyResponse(status=403, headers={"X-RateLimit-Remaining": "0"})
    ]
    with pytest.raises(InterruptionError, match="rate limit exceeded; try again in an hour"):
        download_official(GitHub(api_url=web.url, raw_url=web.url), [SCRATCH], target, retries=retries)


def test_download__a_web_directory_needs_no_listing(
    web: FileServer, small_release: dict[str, bytes], target: Path, retries: RetryPolicy
):
    web.files.update({f"/mirror/{name}": content for name, content in small_release.items()})
    installation = download_official(WebDirectory(f"{web.url}/mirror/"), [SCRATCH, FLIPIT], target, retries=retries)
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
    retries: RetryPolicy,
):
    spoilt = {**small_release, name: small_release[name].decode().replace(old, new, 1).encode()}
    web.files.update({f"/{name}": content for name, content in spoilt.items()})
    with pytest.raises(CorpusError, match=message):
        download_official(WebDirectory(web.url), [SCRATCH, FLIPIT], target, retries=retries)
    assert list(target.parent.iterdir()) == []


def test_download__checks_disk_space_first(
    download: Download, target: Path, web: FileServer, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("shutil.disk_usage", lambda path: type("Usage", (), {"free": 5}))
    with pytest.raises(CorpusError, match=r"no space left on the disk of .*: the files need \d+ bytes, 5 are free"):
        download()
    assert not web.requested_ranges(_scratch_path(web))
    assert list(target.parent.iterdir()) == []


def test_download__a_full_disk_leaves_no_files(download: Download, target: Path, monkeypatch: pytest.MonkeyPatch):
    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("lilgym_mp.corpus.official.fetching._copy", full)
    with pytest.raises(CorpusError, match=r"no space left on the disk of .*; nothing was installed"):
        download()
    assert list(target.parent.iterdir()) == []


def test_download__reports_progress_per_file(
    repository: GitHub, small_release: dict[str, bytes], target: Path, retries: RetryPolicy
):
    seen: dict[str, int] = {}

    def progress(name: str, have: int, total: int | None) -> None:
        assert total == len(small_release[name])
        seen[name] = have

    download_official(repository, [SCRATCH, FLIPIT], target, progress, retries)
    assert seen == {name: len(content) for name, content in small_release.items()}


def test_download__uses_the_files_of_the_requested_commit(
    web: FileServer, small_release: dict[str, bytes], target: Path, retries: RetryPolicy
):
    web.serve_repository(REPOSITORY, COMMIT, {SCRATCH: small_release[SCRATCH]})
    web.files[f"/repos/{REPOSITORY}/commits/v1"] = json.dumps({"sha": COMMIT}).encode()
    source = GitHub(revision="v1", api_url=web.url, raw_url=web.url)
    assert download_official(source, [SCRATCH], target, retries=retries).source == f"{REPOSITORY} at v1"
