"""One file over HTTP: resumed where it broke off, tried again after growing pauses, never cut short unnoticed."""

from __future__ import annotations

import http.client
import re
import ssl
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import IO
from urllib.parse import urlsplit

from lilgym_mp.corpus.faults import CorpusError, InterruptionError

CHUNK = 64 * 1024
MAX_BYTES = 256 * 1024 * 1024  # of one file; the largest of the release have some ten million
USER_AGENT = "lilgym_mp (data download)"
RETRIED = (408, 425, 429, 500, 502, 503, 504)
SCHEMES = ("http", "https")
_CONTENT_RANGE = re.compile(r"bytes (\d+)-\d+/(\d+|\*)")

Progress = Callable[[int, int | None], None]  # bytes of the file so far, and of all of it where known


@dataclass(frozen=True, slots=True)
class Patience:
    """How long to wait for a server, in seconds."""

    tries: int = 5  # in a row without a new byte
    first_pause: float = 1.0  # doubled from try to try
    longest_pause: float = 30.0
    timeout: float = 30.0  # for a connection, and for each piece of an answer
    pause: Callable[[float], None] = time.sleep


class _TryAgain(Exception):
    """What may go better next time; `after` seconds, where the server says so."""

    def __init__(self, what: str, after: float = 0.0) -> None:
        super().__init__(what)
        self.after = after


class _NoSuchRange(_TryAgain):
    """The server has no bytes from where the download would go on."""


def checked_url(url: str) -> str:
    """`url` when it is one to download from. Raises CorpusError naming the choices."""
    parts = urlsplit(url)
    if parts.scheme not in SCHEMES or not parts.netloc:
        raise CorpusError(f"cannot download from {url!r}; a URL starts with {' or '.join(s + '://' for s in SCHEMES)}")
    return url


def fetch(url: str, part: Path, progress: Progress, patience: Patience) -> None:
    """Downloads `url` into the file `part`, going on after the bytes that are there already.

    Raises InterruptionError when the server stays out of reach or breaks off again and again (`part` keeps what came),
    CorpusError when it refuses, OSError when `part` cannot be written.
    """
    checked_url(url)
    _patiently(url, lambda: _fetch_once(url, part, progress, patience.timeout), lambda: _size(part), patience)


def fetch_text(url: str, patience: Patience) -> str:
    """What `url` answers. Raises as `fetch` does."""
    checked_url(url)
    answers: list[str] = []

    def once() -> None:
        with _opened(url, 0, patience.timeout) as response:
            _, total = _extent(response)
            content = _read(response, MAX_BYTES)
        if total is not None and len(content) != total:
            raise _TryAgain(f"the connection broke off after {len(content)} of {total} bytes")
        answers.append(content.decode("utf-8", errors="replace"))

    _patiently(url, once, lambda: 0, patience)
    return answers[-1]


def _patiently(url: str, once: Callable[[], None], had: Callable[[], int], patience: Patience) -> None:
    """Calls `once` until it raises no _TryAgain, or did so `tries` times in a row without `had` growing."""
    failures, most = 0, had()
    while True:
        try:
            return once()
        except _TryAgain as fault:
            failures = 1 if had() > most else failures + 1
            most = max(most, had())
            if failures >= patience.tries or fault.after > patience.longest_pause:
                host = urlsplit(url).netloc
                times = "once" if failures == 1 else f"{failures} times"
                raise InterruptionError(f"{host}: {fault} (asked {times} for {url})") from None
            growing = patience.first_pause * 2.0 ** (failures - 1)
            patience.pause(max(fault.after, min(growing, patience.longest_pause)))


def _fetch_once(url: str, part: Path, progress: Progress, timeout: float) -> None:
    have = _size(part)
    try:
        response = _opened(url, have, timeout)
    except _NoSuchRange:
        part.unlink()
        raise
    with response:
        start, total = _extent(response)
        if start not in (0, have):
            part.unlink()
            raise _TryAgain(f"the server answered from byte {start}, not {have}")
        if (total or 0) > MAX_BYTES:
            raise CorpusError(f"{url}: has {total} bytes; no file of the release has more than {MAX_BYTES}")
        with part.open("r+b" if start else "wb") as file:
            file.seek(start)
            have = _copy(response, file, start, total, progress, url)
    if total is not None and have != total:
        raise _TryAgain(f"the connection broke off after {have} of {total} bytes")


def _copy(
    response: http.client.HTTPResponse, file: IO[bytes], have: int, total: int | None, progress: Progress, url: str
) -> int:
    """Appends the response to the file; gives how many bytes the file has then."""
    progress(have, total)
    while piece := _read(response, CHUNK):
        if have + len(piece) > MAX_BYTES:
            raise CorpusError(f"{url}: sends more than {MAX_BYTES} bytes; no file of the release has so many")
        file.write(piece)
        file.flush()
        have += len(piece)
        progress(have, total)
    return have


def _size(part: Path) -> int:
    return part.stat().st_size if part.exists() else 0


def _opened(url: str, start: int, timeout: float) -> http.client.HTTPResponse:
    """The server's answer, from byte `start` on if it can do that.

    Raises _TryAgain for what may pass, CorpusError for a refusal.
    """
    request = urllib.request.Request(url, headers={"User-Agent": USER_AGENT, "Accept-Encoding": "identity"})
    if start:
        request.add_header("Range", f"bytes={start}-")
    try:
        return urllib.request.urlopen(request, timeout=timeout)
    except urllib.error.HTTPError as answer:
        with answer:
            raise _refusal(url, answer) from None
    except urllib.error.URLError as fault:
        if isinstance(fault.reason, ssl.SSLCertVerificationError):
            raise CorpusError(f"{url}: the server's certificate is not to be trusted: {fault.reason}") from None
        raise _TryAgain(f"cannot be reached: {fault.reason}") from None
    except http.client.InvalidURL as fault:
        raise CorpusError(f"cannot download from {url!r}: {fault}") from None
    except (OSError, http.client.HTTPException) as fault:
        raise _TryAgain(f"no proper answer: {fault or type(fault).__name__}") from None


def _refusal(url: str, answer: urllib.error.HTTPError) -> Exception:
    status = f"answers {answer.code} {answer.reason}"
    after = answer.headers.get("Retry-After", "")
    if answer.code == http.client.REQUESTED_RANGE_NOT_SATISFIABLE:
        return _NoSuchRange("the server has fewer bytes than were downloaded before")
    if answer.code in RETRIED or after:
        return _TryAgain(status, float(after) if after.isdigit() else 0.0)
    if answer.headers.get("X-RateLimit-Remaining") == "0":
        return InterruptionError(f"{urlsplit(url).netloc} takes no more requests for now; try again in an hour")
    return CorpusError(f"{url}: the server {status}")


def _extent(response: http.client.HTTPResponse) -> tuple[int, int | None]:
    """The position of the answer's first byte in the file (-1 where it does not say), and the file's size if known."""
    if response.status == http.client.PARTIAL_CONTENT:
        found = _CONTENT_RANGE.fullmatch(response.headers.get("Content-Range", ""))
        if found is None:
            return -1, None
        return int(found[1]), None if found[2] == "*" else int(found[2])
    length = response.headers.get("Content-Length", "")
    return 0, int(length) if length.isdigit() else None


def _read(response: http.client.HTTPResponse, size: int) -> bytes:
    """The next bytes, none at the end. Raises _TryAgain when the connection breaks."""
    try:
        return response.read(size)
    except (OSError, http.client.HTTPException) as fault:
        raise _TryAgain(f"the connection broke: {fault or type(fault).__name__}") from None
