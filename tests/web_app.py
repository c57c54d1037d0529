"""A server of the browser suite in this process, and browsers that send it requests."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("fastapi", reason="the browser suite needs the extra `web`")
pytest.importorskip("sqlalchemy", reason="the browser suite needs the extra `web`")
pytest.importorskip("httpx", reason="the browser suite's tests need httpx")

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # Starlette would rather have the successor of httpx, which few have yet
    from starlette.testclient import TestClient

from lilgym_mp.web import ServeOptions, create_app
from lilgym_mp.web.authentication import issue_token

UNLIMITED: dict[str, Any] = {"requests_per_second": None}


class Browser:
    """One browser: its cookie, and the CSRF token that its pages hold."""

    def __init__(self, app: Any, **headers: str) -> None:
        self.app = app
        self.client = TestClient(app, raise_server_exceptions=False, headers=headers)
        self._token: str | None = None

    def get(self, path: str, **options: Any) -> Any:
        return self.client.get(path, **options)

    def send(self, method: str, path: str, body: Any = None, **options: Any) -> Any:
        """A state-changing request as a page sends it."""
        if self._token is None:
            self._token = self.client.get("/api/session").json()["csrf_token"]
        headers = {"X-CSRF-Token": self._token, **options.pop("headers", {})}
        return self.client.request(method, path, json=body, headers=headers, **options)

    def post(self, path: str, body: Any = None, **options: Any) -> Any:
        return self.send("POST", path, body, **options)

    def log_in(self, name: str, role: str = "annotator") -> Browser:
        """Opens the link of a person, who is made where there is none."""
        with self.app.state.services.database.write_session() as session:
            token = issue_token(session, name, role)
        assert self.client.get("/login", params={"token": token}, follow_redirects=False).status_code == 303
        self._token = None
        return self


@contextmanager
def server(directory: Path, **options: Any) -> Iterator[Any]:
    """The application on a database in the directory."""
    database = f"sqlite:///{directory / 'web.sqlite3'}"
    app = create_app(ServeOptions(**{"database": database, **UNLIMITED, **options}))
    try:
        yield app
    finally:
        app.state.services.close()
