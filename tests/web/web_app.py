"""The web application in this process, and test clients that behave like browsers."""

import warnings
from contextlib import contextmanager

import pytest

pytest.importorskip("fastapi")
pytest.importorskip("httpx")

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # Starlette deprecates httpx in favour of a successor
    from starlette.testclient import TestClient

from anyio.from_thread import start_blocking_portal

from lilgym_mp.contrib.web.app import ServeOptions, create_app


class Browser(TestClient):
    """A test client with its own cookies."""

    def __init__(self, app):
        super().__init__(app, raise_server_exceptions=False)
        self.portal = app.state.portal

    def post(self, path, body=None, **options):
        return super().post(path, json=body, **options)


def assert_refused(response, status, said=""):
    """A response of an error has the status, and a message with the text."""
    assert response.status_code == status, response.text
    message = response.json()["message"]
    assert message
    assert said in message


@contextmanager
def server(directory, **options):
    """The application, with a database in the directory."""
    app = create_app(ServeOptions(**{"database": directory / "web.sqlite3", **options}))
    with start_blocking_portal() as app.state.portal:  # one event loop, where clients would start one per request
        yield app
