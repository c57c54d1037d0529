"""The pages in a real browser: by keyboard alone, 360 pixels wide, without a fault, with nothing from elsewhere."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from tests.browser import Watched, chromium, watched_page
from tests.web_app import Browser, server

uvicorn = pytest.importorskip("uvicorn", reason="the browser suite needs the extra `web`")

PAGES = ("/", "/play", "/annotate", "/annotate/guidelines", "/explore", "/explore/tower/dev/tower-dev-001", "/nowhere")


@contextmanager
def served(directory: Path) -> Iterator[tuple[str, Any]]:
    """The URL of a server in a thread, and its application."""
    with server(directory) as app:
        running = uvicorn.Server(uvicorn.Config(app, port=0, log_level="error", lifespan="off"))
        thread = threading.Thread(target=running.run, daemon=True)
        thread.start()
        while not running.started:
            time.sleep(0.02)
        yield f"http://127.0.0.1:{running.servers[0].sockets[0].getsockname()[1]}", app
        running.should_exit = True
        thread.join(20)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as opened:
        yield opened


def _is_clean(watched: Watched, url: str, *allowed: str) -> None:
    assert {urlsplit(asked).netloc for asked in watched.requests} == {urlsplit(url).netloc}
    assert [fault for fault in watched.faults if not any(each in fault for each in allowed)] == []


def test_play__by_keyboard_alone(browser: Any, tmp_path: Path):
    with served(tmp_path) as (url, _), watched_page(browser) as watched:
        page = watched.page
        page.set_default_timeout(60_000)
        page.goto(f"{url}/play")
        page.select_option("[name=configuration]", "ScatterFlipIt")
        page.focus("text=Draw a task")
        page.keyboard.press("Enter")
        page.wait_for_selector("#statement:not(:empty)")
        page.wait_for_selector(".cells button[data-column='0']:focus")
        for _ in range(2):
            page.keyboard.press("ArrowRight")
        page.keyboard.press("ArrowDown")
        page.keyboard.press("l")
        page.wait_for_selector(".cells button.legal")
        label = page.evaluate("document.activeElement.getAttribute('aria-label')")
        assert label.startswith("column 2, row 1")
        page.evaluate("document.querySelector('.cells button.legal').focus()")
        page.keyboard.press("Enter")
        page.wait_for_selector("#history:has-text('So far: ADD(')")
        page.focus("#stop")
        page.keyboard.press("Enter")
        page.wait_for_selector("#parts li")
        assert page.inner_text("#end-title")
        _is_clean(watched, url)


@pytest.mark.parametrize("dark", [False, True])
def test_pages__fit_360_pixels_and_load_nothing_from_elsewhere(browser: Any, tmp_path: Path, dark: bool):
    with served(tmp_path) as (url, _), watched_page(browser, 360, 740, dark=dark) as watched:
        watched.page.set_default_timeout(60_000)
        for path in PAGES:
            watched.page.goto(url + path, wait_until="networkidle")
            wider = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
            assert watched.page.evaluate(wider) <= 0, path
        _is_clean(watched, url, "404", "icon.svg")  # the icon is not waited for when the next page is opened


def test_annotate__a_draft_outlives_a_server_that_does_not_answer(browser: Any, tmp_path: Path):
    from tests.test_web_annotate import BLUE, _lines, given, imported

    with served(tmp_path) as (url, app), watched_page(browser) as watched:
        organiser = Browser(app).log_in("Olga", "organiser")
        imported(organiser, _lines(1))
        given(organiser, "Ada")
        path = organiser.post("/api/annotate/people", {"name": "Ada"}).json()["path"]
        page = watched.page
        page.set_default_timeout(60_000)
        page.goto(url + path)
        page.click("#work a")
        page.wait_for_selector("#work:not([aria-busy])")
        page.route("**/draft", lambda route: route.abort())
        page.fill("#program", BLUE)
        page.wait_for_selector("#saved:has-text('Not saved')")
        page.unroute("**/draft")
        page.reload()
        page.wait_for_selector("#work:not([aria-busy])")
        page.wait_for_selector("text=is back")
        assert page.input_value("#program") == BLUE
        page.click("#run")
        page.wait_for_selector("#submit:not([disabled])")
        page.click("#submit")
        page.wait_for_selector("text=Accepted")
