"""The report's page in Chromium."""

import io
import re
from dataclasses import replace
from unicodedata import normalize

import numpy as np
import pytest
from PIL import Image

from lilgym_mp.contrib.report import make_report
from lilgym_mp.evaluation import CONFIGURATIONS, Settings
from tests.browser import watched_page
from tests.report.recordings import EPISODES, written

AGENTS = ("imitation", "parse-and-plan", "ppo from imitation, sampled")
SUPERVISION = "programs of train statements of the corpus; truth of scenes; programs of generated statements"
# Ids of sections with invisible or empty images and tables, and of sections wider than the window.
HIDDEN = """() => [...document.querySelectorAll('section img, section table')].filter(part => {
    if (part.closest('details')) part.closest('details').open = true;
    const place = part.getBoundingClientRect();
    const shown = part.checkVisibility({opacityProperty: true, visibilityProperty: true});
    return !shown || !place.width || !place.height || (part.tagName == 'IMG' && !part.naturalWidth);
}).map(part => part.closest('section').id)"""
WIDER = """() => [...document.querySelectorAll('main section, nav')].filter(part =>
    part.getBoundingClientRect().right > document.documentElement.clientWidth + 1).map(part => part.id)"""


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    place = tmp_path_factory.mktemp("episodes")
    for seed in (0, 1):
        written(place, training_seed=seed, run=f"runs/{seed}")
    made = [replace(episode, stop_probabilities=(0.3,) * len(episode.actions)) for episode in EPISODES]
    written(place, made, agent="other <b>", run="runs/other")
    for agent in AGENTS:
        for name in CONFIGURATIONS:
            kept = EPISODES if name.startswith("Scatter") else EPISODES[2:3]  # of Tower only a STOP
            own = {"settings": Settings(name), "start_scenes": len(kept), "supervision": SUPERVISION}
            written(place, kept, **own, agent=agent, run=f"runs/{agent}")
    return make_report([place], tmp_path_factory.mktemp("made") / "report")


@pytest.mark.parametrize("width", [1280, 420])
def test_report__shows_and_links_every_item_without_network_requests(chromium, report, width):
    with watched_page(chromium, width) as watched:
        page = watched.page
        page.goto(report.as_uri())
        assert page.locator("section table").count() > 10
        assert page.locator("section img").count() > 5
        assert page.evaluate(HIDDEN) == []
        assert page.evaluate(WIDER) == []
        if width == 1280:  # Table 2 of five agents is shown whole
            table = "document.querySelector('section .scroll')"
            assert page.evaluate(f"{table}.scrollWidth - {table}.clientWidth") == 0
        assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
        for image in page.locator("section img").all():
            pixels = np.asarray(Image.open(io.BytesIO(image.screenshot())).convert("L"))
            assert pixels.std() > 5, f"blank: {image.get_attribute('alt')}"
        links = page.locator("nav a")
        targets = links.evaluate_all("links => links.map(link => link.getAttribute('href'))")
        assert targets == page.locator("main section").evaluate_all("parts => parts.map(part => '#' + part.id)")
        links.nth(len(targets) // 2).click()
        at_the_top = "id => document.querySelector(id).getBoundingClientRect().top < 100"
        page.wait_for_function(at_the_top, arg=targets[len(targets) // 2])
        assert watched.requests == []
        assert watched.faults == []


@pytest.mark.parametrize("dark", [False, True])
def test_report__passes_axe_and_folds_what_is_long(chromium, report, *, dark):
    with watched_page(chromium, dark=dark) as watched:
        page = watched.page
        page.goto(report.as_uri())
        assert page.locator("details[open]").count() == 0
        rows = "details => details.map(each => each.querySelectorAll('tbody tr').length)"
        assert max(page.locator("section:not(:has(details)) table").evaluate_all(rows)) <= 24
        page.evaluate("document.querySelectorAll('details').forEach(each => each.open = true)")
        assert watched.violations() == []
        assert watched.is_dark() == dark


def test_printed_report__has_every_column_of_every_table(chromium, report, tmp_path):
    pypdf = pytest.importorskip("pypdf")
    with watched_page(chromium) as watched:
        page = watched.page
        page.goto(report.as_uri())
        page.pdf(path=tmp_path / "report.pdf", prefer_css_page_size=True)
        cells = page.evaluate(
            "[...document.querySelectorAll('table')].flatMap(table => [...table.querySelectorAll('th, td')]"
            ".map(cell => cell.textContent.replace(/\\s+/g, '')))"
        )
        page.set_viewport_size({"width": 700, "height": 1000})  # 186 mm
        page.emulate_media(media="print")
        cut = "[...document.querySelectorAll('table, img')].filter(part => part.getBoundingClientRect().right > 701)"
        assert page.evaluate(f"{cut}.map(part => part.closest('section').id)") == []
        shown = "[...document.querySelectorAll('main h2, main section')].filter(part => part.checkVisibility())"
        assert "H2 H2" not in page.evaluate(f"{shown}.map(part => part.tagName).join(' ')")  # an empty chapter
    text = "".join(sheet.extract_text() for sheet in pypdf.PdfReader(tmp_path / "report.pdf").pages)
    text = re.sub(r"\s+", "", normalize("NFKC", text))  # the font has a ligature for "fi"
    assert [cell for cell in cells if cell not in text] == []
    for name in CONFIGURATIONS:
        assert f"{name}dev,n={6 if name.startswith('Scatter') else 1}" in text
    assert text.count(re.sub(r"\s+", "", SUPERVISION)) == len(AGENTS) * len(CONFIGURATIONS)  # in Basis
