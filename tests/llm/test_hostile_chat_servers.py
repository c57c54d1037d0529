"""Whatever a chat server on loopback sends, HTTPAgent gives an answer or one AgentError, within its limits."""

from __future__ import annotations

import asyncio
import json
import socket
import threading
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, suppress
from itertools import takewhile

import pytest

from lilgym_mp.llm import AgentError, HTTPAgent

TIMEOUT_SECONDS = 0.4  # for servers that are slow
PATIENT_SECONDS = 60.0  # for the others, even on a busy machine
OK = b"HTTP/1.1 200 OK\r\n"
Response = Callable[[], Iterator[bytes]]


def _drip(head: bytes, piece: bytes) -> Response:
    def pieces() -> Iterator[bytes]:
        yield head
        while True:
            time.sleep(0.02)
            yield piece

    return pieces


def _content(content: bytes, status: bytes = b"200 OK") -> Response:
    return lambda: iter([b"HTTP/1.1 %s\r\nContent-Length: %d\r\n\r\n" % (status, len(content)), content])


def _endless() -> Iterator[bytes]:
    yield OK + b"\r\n"
    while True:
        yield b" " * 65_536


SLOW = "no complete reply within 0.4 seconds"
RESPONSES: dict[str, tuple[Response, str]] = {
    "nothing": (_drip(b"", b""), SLOW),
    "a dripping status": (_drip(b"HTTP/1.1 ", b"2"), ""),
    "dripping headers": (_drip(OK, b"X-A: b\r\n"), SLOW),
    "one dripping header": (_drip(OK + b"X: ", b"a"), SLOW),
    "a dripping body": (_drip(OK + b"Content-Length: 99999\r\n\r\n", b" "), SLOW),
    "dripping chunks": (_drip(OK + b"Transfer-Encoding: chunked\r\n\r\n", b"1\r\nx\r\n"), SLOW),
    "an endless body": (_endless, "the reply has more than 4,000,000 bytes"),
    "a closed connection": (lambda: iter([]), "RemoteProtocolError"),
    "garbage": (lambda: iter([b"\x00\xff\x1b[31m" * 100]), "RemoteProtocolError"),
    "an endless header": (lambda: iter([OK + b"X: " + b"a" * 300_000]), "RemoteProtocolError"),
    "a truncated body": (lambda: iter([OK + b"Content-Length: 100\r\n\r\n{"]), "RemoteProtocolError"),
    "HTML": (_content(b"<html>\x1b[31m"), r"not JSON: <html>\x1b[31m"),
    "deep nesting": (_content(b"[" * 100_000), "not JSON: [[["),
    "a number of 5,000 digits": (_content(b"9" * 5_000), "not JSON: 999"),
    "not UTF-8": (_content(b'"\xff\xfe"'), "not JSON"),
    "a list": (_content(b"[1]"), "no text choices[0].message.content: [1]"),
    "no choices": (_content(b'{"choices": []}'), "no text choices[0].message.content"),
    "choices of another type": (_content(b'{"choices": {"0": 1}}'), "no text choices[0].message.content"),
    "content of another type": (_content(b'{"choices": [{"message": {"content": [1]}}]}'), "no text choices"),
    "a refusal with escape codes": (_content(b"\x1b[31mno\x07\n", b"401 \x1b[31mNo"), r"HTTP 401: \x1b[31mno\x07"),
    "a gzip bomb": (_content(b"\x1f\x8b" * 9), "not JSON"),
}


def _whole_request(connection: socket.socket) -> bytes:
    """Closing a connection whose data was not all read would reset it, before the client has read the response."""
    with connection.makefile("rb") as stream:
        head = list(takewhile(bytes.strip, stream))
        length = next((int(line[15:]) for line in head if line.lower().startswith(b"content-length:")), 0)
        return b"".join(head) + stream.read(length)


@contextmanager
def hostile(response: Response) -> Generator[tuple[str, list[bytes]]]:
    """The URL of a server that sends this response to each request, and the requests."""
    over, requests = threading.Event(), list[bytes]()
    server = socket.create_server(("127.0.0.1", 0))
    server.settimeout(0.05)

    def serve() -> None:
        while not over.is_set():
            with suppress(OSError):
                connection, _ = server.accept()
                with connection:
                    connection.settimeout(5)
                    requests.append(_whole_request(connection))
                    for piece in response():
                        if over.is_set():
                            break
                        connection.sendall(piece)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.getsockname()[1]}", requests
    finally:
        over.set()
        thread.join()
        server.close()


@pytest.mark.parametrize("name", RESPONSES)
def test_hostile_response__is_one_error_within_the_limits(name: str):
    response, message = RESPONSES[name]
    with hostile(response) as (url, _):
        limit = PATIENT_SECONDS if message not in ("", SLOW) else TIMEOUT_SECONDS
        begun = time.monotonic()
        with pytest.raises(AgentError) as caught:
            HTTPAgent(url, "tiny", timeout_seconds=limit, retries=0).answer([])
        assert time.monotonic() - begun < 20  # seconds; without a limit the slow ones would never end
    text = str(caught.value)
    assert text.startswith(f"{url}/chat/completions: ")
    assert message in text
    assert text.isprintable()
    assert len(text) < 1_000


def test_redirect__is_not_followed_so_that_the_key_stays(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("OPENAI_API_KEY", "secret")
    with hostile(_content(b"{}")) as (other, stolen):
        redirect = b"HTTP/1.1 307 T\r\nContent-Length: 0\r\nLocation: %s\r\n\r\n" % other.encode()
        with hostile(lambda: iter([redirect])) as (url, requests), pytest.raises(AgentError) as caught:
            HTTPAgent(url, "tiny").answer([])
    assert "HTTP 307: ; redirects are not followed" in str(caught.value)
    assert b"Bearer secret" in requests[0]
    assert stolen == []


def test_answer__within_a_running_event_loop():
    async def ask(url: str) -> str:
        return HTTPAgent(url, "tiny").answer([]).text

    with hostile(_content(b'{"choices": [{"message": {"content": null}}]}')) as (url, _):
        assert asyncio.run(ask(url)) == ""


@pytest.mark.parametrize("usage", [3, [1], {"prompt_tokens": "many", "completion_tokens": -1}, {"prompt_tokens": True}])
def test_odd_token_counts__are_unknown(usage: object):
    content = json.dumps({"choices": [{"message": {"content": "STOP"}}], "usage": usage}).encode()
    with hostile(_content(content)) as (url, _):
        assert HTTPAgent(url, "tiny").answer([]) == ("STOP", None, None)


def test_key__with_a_line_end_inside_is_refused_without_being_shown(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("OPENAI_API_KEY", "secret\nX: y")
    with pytest.raises(AgentError, match="the key in OPENAI_API_KEY must consist of printable") as caught:
        HTTPAgent("http://127.0.0.1:9", "tiny")
    assert "secret" not in str(caught.value)


@pytest.mark.parametrize("url", ["http://", "http://[::1", "http://127.0.0.1:port", "http://" + "a" * 300])
def test_invalid_url__is_an_agent_error(url: str):
    with pytest.raises(AgentError):
        HTTPAgent(url, "tiny", retries=0, timeout_seconds=TIMEOUT_SECONDS).answer([])
