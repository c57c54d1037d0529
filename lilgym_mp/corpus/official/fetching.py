"""One file over HTTP: resumed where it broke off, tried again after growing pauses, never cut short unnoticed."""

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
LONGEST_REASON = 200  # characters of what is told of a fault
USER_AGENT = "lilgym_mp (data download)"
RETRIED = (408, 425, 429, 500, 502, 503, 504)
SCHEMES = ("http", "https")
_NUMBER = re.compile(r"[0-9]{1,15}")
_CONTENT_RANGE = re.compile(r"bytes ([0-9]{1,15})-[0-9]+/([0-9]{1,15}|\*)")

Progress = Callable[[int, int | None], None]  # bytes of the file so far, and of all of it where known


@dataclass(frozen=True, slots=True)
class Patience:
    """How long to wait for a server, in seconds."""

    tries: int = 5  # in a row without a new byte
    first_pause: float = 1.0  # doubled from try to try
    longest_pause: float = 30.0
    timeout: float = 30.0  # for a connection and the head of an answer, and for each piece of it
    least_rate: float = 4_000.0  # bytes a second, on average over `timeout`; what is slower counts as broken
    pause: Callable[[float], None] = time.sleep


class _TryAgain(Exception):
    """What may go better next time; `after` seconds, where the server says so."""

    def __init__(self, what: str, after: float = 0.0) -> None:
        super().__init__(what)
        self.after = after


class _TooSlow(_TryAgain):
    """A connection that was cut off for sending less than the least rate."""


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
    _patiently(url, lambda: _fetch_once(url, part, progress, patience), lambda: _size(part), patience)


def fetch_text(url: str, patience: Patience) -> str:
    """What `url` answers. Raises as `fetch` does."""
    checked_url(url)
    answers: list[str] = []

    def once() -> None:
        content = b""
        with _Connection(url, 0, patience) as connection:
            _, total = _extent(connection.response)
            while piece := connection.read():
                content += piece
                if len(content) > MAX_BYTES:
                    raise CorpusError(f"{url}: answers more than {MAX_BYTES} bytes")
        if total is not None and len(content) != total:
            raise _TryAgain(f"the connection broke off after {len(content)} of {total} bytes")
        answers.append(content.decode("utf-8", errors="replace"))

    _patiently(url, once, lambda: 0, patience)
    return answers[-1]


def _patiently(url: str, once: Callable[[], None], had: Callable[[], int], patience: Patience) -> None:
    """Calls `once` until it raises no _TryAgain, or did so `tries` times in a row while `had` grew too slowly."""
    failures, most, since = 0, had(), time.monotonic()
    while True:
        try:
            return once()
        except _TryAgain as fault:
            now = time.monotonic()
            grows = had() - most > patience.least_rate * (now - since) and not isinstance(fault, _TooSlow)
            failures = 1 if grows else failures + 1
            if grows:
                most, since = had(), now
            if failures >= patience.tries or fault.after > patience.longest_pause:
                host = urlsplit(url).netloc
                times = "once" if failures == 1 else f"{failures} times"
                raise InterruptionError(f"{host}: {fault} (asked {times} for {url})") from None
            growing = patience.first_pause * 2.0 ** (failures - 1)
            patience.pause(max(fault.after, min(growing, patience.longest_pause)))


def _fetch_once(url: str, part: Path, progress: Progress, patience: Patience) -> None:
    have = _size(part)
    try:
        connection = _Connection(url, have, patience)
    except _NoSuchRange:
        part.unlink(missing_ok=True)
        raise
    with connection:
        start, total = _extent(connection.response)
        if start not in (0, have):
            part.unlink(missing_ok=True)
            raise _TryAgain(f"the server answered from byte {start}, not {have}")
        if (total or 0) > MAX_BYTES:
            raise CorpusError(f"{url}: has {total} bytes; no file of the release has more than {MAX_BYTES}")
        with part.open("r+b" if start else "wb") as file:
            file.seek(start)
            have = _copy(connection, file, start, total, progress, url)
    if total is not None and have != total:
        raise _TryAgain(f"the connection broke off after {have} of {total} bytes")


def _copy(connection: _Connection, file: IO[bytes], have: int, total: int | None, progress: Progress, url: str) -> int:
    """Appends the response to the file; gives how many bytes the file has then."""
    progress(have, total)
    while piece := connection.read():
        if have + len(piece) > MAX_BYTES:
            raise CorpusError(f"{url}: sends more than {MAX_BYTES} bytes; no file of the release has so many")
        file.write(piece)
        file.flush()
        have += len(piece)
        progress(have, total)
    return have


def _size(part: Path) -> int:
    return part.stat().st_size if part.exists() else 0


class _Watch:
    """Cuts connections off that send less than the least rate, be it in the head of an answer."""

    def __init__(self, patience: Patience) -> None:
        self._seconds = patience.timeout
        self._least = patience.least_rate * patience.timeout
        self._came = 0  # bytes, in the present span of `seconds`
        self._end = time.monotonic() + self._seconds
        self._sockets: list[socket.socket] = []
        self._over = threading.Event()
        self.cut_off = False
        threading.Thread(target=self._watch, name="lilgym_mp download watch", daemon=True).start()

    def add(self, sock: socket.socket) -> None:
        self._sockets.append(sock)

    def note(self, count: int) -> None:
        """Counts bytes that came; enough of them begin a new span."""
        self._came += count
        if self._came >= self._least:
            self._came, self._end = 0, time.monotonic() + self._seconds

    def stop(self) -> None:
        self._over.set()

    def _watch(self) -> None:
        while not self._over.wait(max(0.0, self._end - time.monotonic())):
            if time.monotonic() >= self._end:
                self.cut_off = True
                for sock in self._sockets:
                    with suppress(OSError):
                        sock.shutdown(socket.SHUT_RDWR)
                return


class _Redirects(urllib.request.HTTPRedirectHandler):
    """Follows redirects to where downloads may come from."""

    def redirect_request(self, req: Any, fp: Any, code: int, msg: str, headers: Any, newurl: str) -> Any:
        checked_url(newurl)
        return super().redirect_request(req, fp, code, msg, headers, newurl)


def _opener(watch: _Watch) -> urllib.request.OpenerDirector:
    """HTTP and HTTPS alone, over connections that are watched."""

    class Plain(http.client.HTTPConnection):
        def connect(self) -> None:
            super().connect()
            watch.add(self.sock)

    class Secure(http.client.HTTPSConnection):
        def connect(self) -> None:
            super().connect()
            watch.add(self.sock)

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
    """A server's answer, from byte `start` of the file on if the server can do that. A context manager."""

    def __init__(self, url: str, start: int, patience: Patience) -> None:
        """Raises _TryAgain for what may pass, CorpusError for a refusal."""
        self._url = url
        self._watch = _Watch(patience)
        try:
            self.response = self._opened(start, patience.timeout)
        except BaseException:
            self._watch.stop()
            raise

    def __enter__(self) -> _Connection:
        return self

    def __exit__(self, *fault: object) -> None:
        self._watch.stop()
        self.response.close()

    def _opened(self, start: int, timeout: float) -> http.client.HTTPResponse:
        url = self._url
        try:
            request = urllib.request.Request(url, headers={"User-Agent": USER_AGENT, "Accept-Encoding": "identity"})
            if start:
                request.add_header("Range", f"bytes={start}-")
            return _opener(self._watch).open(request, timeout=timeout)
        except urllib.error.HTTPError as answer:
            with answer:
                raise _refusal(url, answer) from None
        except urllib.error.URLError as fault:
            if isinstance(fault.reason, ssl.SSLCertVerificationError):
                raise CorpusError(
                    f"{url}: the server's certificate is not to be trusted: {_said(fault.reason)}"
                ) from None
            raise self._broken(f"cannot be reached: {_said(fault.reason)}") from None
        except (CorpusError, http.client.InvalidURL) as fault:
            raise CorpusError(f"cannot download from {url!r}: {_said(fault)}") from None
        except (OSError, http.client.HTTPException) as fault:
            raise self._broken(f"no proper answer: {_said(fault)}") from None
        except ValueError as fault:  # of a URL that it is sent on to, or of a header
            raise CorpusError(f"cannot download from {url!r}: no proper answer: {_said(fault)}") from None

    def read(self) -> bytes:
        """The bytes that have come, none at the end. Raises _TryAgain when the connection breaks."""
        try:
            piece = self.response.read1(CHUNK)
        except (OSError, http.client.HTTPException, ValueError) as fault:
            raise self._broken(f"the connection broke: {_said(fault)}") from None
        if self._watch.cut_off:
            raise self._broken("")
        self._watch.note(len(piece))
        return piece

    def _broken(self, what: str) -> _TryAgain:
        if self._watch.cut_off:
            return _TooSlow("the server sends too slowly")
        return _TryAgain(what)


def _said(fault: object) -> str:
    """What a library or a server says of a fault, in one line."""
    return " ".join(str(fault).split())[:LONGEST_REASON] or type(fault).__name__


def _refusal(url: str, answer: urllib.error.HTTPError) -> Exception:
    status = f"answers {answer.code} {_said(answer.reason)}"
    after = answer.headers.get("Retry-After", "")
    if answer.code == http.client.REQUESTED_RANGE_NOT_SATISFIABLE:
        return _NoSuchRange("the server has fewer bytes than were downloaded before")
    if answer.code in RETRIED or after:
        return _TryAgain(status, float(after) if _NUMBER.fullmatch(after) else 0.0)
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
    return 0, int(length) if _NUMBER.fullmatch(length) else None
