"""The application with a database of its own, and a browser of it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest


@pytest.fixture
def app(tmp_path) -> Iterator[Any]:
    from tests.web.web_app import server

    with server(tmp_path) as made:
        yield made


@pytest.fixture
def browser(app) -> Any:
    from tests.web.web_app import Browser

    return Browser(app)
