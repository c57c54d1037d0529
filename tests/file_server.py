"""A web server on loopback that serves files from memory, with a configurable fault for each request."""

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
class FaultyResponse:
    """A fault of one response; the default is none."""

    status: int | None = None  # a response without content
    headers: dict[str, str] = field(default_factory=dict)
    breaks_after: int | None = None  # bytes of content, then the connection ends
    resets: bool = False  # resets the connection instead of responding
    ignores_range: bool = False
    content_range: str | None = None  # instead of the true one
    content: bytes | None = None  # instead of the true one


class Request(NamedTuple):
    path: str
    range: str | None


class FileServer:
    """Files by path, queued faults by path, and the requests received so far."""

    def __init__(self, url: str) -> None:
        self.url = url
        self.files: dict[str, bytes] = {}
        self.faults: dict[str, list[FaultyResponse]] = {}
        self.requests: list[Request] = []

    def requested_ranges(self, path: str) -> list[str | None]:
        """The ranges requested of a path, None for the whole file."""
        return [request.range for request in self.requests if request.path == path]

    def serve_repository(self, name: str, commit: str, files: dict[str, bytes]) -> None:
        """Serves a repository like GitHub's API and raw files, both under this server's URL."""
        tree: list[dict[str, Any]] = [{"path": "data", "type": "tree", "sha": "0" * 40}]
        for path, content in files.items():
            blob = hashlib.sha1(b"blob %d\0" % len(content) + content).hexdigest()
            tree.append({"path": path, "type": "blob", "sha": blob, "size": len(content)})
            self.files[f"/{name}/{commit}/{quote(path)}"] = content
        self.files[f"/repos/{name}/commits/HEAD"] = json.dumps({"sha": commit}).encode()
        self.files[f"/repos/{name}/git/trees/{commit}?recursive=1"] = json.dumps({"tree": tree}).encode()


def _handler(web: FileServer) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def do_GET(self) -> None:
            request = Request(self.path, self.headers.get("Range"))
            web.requests.append(request)
            faults = web.faults.get(self.path)
            self.close_connection = True
            self._respond(request, faults.pop(0) if faults else FaultyResponse())

        def _respond(self, request: Request, fault: FaultyResponse) -> None:
            content = web.files.get(request.path) if fault.content is None else fault.content
            if fault.resets:
                self.connection.shutdown(socket.SHUT_RDWR)
                return
            if fault.status or content is None:
                self._begin(fault.status or 404, {"Content-Length": "0", **fault.headers})
                return
            start = 0 if request.range is None or fault.ignores_range else int(request.range[len("bytes=") : -1])
            if start >= len(content) > 0:
                self._begin(416, {"Content-Range": f"bytes */{len(content)}", "Content-Length": "0"})
                return
            headers = {"Content-Length": str(len(content) - start), **fault.headers}
            if start:
                headers["Content-Range"] = fault.content_range or f"bytes {start}-{len(content) - 1}/{len(content)}"
            self._begin(206 if start else 200, headers)
            stop = len(content) if fault.breaks_after is None else start + fault.breaks_after
            self.wfile.write(content[start:stop])

        def _begin(self, status: int, headers: dict[str, str]) -> None:
            self.send_response(status)
            for name, value in {**headers, "Connection": "close"}.items():
                self.send_header(name, value)
            self.end_headers()

        def log_message(self, format: str, *args: Any) -> None:
            """Logs nothing."""

    return Handler


@contextmanager
def file_server() -> Generator[FileServer, None, None]:
    web = FileServer("")
    with ThreadingHTTPServer(("127.0.0.1", 0), _handler(web)) as server:
        web.url = f"http://127.0.0.1:{server.server_port}"
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
        thread.start()
        try:
            yield web
        finally:
            server.shutdown()
            thread.join()
