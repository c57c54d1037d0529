"""The web application in this process, and test clients that behave like browsers."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("fastapi", reason="the web application needs the extra `web`")
pytest.importorskip("sqlalchemy", reason="the web application needs the extra `web`")
pytest.importorskip("httpx", reason="tests of the web application need httpx")

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # Starlette deprecates httpx in favour of a successor
    from starlette.testclient import TestClient

from lilgym_mp.web import ServeOptions, create_app
from lilgym_mp.web.authentication import issue_token

UNLIMITED: dict[str, Any] = {"requests_per_second": None}


class Browser:
    """A test client with its own cookie and CSRF token."""

    def __init__(self, app: Any, **headers: str) -> None:
        self.app = app
        self.client = TestClient(app, raise_server_exceptions=False, headers=headers)
        self._token: str | None = None

    def get(self, path: str, **options: Any) -> Any:
        return self.client.get(path, **options)

    def send(self, method: str, path: str, body: Any = None, **options: Any) -> Any:
        """Sends a state-changing request with the CSRF token."""
        if self._token is None:
            self._token = self.client.get("/api/session").json()["csrf_token"]
        headers = {"X-CSRF-Token": self._token, **options.pop("headers", {})}
        return self.client.request(method, path, json=body, headers=headers, **options)

    def post(self, path: str, body: Any = None, **options: Any) -> Any:
        return self.send("POST", path, body, **options)

    def log_in(self, name: str, role: str = "annotator") -> Browser:
        """Logs in as a person, created if missing."""
        with self.app.state.services.database.write_session() as session:
            token = issue_token(session, name, role)
        assert self.client.get("/login", params={"token": token}, follow_redirects=False).status_code == 303
        self._token = None
        return self


@contextmanager
def server(directory: Path, **options: Any) -> Iterator[Any]:
    """The application, with a database in the directory."""
    database = f"sqlite:///{directory / 'web.sqlite3'}"
    app = create_app(ServeOptions(**{"database": database, **UNLIMITED, **options}))
    try:
        yield app
    finally:
        app.state.services.close()
