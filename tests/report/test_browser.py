"""The report's page in Chromium."""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from lilgym_mp.report import make_report
from tests.browser import chromium, watched_page
from tests.report.test_items import EPISODES, written

# Ids of sections with invisible or empty images and tables, and of sections wider than the window.
HIDDEN = """() => [...document.querySelectorAll('section img, section table')].filter(part => {
    const place = part.getBoundingClientRect();
    const shown = part.checkVisibility({opacityProperty: true, visibilityProperty: true});
    return !shown || !place.width || !place.height || (part.tagName == 'IMG' && !part.naturalWidth);
}).map(part => part.closest('section').id)"""
WIDER = """() => [...document.querySelectorAll('main section, nav')].filter(part =>
    part.getBoundingClientRect().right > document.documentElement.clientWidth + 1).map(part => part.id)"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as opened:
        yield opened


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("episodes")
    for seed in (0, 1):
        written(place, training_seed=seed, run=f"runs/{seed}")
    made = [replace(episode, stop_probabilities=(0.3,) * len(episode.actions)) for episode in EPISODES]
    written(place, made, agent="other <b>", run="runs/other")
    return make_report([place], tmp_path_factory.mktemp("made") / "report")


@pytest.mark.parametrize("width", [1280, 420])
def test_report__shows_all_tables_and_figures_without_network_requests(browser: Any, report: Path, width: int):
    with watched_page(browser, width) as watched:
        watched.page.goto(report.as_uri())
        assert watched.page.locator("section table").count() > 10
        assert watched.page.locator("section img").count() > 5
        assert watched.page.evaluate(HIDDEN) == []
        assert watched.page.evaluate(WIDER) == []
        assert watched.page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
        assert watched.requests == []
        assert watched.faults == []


def test_report__navigation_links_to_every_item(browser: Any, report: Path):
    with watched_page(browser) as watched:
        watched.page.goto(report.as_uri())
        links = watched.page.locator("nav a")
        targets = links.evaluate_all("links => links.map(link => link.getAttribute('href'))")
        assert targets == watched.page.locator("main section").evaluate_all("parts => parts.map(part => '#' + part.id)")
        middle = len(targets) // 2
        links.nth(middle).click()
        at_the_top = "id => document.querySelector(id).getBoundingClientRect().top < 100"
        watched.page.wait_for_function(at_the_top, arg=targets[middle])


def test_report__figures_are_not_blank(browser: Any, report: Path):
    with watched_page(browser) as watched:
        watched.page.goto(report.as_uri())
        for image in watched.page.locator("section img").all():
            pixels = np.asarray(Image.open(io.BytesIO(image.screenshot())).convert("L"))
            assert pixels.std() > 5, image.get_attribute("alt")
