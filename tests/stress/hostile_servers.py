"""Downloads from misbehaving servers on loopback: each must end in bounded time with one clear error.

Run: python -m tests.stress.hostile_servers
"""

from __future__ import annotations

import argparse
import socket
import tempfile
import threading
import time
import zlib
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from lilgym_mp.corpus import CorpusError
from lilgym_mp.corpus.official.fetching import Limits, fetch

MAX_SECONDS = 5.0  # for a download with the limits below
LIMITS = Limits(tries=1, seconds=0.6, silence=0.4)
OK = b"HTTP/1.1 200 OK\r\n"


def _drip(head: bytes, piece: bytes) -> Iterator[bytes]:
    yield head
    while True:
        time.sleep(0.02)
        yield piece


def _zeros() -> Iterator[bytes]:
    compress = zlib.compressobj(wbits=31)
    yield OK + b"Content-Encoding: gzip\r\n\r\n"
    while True:
        yield compress.compress(bytes(1 << 24))


def _redirect(to: bytes) -> Iterator[bytes]:
    yield b"HTTP/1.1 302 Found\r\nContent-Length: 0\r\nLocation: " + to + b"\r\n\r\n"


def _answer(*pieces: bytes) -> Callable[[], Iterator[bytes]]:
    return lambda: iter(pieces)


SERVERS: dict[str, Callable[[], Iterator[bytes]]] = {
    "drips a body": lambda: _drip(OK + b"Content-Length: 9999999\r\n\r\n", b"x"),
    "drips a body of unknown length": lambda: _drip(OK + b"\r\n", b"x"),
    "drips a status line": lambda: _drip(b"HTTP/1.1 ", b"2"),
    "drips headers": lambda: _drip(OK, b"X-A: b\r\n"),
    "drips one header": lambda: _drip(OK + b"X: ", b"a"),
    "drips chunk extensions": lambda: _drip(OK + b"Transfer-Encoding: chunked\r\n\r\n1;", b"a"),
    "drips chunks": lambda: _drip(OK + b"Transfer-Encoding: chunked\r\n\r\n", b"1\r\nx\r\n"),
    "sends nothing": lambda: _drip(b"", b""),
    "hangs up": _answer(),
    "sends garbage": _answer(b"\x00\xff\x1b[31m" * 100),
    "an endless status line": _answer(b"HTTP/1.1 200 " + b"a" * 200_000),
    "an endless header": _answer(OK + b"X: " + b"a" * 200_000),
    "many headers": _answer(OK + b"X: a\r\n" * 5_000 + b"\r\n"),
    "a status in words": _answer(b"HTTP/1.1 two hundred\r\n\r\n"),
    "a status with escape codes": _answer(b"HTTP/1.1 404 \x1b[31mred\x07\r\nContent-Length: 0\r\n\r\n"),
    "a length in words": _answer(OK + b"Content-Length: many\r\n\r\nbody"),
    "a length in superscript digits": _answer(OK + b"Content-Length: \xb2\r\n\r\nbody"),
    "a negative length": _answer(OK + b"Content-Length: -5\r\n\r\nbody"),
    "a huge length": _answer(OK + b"Content-Length: " + b"9" * 5_000 + b"\r\n\r\nbody"),
    "a body that is too short": _answer(OK + b"Content-Length: 100\r\n\r\nbody"),
    "chunks of nonsense": _answer(OK + b"Transfer-Encoding: chunked\r\n\r\nzz\r\nbody"),
    "a huge chunk": _answer(OK + b"Transfer-Encoding: chunked\r\n\r\n" + b"f" * 60 + b"\r\nbody"),
    "compressed zeros without end": lambda: _zeros(),
    "compressed nonsense": _answer(OK + b"Content-Encoding: gzip\r\nContent-Length: 4\r\n\r\nbody"),
    "a first answer of 206": _answer(b"HTTP/1.1 206 P\r\nContent-Range: bytes 5-8/9\r\nContent-Length: 4\r\n\r\nbody"),
    "a first answer of 416": _answer(b"HTTP/1.1 416 R\r\nContent-Length: 0\r\n\r\n"),
    "an invalid pause": _answer(b"HTTP/1.1 503 S\r\nRetry-After: \xb2\r\nContent-Length: 0\r\n\r\n"),
    "a long pause": _answer(b"HTTP/1.1 503 S\r\nRetry-After: 99999999\r\nContent-Length: 0\r\n\r\n"),
    "a redirect to itself": lambda: _redirect(b"/file"),
    "a redirect to ftp": lambda: _redirect(b"ftp://127.0.0.1/file"),
    "a redirect to a file": lambda: _redirect(b"file:///etc/passwd"),
    "an empty redirect": lambda: _redirect(b""),
    "a redirect to an invalid address": lambda: _redirect(b"http://[::1/file"),
    "a redirect to an invalid port": lambda: _redirect(b"http://127.0.0.1:port/file"),
    "a redirect to a long name": lambda: _redirect(b"http://" + b"a" * 300 + b"/file"),
    "a redirect with escape codes": lambda: _redirect(b"http://\x1b[31m/\x07"),
    "a redirect without an address": _answer(b"HTTP/1.1 302 Found\r\nContent-Length: 0\r\n\r\n"),
}


@contextmanager
def hostile(answer: Callable[[], Iterator[bytes]]) -> Generator[str, None, None]:
    """The URL of a server that gives every request this answer."""
    over = threading.Event()
    server = socket.create_server(("127.0.0.1", 0))
    server.settimeout(0.05)

    def serve_one(connection: socket.socket) -> None:
        with connection, suppress(OSError):
            connection.settimeout(5)
            connection.recv(65_536)
            for piece in answer():
                if over.is_set():
                    return
                connection.sendall(piece)

    def serve() -> None:
        while not over.is_set():
            with suppress(TimeoutError):
                connection, _ = server.accept()
                threading.Thread(target=serve_one, args=(connection,), daemon=True).start()

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.getsockname()[1]}/file"
    finally:
        over.set()
        thread.join()
        server.close()


def outcome(name: str) -> tuple[str, float]:
    """The message of a download from a server, and its seconds. Errors other than CorpusError are raised."""
    begun = time.monotonic()
    message = "success"
    with hostile(SERVERS[name]) as url, tempfile.TemporaryDirectory() as directory:
        try:
            fetch(url, Path(directory) / "file", limits=LIMITS)
        except CorpusError as error:
            message = str(error)
            if url not in message:
                raise AssertionError(f"{name}: {message!r} does not name {url}") from None
            if any(Path(directory).iterdir()):
                raise AssertionError(f"{name}: left a file") from None
    return message, time.monotonic() - begun


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    for name in SERVERS:
        message, seconds = outcome(name)
        print(f"{name}: {seconds:.1f} s: {message}", flush=True)
        assert seconds < MAX_SECONDS, name
        assert message.isprintable(), name
    print(f"{len(SERVERS)} hostile servers, each ended with a clear error or with everything the server sent")


if __name__ == "__main__":
    main()
