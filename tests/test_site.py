"""The documentation site builds without warnings, and its generated pages match the code."""

import os
import re
from types import SimpleNamespace

import pytest

import lilgym_mp  # noqa: F401
from tests.browser import watched_page
from tests.command_line import python
from tests.scripts import ROOT, load_script, needs

VISITED = ("index.html", "results.html", "api/environments.html", "environments/tower.html")
FETCHED = re.compile(r"""<(?:script|img|iframe|link)\b[^>]*?\b(?:src|href)=["']?(?:https?:)?//[^"'>\s]+""")


@pytest.fixture(scope="module")
def site(tmp_path_factory, installed_form):
    """The directory of the built site."""
    needs("mkdocs", "material", "mkdocstrings")  # of the extra `docs`
    place = tmp_path_factory.mktemp("site")
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1", "LILGYM_DOCS_PACKAGE": str(installed_form)}
    done = python("-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", place, cwd=ROOT, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "WARNING" not in done.stderr
    return place


@pytest.mark.long
def test_site__has_a_page_for_every_document_and_fetches_nothing_from_elsewhere(site):
    documents = [path.relative_to(ROOT / "docs").with_suffix(".html") for path in (ROOT / "docs").rglob("*.md")]
    assert [page for page in documents if not (site / page).exists()] == []
    assert {"changelog.html", "contributing.html"} <= {path.name for path in site.iterdir()}
    fetched = {found for page in site.rglob("*.html") for found in FETCHED.findall(page.read_text())}
    assert {link for link in fetched if "canonical" not in link} == set()


def test_environment_pages__are_up_to_date():
    pages = load_script("write_environment_pages").documents()
    stale = [path.name for path, text in pages.items() if path.read_text() != text]
    assert not stale, "run scripts/write_environment_pages.py"


def test_interval__does_not_break_within_its_brackets():
    pytest.importorskip("mkdocs")
    page = SimpleNamespace(file=SimpleNamespace(src_uri="results.md"))
    rewritten = load_script("site_hooks").on_page_markdown("32.9 [−1.5, +36.2], ([19, 5])", page, None, None)
    assert rewritten == "32.9 [−1.5,\u00a0+36.2], ([19, 5])"


@pytest.mark.long
@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_site__opened_from_its_directory_shows_its_pages_without_a_fault_and_passes_axe(chromium, site, *, dark):
    # The corner of a matrix is empty; style sheets of files cannot be loaded again.
    options = "{preload: false, rules: {'empty-table-header': {enabled: false}}}"
    with watched_page(chromium, dark=dark) as watched:
        for page in VISITED:
            watched.page.goto((site / page).as_uri())
            assert watched.page.evaluate("document.documentElement.scrollWidth <= window.innerWidth"), page
            assert watched.is_dark() == dark
            assert watched.violations(options) == [], page
        assert watched.requests == []
        assert watched.faults == []


@pytest.mark.long
def test_site__opened_from_its_directory_is_searched(chromium, site):
    with watched_page(chromium, 1400) as watched:
        page = watched.page
        page.goto((site / "index.html").as_uri())
        page.locator(".md-search__input").click()
        page.keyboard.type("ScatterFlipIt")
        found = page.locator(".md-search-result__item a").first
        found.wait_for()
        page.wait_for_function("document.querySelector('.md-search-result__meta').textContent.match(/\\d/)")
        assert "environments/index.html" in found.get_attribute("href")
        assert watched.requests == []
        assert watched.faults == []
