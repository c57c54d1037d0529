"""Takes the screenshots of docs/web.md: starts a server with recordings of shipped agents, and opens every page.

    python scripts/web_screenshots.py [--out docs/pictures/web] [--all]

Needs the extras `web` and `browser`, and Chromium. --all takes each page in light and dark, 1280, 768 and 360 pixels
wide.
"""

from __future__ import annotations

import argparse
import io
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, chdir, contextmanager, redirect_stdout
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import uvicorn
from PIL import Image
from playwright.sync_api import Page, sync_playwright  # pyright: ignore[reportMissingImports]

from lilgym_mp.cli import main as command
from lilgym_mp.contrib.web.app import ServeOptions, create_app
from lilgym_mp.evaluation import Settings
from lilgym_mp.evaluation.film import save_gif
from lilgym_mp.scene.actions import describe
from lilgym_mp.scene.arrays import UInt8Array
from lilgym_mp.solver import Solver

PICTURES = Path(__file__).resolve().parents[1] / "docs" / "pictures" / "web"
FLAGS = ("--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--force-color-profile=srgb")
SCATTER_TASK = "scatter-dev-025-a"
FILM_TASK = "scatter-dev-029"  # "All three colors can be seen in the picture."
FILM_ITEMS = (
    (1, 2, "CIRCLE", "LARGE", "YELLOW"),
    (9, 1, "SQUARE", "LARGE", "BLUE"),
    (16, 3, "TRIANGLE", "LARGE", "BLACK"),
)
FILM_CLIP: Any = {"x": 72, "y": 70, "width": 680, "height": 560}
FILM = "play-film"
COLOURS = 96  # palette size: enough for these pages


class Theme(NamedTuple):
    """A window size and colour scheme."""

    suffix: str
    width: int
    height: int
    dark: bool


THEMES = [
    Theme(f"{'' if width == 1280 else f'-{width}'}{'-dark' * dark}", width, height, dark)
    for width, height in ((1280, 900), (768, 1024), (360, 740))
    for dark in (False, True)
]


class Shot(NamedTuple):
    """A page, and the actions performed on it before the screenshot."""

    name: str
    path: str
    prepare: Callable[[Page], None] | None = None


def _begin(page: Page, configuration: str, task_id: str) -> None:
    page.wait_for_selector("#episode:not([aria-busy]) .cells button")
    page.select_option("[name=configuration]", configuration)
    page.wait_for_selector("#episode:not([aria-busy])")
    page.evaluate("id => begin(id)", task_id)
    page.wait_for_function("id => episode.task_id === id", arg=task_id)


def _show_legal(configuration: str, task_id: str) -> Callable[[Page], None]:
    def prepare(page: Page) -> None:
        _begin(page, configuration, task_id)
        page.click("#legal")
        page.wait_for_selector(".cells button.legal")

    return prepare


def _play_to_the_end(page: Page) -> None:
    _begin(page, "ScatterFlipIt", SCATTER_TASK)
    page.click("#stop")
    page.wait_for_selector("#end-title:focus")
    page.click("#solution")
    page.wait_for_selector("#expert .step:not(:empty)")
    page.click("#expert .forth")
    page.click("#why summary")
    page.locator("#episode").scroll_into_view_if_needed()
    page.locator("#parts button").last.hover()


def _write_a_program(page: Page) -> None:
    page.fill("[name=name]", "Ada")
    page.fill("#program", "exist(filter_obj(all_items, lambda x: is_blue(x)))")
    page.wait_for_selector("#program-fault:empty")
    page.click("#run")
    page.wait_for_selector("#result li")
    page.locator("#result details[open] button").last.hover()


def _read_a_sentence(page: Page) -> None:
    page.click("#ask [type=submit]")
    page.wait_for_selector("#plan .step:has-text(': STOP')")


def _play_ten(page: Page) -> None:
    """Solves the ten tasks with the expert, except the third."""
    settings = Settings("TowerFlipIt")
    solver, tasks = Solver(settings.dynamics()), settings.make("dev").tasks
    for number in range(1, 11):
        page.wait_for_selector(f"#progress:has-text('Task {number} of 10')")
        page.wait_for_selector("#tools:not([hidden])")
        for action in solver.solve(tasks.by_id(page.evaluate("episode.task_id"))).actions:
            page.evaluate("action => act(action)", "STOP" if number == 3 else describe(action))
        page.wait_for_selector(f"#rows tr:nth-child({number})")
        if number < 10:
            page.click("#next")
    page.wait_for_selector("#share:not([hidden])")
    page.evaluate("document.querySelector('#picture').decode()")


def _wait_for(selector: str) -> Callable[[Page], None]:
    def prepare(page: Page) -> None:
        page.wait_for_selector(selector)

    return prepare


def _watch(page: Page) -> None:
    page.wait_for_selector("#episodes button")
    page.select_option("#beside", index=1)
    page.select_option("[name=outcome]", "success")
    page.wait_for_timeout(1_000)
    page.wait_for_selector("[aria-busy]", state="detached")
    page.locator("#episodes button").nth(6).click()
    page.wait_for_timeout(1_000)
    page.wait_for_selector("[aria-busy]", state="detached")
    page.press("#viewer", "ArrowRight")
    page.locator("#viewer").scroll_into_view_if_needed()
    page.evaluate("document.getElementById('viewer').scrollIntoView()")


def _sit(chosen: dict[str, str]) -> Callable[[Page], None]:
    def prepare(page: Page) -> None:
        page.evaluate("document.getElementById('more').open = true")
        for name, value in chosen.items():
            page.select_option(f"#setup [name={name}]", value)
        page.evaluate("document.getElementById('more').open = false")
        page.click("#setup [type=submit]")
        page.wait_for_selector("#seat h2:not(:empty)")
        page.evaluate("document.getElementById('seat').scrollIntoView()")

    return prepare


def _propose(page: Page) -> None:
    _sit({"configuration": "ScatterFlipIt", "rewards": "hidden", "verifier": "person"})(page)
    page.click("#legal")
    page.wait_for_selector(".cells button.legal")


SHOTS = (
    Shot("home", "/"),
    Shot("watch", "/watch", _watch),
    Shot("game-proposer", "/game", _propose),
    Shot("game-verifier", "/game", _sit({"configuration": "TowerFlipIt", "proposer": "expert", "verifier": "person"})),
    Shot("play", "/play", _show_legal("ScatterFlipIt", SCATTER_TASK)),
    Shot("play-end", "/play", _play_to_the_end),
    Shot("beat", "/beat?seed=7", _play_ten),
    Shot("sentence", "/sentence", _read_a_sentence),
    Shot("annotate", "/annotate?statement_id=tower-dev-001", _write_a_program),
    Shot("explore", "/explore", _wait_for("#results li")),
    Shot("explore-statement", "/explore", None),
)


def record_agents(directory: Path) -> Path:
    """Creates the directory with recordings of the agents shipped with the package."""
    directory.mkdir()
    with chdir(directory), redirect_stdout(io.StringIO()):  # keeps paths shown on the pages short and relative
        for name in ("parse-and-plan", "imitation-tower"):
            Path(name).mkdir()
            Path(name, "agent.safetensors").write_bytes(
                (files("lilgym_mp.data") / f"agent-{name}.safetensors").read_bytes()
            )
            words = ["evaluate", name, "--name", name, "--alone", "--configuration", "TowerFlipIt"]
            command([*words, "--record", name, "--record-decisions", "--judge-decisions"])
    return directory


@contextmanager
def serving(directory: Path, runs: Path | None) -> Iterator[str]:
    """Runs a server with a new database; yields its URL."""
    app = create_app(ServeOptions(database=directory / "web.sqlite3", runs=runs))
    server = uvicorn.Server(uvicorn.Config(app, port=0, log_level="warning"))
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    while not server.started:
        time.sleep(0.05)
    port = server.servers[0].sockets[0].getsockname()[1]
    try:
        yield f"http://127.0.0.1:{port}"
    finally:
        server.should_exit = True
        thread.join(10)


def take(page: Page, url: str, shot: Shot, path: Path) -> None:
    page.goto(url + shot.path, wait_until="networkidle")
    if shot.name == "explore-statement":
        page.locator("#results a").first.click()
        page.wait_for_load_state("networkidle")
    if shot.prepare is not None:
        shot.prepare(page)
    page.wait_for_timeout(300)
    page.screenshot(path=path, animations="disabled")
    with Image.open(path) as image:
        image.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)


def film(page: Page, url: str, path: Path) -> None:
    """A played task as a GIF: items are chosen and put into the scene by mouse, then STOP."""
    page.goto(f"{url}/play", wait_until="networkidle")
    _begin(page, "ScatterScratch", FILM_TASK)
    frames: list[UInt8Array] = []

    def show() -> None:
        page.wait_for_timeout(250)
        picture = Image.open(io.BytesIO(page.screenshot(clip=FILM_CLIP, animations="disabled"))).convert("RGB")
        frames.append(np.asarray(picture))

    show()
    for column, row, *item in FILM_ITEMS:
        for name, value in zip(("shape", "size", "colour"), item, strict=True):
            page.click(f"[data-choice={name}] [data-value={value}]")
        cell = page.locator(f".cells [data-column='{column}'][data-row='{row}']")
        cell.hover()
        show()
        cell.click()
        page.wait_for_selector(".cells:not([aria-busy=true])")
        show()
    page.click("#stop")
    page.wait_for_selector("#end:not([hidden])")
    show()
    save_gif(path, frames)


def overflow(page: Page) -> int:
    """The page's width beyond that of its window, in pixels."""
    return int(page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth"))


def violations(page: Page, axe: Path) -> list[str]:
    """Accessibility violations found by axe-core."""
    page.evaluate(axe.read_text(encoding="utf-8"))
    found = page.evaluate(
        "axe.run({runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'wcag22aa', 'best-practice']})"
    )
    return [f"{each['id']}: {each['nodes'][0]['html'][:150]}" for each in found["violations"]]


def main() -> int:
    parser = argparse.ArgumentParser(description="Takes the screenshots of docs/web.md.")
    parser.add_argument("--out", type=Path, default=PICTURES)
    parser.add_argument("--all", action="store_true", help="in light and dark, 1280, 768 and 360 pixels wide")
    parser.add_argument(
        "--only",
        nargs="+",
        metavar="NAME",
        help="take only these: " + ", ".join([FILM, *(shot.name for shot in SHOTS)]),
    )
    parser.add_argument("--axe", type=Path, metavar="axe.min.js", help="also report accessibility violations")
    parser.add_argument("--runs", type=Path, help="a directory with recorded episodes")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    program = shutil.which("chromium") or shutil.which("google-chrome")
    if program is None:
        print("no Chromium on the PATH", file=sys.stderr)
        return 1
    too_wide = 0
    with tempfile.TemporaryDirectory() as name, sync_playwright() as web, ExitStack() as stack:
        runs = args.runs or record_agents(Path(name) / "runs")
        url = stack.enter_context(serving(Path(name), runs))
        browser = web.chromium.launch(executable_path=program, args=list(FLAGS), timeout=120_000)
        first = browser.new_context(viewport={"width": THEMES[0].width, "height": THEMES[0].height}).new_page()
        if not args.only or FILM in args.only:
            film(first, url, args.out / f"{FILM}.gif")
        for theme in THEMES if args.all else THEMES[:1]:
            context = browser.new_context(
                viewport={"width": theme.width, "height": theme.height},
                color_scheme="dark" if theme.dark else "light",
                bypass_csp=args.axe is not None,
            )
            page = context.new_page()
            page.set_default_timeout(60_000)
            page.on("console", lambda entry: print(f"{entry.type}: {entry.text}") if entry.type == "error" else None)
            page.on("pageerror", lambda fault: print(f"page error: {fault}"))
            for shot in SHOTS:
                if args.only and shot.name not in args.only:
                    continue
                file = args.out / f"{shot.name}{theme.suffix}.png"
                take(page, url, shot, file)
                excess = overflow(page)
                too_wide += excess > 0
                for violation in violations(page, args.axe) if args.axe else ():
                    print(f"  {violation}")
                print(f"{file.name}: {file.stat().st_size:,} bytes" + (f", {excess} pixels too wide" if excess else ""))
            context.close()
        browser.close()
    return 1 if too_wide else 0


if __name__ == "__main__":
    sys.exit(main())
