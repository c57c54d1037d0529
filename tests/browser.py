"""Headless Chromium for tests, driven by Playwright, with a record of requests and errors."""

import shutil
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome")
FLAGS = ("--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage")
START_MS = 120_000  # generous, for a loaded machine
LOCAL = ("file", "data", "blob", "about")


class Watched:
    """A page with its network requests and errors."""

    def __init__(self, page):
        self.page = page
        self.requests = []  # URLs, except local ones
        self.faults = []  # console errors and warnings, uncaught exceptions, failed requests
        self.page.on("request", lambda request: self._record_request(request.url))
        self.page.on("requestfailed", lambda request: self.faults.append(f"failed: {request.url}"))
        self.page.on("pageerror", lambda fault: self.faults.append(str(fault)))
        self.page.on("console", self._record_message)

    def violations(self, options="{}"):
        """What axe-core says against the page's accessibility, with HTML."""
        self.page.evaluate(axe_script())
        check = "violations.map(one => [one.id, one.nodes.map(node => node.html)])"
        return self.page.evaluate(f"async () => (await axe.run({options})).{check}")

    def is_dark(self):
        """Whether the page's background is dark."""
        colour = "getComputedStyle(document.body).backgroundColor.match(/\\d+/g).slice(0, 3).map(Number)"
        return max(self.page.evaluate(colour)) < 100

    def _record_request(self, url):
        if urlsplit(url).scheme not in LOCAL:
            self.requests.append(url)

    def _record_message(self, message):
        if message.type in ("error", "warning"):
            self.faults.append(f"{message.type}: {message.text}")


@contextmanager
def chromium():
    """A Playwright browser; skips if Chromium or Playwright is missing."""
    sync_api = pytest.importorskip("playwright.sync_api")
    program = next(filter(None, map(shutil.which, NAMES)), None)
    if program is None:
        pytest.skip(f"no browser: none of {', '.join(NAMES)} is on the PATH")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=list(FLAGS), timeout=START_MS)
        try:
            yield browser
        finally:
            browser.close()


def axe_script():
    """The source of axe-core, which checks accessibility; skips if it is not installed."""
    package = pytest.importorskip("axe_playwright_python")
    return (Path(package.__file__).parent / "axe.min.js").read_text()


@contextmanager
def watched_page(browser, width=1280, height=900, *, url=None, dark=False, bypass_csp=False):
    """A new page in a window of the given size in pixels; paths are relative to `url`."""
    context = browser.new_context(
        viewport={"width": width, "height": height},
        color_scheme="dark" if dark else "light",
        bypass_csp=bypass_csp,
        base_url=url,
    )
    try:
        context.set_default_timeout(START_MS)
        yield Watched(context.new_page())
    finally:
        context.close()
