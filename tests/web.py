"""A web server on loopback that serves files from memory and misbehaves as told, request by request."""

from __future__ import annotations

import hashlib
import json
import socket
import threading
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, NamedTuple
from urllib.parse import quote


@dataclass(frozen=True)
class Misdeed:
    """What is wrong with one answer."""

    status: int | None = None  # an answer without content
    headers: dict[str, str] = field(default_factory=dict)
    breaks_after: int | None = None  # bytes of content, then the connection ends
    resets: bool = False  # without an answer
    ignores_range: bool = False
    content_range: str | None = None  # instead of the true one
    content: bytes | None = None  # instead of the true one


class Asked(NamedTuple):
    path: str
    range: str | None


class Web:
    """Files by path, misdeeds to come for each path (first come, first served), and what was asked so far."""

    def __init__(self, url: str) -> None:
        self.url = url
        self.files: dict[str, bytes] = {}
        self.misdeeds: dict[str, list[Misdeed]] = {}
        self.asked: list[Asked] = []

    def asked_for(self, path: str) -> list[str | None]:
        """The ranges asked of a path, None for all of it."""
        return [asked.range for asked in self.asked if asked.path == path]

    def serve_repository(self, name: str, commit: str, files: dict[str, bytes]) -> None:
        """Answers as GitHub's API and its raw files do, both under this server's URL."""
        tree: list[dict[str, Any]] = [{"path": "data", "type": "tree", "sha": "0" * 40}]
        for path, content in files.items():
            blob = hashlib.sha1(b"blob %d\0" % len(content) + content).hexdigest()
            tree.append({"path": path, "type": "blob", "sha": blob, "size": len(content)})
            self.files[f"/{name}/{commit}/{quote(path)}"] = content
        self.files[f"/repos/{name}/commits/HEAD"] = json.dumps({"sha": commit}).encode()
        self.files[f"/repos/{name}/git/trees/{commit}?recursive=1"] = json.dumps({"tree": tree}).encode()


def _handler(web: Web) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def do_GET(self) -> None:
            asked = Asked(self.path, self.headers.get("Range"))
            web.asked.append(asked)
            waiting = web.misdeeds.get(self.path)
            self.close_connection = True
            self._answer(asked, waiting.pop(0) if waiting else Misdeed())

        def _answer(self, asked: Asked, misdeed: Misdeed) -> None:
            content = web.files.get(asked.path) if misdeed.content is None else misdeed.content
            if misdeed.resets:
                self.connection.shutdown(socket.SHUT_RDWR)
                return
            if misdeed.status or content is None:
                self._begin(misdeed.status or 404, {"Content-Length": "0", **misdeed.headers})
                return
            start = 0 if asked.range is None or misdeed.ignores_range else int(asked.range[len("bytes=") : -1])
            if start >= len(content) > 0:
                self._begin(416, {"Content-Range": f"bytes */{len(content)}", "Content-Length": "0"})
                return
            headers = {"Content-Length": str(len(content) - start), **misdeed.headers}
            if start:
                headers["Content-Range"] = misdeed.content_range or f"bytes {start}-{len(content) - 1}/{len(content)}"
            self._begin(206 if start else 200, headers)
            stop = len(content) if misdeed.breaks_after is None else start + misdeed.breaks_after
            self.wfile.write(content[start:stop])

        def _begin(self, status: int, headers: dict[str, str]) -> None:
            self.send_response(status)
            for name, value in {**headers, "Connection": "close"}.items():
                self.send_header(name, value)
            self.end_headers()

        def log_message(self, format: str, *args: Any) -> None:
            """Says nothing."""

    return Handler


@contextmanager
def web_server() -> Generator[Web, None, None]:
    web = Web("")
    with ThreadingHTTPServer(("127.0.0.1", 0), _handler(web)) as server:
        web.url = f"http://127.0.0.1:{server.server_port}"
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
        thread.start()
        try:
            yield web
        finally:
            server.shutdown()
            thread.join()
