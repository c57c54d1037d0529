"""The application with a database of its own, and a browser of it."""

import pytest


@pytest.fixture
def app(tmp_path):
    from tests.web.web_app import server

    with server(tmp_path) as made:
        yield made


@pytest.fixture
def browser(app):
    from tests.web.web_app import Browser

    return Browser(app)
