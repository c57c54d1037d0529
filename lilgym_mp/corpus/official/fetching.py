"""Downloads a file over HTTP: resumable, retried with exponential backoff, with truncation detected."""

from __future__ import annotations

import functools
import http.client
import re
import socket
import ssl
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any
from urllib.parse import urlsplit

from lilgym_mp.corpus.faults import CorpusError, InterruptionError
from lilgym_mp.corpus.records import MAX_BYTES

CHUNK = 64 * 1024
MAX_REASON_LENGTH = 200  # characters of a library's or server's message
USER_AGENT = "lilgym_mp (data download)"
RETRYABLE_STATUS = (408, 425, 429, 500, 502, 503, 504)
SCHEMES = ("http", "https")
_NUMBER = re.compile(r"[0-9]{1,15}")
_CONTENT_RANGE = re.compile(r"bytes ([0-9]{1,15})-[0-9]+/([0-9]{1,15}|\*)")

Progress = Callable[[int, int | None], None]  # bytes so far, total bytes if known


@dataclass(frozen=True, slots=True)
class RetryPolicy:
    """Retries and timeouts; times in seconds."""

    tries: int = 5  # consecutive tries without progress
    first_pause: float = 1.0  # doubled after each try
    longest_pause: float = 30.0
    timeout: float = 30.0  # for connecting, for the headers, and for each chunk
    least_rate: float = 4_000.0  # bytes per second, averaged over `timeout`; slower connections are closed
    pause: Callable[[float], None] = time.sleep


class _RetryableError(Exception):
    """A failure worth retrying, after at least `after` seconds if the server says so."""

    def __init__(self, what: str, after: float = 0.0) -> None:
        super().__init__(what)
        self.after = after


class _TooSlowError(_RetryableError):
    """The connection was closed because it was slower than the least rate."""


class _InvalidRangeError(_RetryableError):
    """The server's file is shorter than the part already downloaded."""


def checked_url(url: str) -> str:
    """`url` if its scheme is supported. Raises CorpusError otherwise."""
    parts = urlsplit(url)
    if parts.scheme not in SCHEMES or not parts.netloc:
        schemes = " or ".join(f"{scheme}://" for scheme in SCHEMES)
        raise CorpusError(f"cannot download from {url!r}; a URL must start with {schemes}")
    return url


def fetch(url: str, part: Path, progress: Progress, retries: RetryPolicy) -> None:
    """Downloads `url` into the file `part`, resuming after its existing bytes.

    Raises InterruptionError when retries are exhausted (`part` keeps the bytes received), CorpusError when the server
    refuses, OSError when `part` cannot be written.
    """
    checked_url(url)
    _with_retries(url, lambda: _fetch_once(url, part, progress, retries), lambda: _size(part), retries)


def fetch_text(url: str, retries: RetryPolicy) -> str:
    """The response body as text. Raises as `fetch` does."""
    checked_url(url)
    answers: list[str] = []

    def once() -> None:
        content = b""
        with _Connection(url, 0, retries) as connection:
            _, total = _content_range(connection.response)
            while piece := connection.read():
                content += piece
                if len(content) > MAX_BYTES:
                    raise CorpusError(f"{url}: the response has more than {MAX_BYTES} bytes")
        if total is not None and len(content) != total:
            raise _RetryableError(f"the connection broke after {len(content)} of {total} bytes")
        answers.append(content.decode("utf-8", errors="replace"))

    _with_retries(url, once, lambda: 0, retries)
    return answers[-1]


def _with_retries(url: str, once: Callable[[], None], had: Callable[[], int], retries: RetryPolicy) -> None:
    """Calls `once` until it succeeds; gives up after `tries` consecutive failures without enough growth of `had`."""
    failures, most, since = 0, had(), time.monotonic()
    while True:
        try:
            return once()
        except _RetryableError as fault:
            now = time.monotonic()
            grows = had() - most > retries.least_rate * (now - since) and not isinstance(fault, _TooSlowError)
            failures = 1 if grows else failures + 1
            if grows:
                most, since = had(), now
            if failures >= retries.tries or fault.after > retries.longest_pause:
                host = urlsplit(url).netloc
                times = "once" if failures == 1 else f"{failures} times"
                raise InterruptionError(f"{host}: {fault} (tried {times}: {url})") from None
            growing = retries.first_pause * 2.0 ** (failures - 1)
            retries.pause(max(fault.after, min(growing, retries.longest_pause)))


def _fetch_once(url: str, part: Path, progress: Progress, retries: RetryPolicy) -> None:
    have = _size(part)
    try:
        connection = _Connection(url, have, retries)
    except _InvalidRangeError:
        part.unlink(missing_ok=True)
        raise
    with connection:
        start, total = _content_range(connection.response)
        if start not in (0, have):
            part.unlink(missing_ok=True)
            raise _RetryableError(f"the server answered from byte {start}, not {have}")
        if (total or 0) > MAX_BYTES:
            raise CorpusError(f"{url}: has {total} bytes, more than any file of the release ({MAX_BYTES})")
        with part.open("r+b" if start else "wb") as file:
            file.seek(start)
            have = _copy(connection, file, start, total, progress, url)
    if total is not None and have != total:
        raise _RetryableError(f"the connection broke after {have} of {total} bytes")


def _copy(connection: _Connection, file: IO[bytes], have: int, total: int | None, progress: Progress, url: str) -> int:
    """Appends the response to the file; returns the file's new size."""
    progress(have, total)
    while piece := connection.read():
        if have + len(piece) > MAX_BYTES:
            raise CorpusError(f"{url}: sends more than {MAX_BYTES} bytes, more than any file of the release")
        file.write(piece)
        file.flush()
        have += len(piece)
        progress(have, total)
    return have


def _size(part: Path) -> int:
    return part.stat().st_size if part.exists() else 0


class _Watchdog:
    """Closes connections that send less than the least rate, even while receiving headers."""

    def __init__(self, retries: RetryPolicy) -> None:
        self._seconds = retries.timeout
        self._least = retries.least_rate * retries.timeout
        self._received = 0  # bytes in the current span of `seconds`
        self._end = time.monotonic() + self._seconds
        self._sockets: list[socket.socket] = []
        self._over = threading.Event()
        self.cut_off = False
        threading.Thread(target=self._watchdog, name="lilgym_mp download watchdog", daemon=True).start()

    def add(self, sock: socket.socket) -> None:
        self._sockets.append(sock)

    def note(self, count: int) -> None:
        """Counts received bytes; restarts the timeout once the least rate is met."""
        self._received += count
        if self._received >= self._least:
            self._received, self._end = 0, time.monotonic() + self._seconds

    def stop(self) -> None:
        self._over.set()

    def _watchdog(self) -> None:
        while not self._over.wait(max(0.0, self._end - time.monotonic())):
            if time.monotonic() >= self._end:
                self.cut_off = True
                for sock in self._sockets:
                    with suppress(OSError):
                        sock.shutdown(socket.SHUT_RDWR)
                return


class _Redirects(urllib.request.HTTPRedirectHandler):
    """Follows redirects to supported URLs only."""

    def redirect_request(self, req: Any, fp: Any, code: int, msg: str, headers: Any, newurl: str) -> Any:
        checked_url(newurl)
        return super().redirect_request(req, fp, code, msg, headers, newurl)


def _opener(watchdog: _Watchdog) -> urllib.request.OpenerDirector:
    """An opener for HTTP and HTTPS only, whose connections are monitored by the watchdog."""

    class Plain(http.client.HTTPConnection):
        def connect(self) -> None:
            super().connect()
            watchdog.add(self.sock)

    class Secure(http.client.HTTPSConnection):
        def connect(self) -> None:
            super().connect()
            watchdog.add(self.sock)

    class PlainHandler(urllib.request.HTTPHandler):
        def http_open(self, req: Any) -> Any:
            return self.do_open(Plain, req)

    class SecureHandler(urllib.request.HTTPSHandler):
        def https_open(self, req: Any) -> Any:
            return self.do_open(functools.partial(Secure, context=ssl.create_default_context()), req)

    opener = urllib.request.OpenerDirector()
    for handler in (
        urllib.request.ProxyHandler,
        urllib.request.UnknownHandler,
        PlainHandler,
        SecureHandler,
        urllib.request.HTTPDefaultErrorHandler,
        urllib.request.HTTPErrorProcessor,
        _Redirects,
    ):
        opener.add_handler(handler())
    return opener


class _Connection:
    """A server's response, from byte `start` of the file if the server supports ranges. A context manager."""

    def __init__(self, url: str, start: int, retries: RetryPolicy) -> None:
        """Raises _RetryableError for a temporary failure, CorpusError for a refusal."""
        self._url = url
        self._watchdog = _Watchdog(retries)
        try:
            self.response = self._opened(start, retries.timeout)
        except BaseException:
            self._watchdog.stop()
            raise

    def __enter__(self) -> _Connection:
        return self

    def __exit__(self, *fault: object) -> None:
        self._watchdog.stop()
        self.response.close()

    def _opened(self, start: int, timeout: float) -> http.client.HTTPResponse:
        url = self._url
        try:
            request = urllib.request.Request(url, headers={"User-Agent": USER_AGENT, "Accept-Encoding": "identity"})
            if start:
                request.add_header("Range", f"bytes={start}-")
            return _opener(self._watchdog).open(request, timeout=timeout)
        except urllib.error.HTTPError as answer:
            with answer:
                raise _error_for(url, answer) from None
        except urllib.error.URLError as fault:
            if isinstance(fault.reason, ssl.SSLCertVerificationError):
                raise CorpusError(
                    f"{url}: the server's certificate is not trusted: {_one_line(fault.reason)}"
                ) from None
            raise self._broken(f"cannot be reached: {_one_line(fault.reason)}") from None
        except (CorpusError, http.client.InvalidURL) as fault:
            raise CorpusError(f"cannot download from {url!r}: {_one_line(fault)}") from None
        except (OSError, http.client.HTTPException) as fault:
            raise self._broken(f"invalid response: {_one_line(fault)}") from None
        except ValueError as fault:  # caused by a redirect URL or a header
            raise CorpusError(f"cannot download from {url!r}: invalid response: {_one_line(fault)}") from None

    def read(self) -> bytes:
        """The next bytes, empty at the end. Raises _RetryableError when the connection breaks."""
        try:
            piece = self.response.read1(CHUNK)
        except (OSError, http.client.HTTPException, ValueError) as fault:
            raise self._broken(f"the connection broke: {_one_line(fault)}") from None
        if self._watchdog.cut_off:
            raise self._broken("")
        self._watchdog.note(len(piece))
        return piece

    def _broken(self, what: str) -> _RetryableError:
        if self._watchdog.cut_off:
            return _TooSlowError("the server sends too slowly")
        return _RetryableError(what)


def _one_line(fault: object) -> str:
    """A library's or server's error message on one line."""
    return " ".join(str(fault).split())[:MAX_REASON_LENGTH] or type(fault).__name__


def _error_for(url: str, answer: urllib.error.HTTPError) -> Exception:
    status = f"answers {answer.code} {_one_line(answer.reason)}"
    after = answer.headers.get("Retry-After", "")
    if answer.code == http.client.REQUESTED_RANGE_NOT_SATISFIABLE:
        return _InvalidRangeError("the server has fewer bytes than were downloaded before")
    if answer.code in RETRYABLE_STATUS or after:
        return _RetryableError(status, float(after) if _NUMBER.fullmatch(after) else 0.0)
    if answer.headers.get("X-RateLimit-Remaining") == "0":
        return InterruptionError(f"{urlsplit(url).netloc}: rate limit exceeded; try again in an hour")
    return CorpusError(f"{url}: the server {status}")


def _content_range(response: http.client.HTTPResponse) -> tuple[int, int | None]:
    """The offset of the response's first byte in the file (-1 if unknown), and the file's size if known."""
    if response.status == http.client.PARTIAL_CONTENT:
        found = _CONTENT_RANGE.fullmatch(response.headers.get("Content-Range", ""))
        if found is None:
            return -1, None
        return int(found[1]), None if found[2] == "*" else int(found[2])
    length = response.headers.get("Content-Length", "")
    return 0, int(length) if _NUMBER.fullmatch(length) else None
