"""The pages in Chromium: keyboard-only use, 360-pixel width, accessibility, no console errors or external resources."""

import io
import shutil
import subprocess
import threading
import time
from contextlib import ExitStack, closing, contextmanager
from itertools import cycle
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from PIL import Image

from lilgym_mp.corpus import load_tasks, write_corpus
from lilgym_mp.evaluation import Settings
from lilgym_mp.scene.actions import describe
from lilgym_mp.solver import Solver
from tests.browser import watched_page
from tests.corpora import small_entries, write_thin_corpus
from tests.web.test_annotate import STATEMENT_ID, overfitted, right_program
from tests.web.web_app import server

uvicorn = pytest.importorskip("uvicorn")

PAGES = (
    "/",
    "/play",
    "/watch",
    "/game",
    "/annotate",
    "/sentence",
    "/beat",
    "/explore",
    "/explore/tower/dev/tower-dev-001",
    "/nowhere",
)


@contextmanager
def served(directory, **options):
    """Runs a server in a thread; yields its URL."""
    with server(directory, **options) as app, running(app) as port:
        yield f"http://127.0.0.1:{port}"


@contextmanager
def running(app, **options):
    """Runs an application in a thread; yields its port."""
    started = uvicorn.Server(uvicorn.Config(app, port=0, log_level="error", lifespan="off", **options))
    thread = threading.Thread(target=started.run, daemon=True)
    thread.start()
    while not started.started:
        time.sleep(0.02)
    yield started.servers[0].sockets[0].getsockname()[1]
    started.should_exit = True
    thread.join(20)


@pytest.fixture
def opened(chromium, tmp_path):
    """Opens a page on a server of its own, with options of the window and of the server."""
    with ExitStack() as stack:

        def opened(*size, dark=False, bypass_csp=False, **options):
            url = stack.enter_context(served(tmp_path, **options))
            return stack.enter_context(watched_page(chromium, *size, url=url, dark=dark, bypass_csp=bypass_csp))

        yield opened


@pytest.fixture
def page(opened):
    """A page on a server of its own, without an error to the end of the test."""
    watched = opened()
    yield watched.page
    _assert_clean(watched)


def _assert_clean(watched, *allowed):
    """All requests went to the server, and no errors occurred except those containing an allowed text."""
    assert {urlsplit(asked).netloc for asked in watched.requests} == {urlsplit(watched.page.url).netloc}
    assert [fault for fault in watched.faults if not any(each in fault for each in allowed)] == []


def test_play__by_keyboard_alone(page):
    page.goto("/play")
    page.select_option("[name=configuration]", "ScatterFlipIt")
    page.wait_for_selector(".board.fine .cells button")
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
    page.keyboard.press("t")
    page.wait_for_selector("#end-title:focus")
    page.keyboard.press("n")
    page.wait_for_selector("#tools:not([hidden])")
    page.wait_for_selector(".cells button:focus")
    assert not page.is_visible("#end")


SIZES = [(1280, 900), (360, 740)]


def _in_viewport(page, selector):
    box = page.locator(selector).bounding_box()
    return box["y"] >= 0 and box["y"] + box["height"] <= page.viewport_size["height"]


def _begin(page, address="/play?configuration=ScatterFlipIt&task=scatter-dev-025-a"):
    page.goto(address)
    page.wait_for_selector("#episode:not([aria-busy]) .cells button")


def _begin_game(page, setting, value):
    """Begins a game with one setting chosen, and waits for the person's turn."""
    page.goto("/game")
    page.select_option(setting, value)
    page.click("#setup [type=submit]")
    page.wait_for_selector("#turn:text-matches('your turn')")


def _left(page, ghost):
    """The left side of an outlined item in a scene of 380 pixels."""
    scene = page.locator("#board .scene").bounding_box()
    return (page.locator(ghost).bounding_box()["x"] - scene["x"]) * 380 / scene["width"]


@pytest.mark.parametrize("size", SIZES)
def test_play__an_illegal_action_is_explained_below_the_scene_and_the_end_is_in_view(opened, size):
    page = opened(*size).page
    _begin(page)
    cell = page.locator(".cells button[data-column='0'][data-row='1']")
    cell.scroll_into_view_if_needed()
    page.evaluate("board.choose('size', 'LARGE')")
    tops = "['#board', '#tools', '#stop'].map(name => document.querySelector(name).getBoundingClientRect().top)"
    before = page.evaluate(tops)
    cell.click()
    page.wait_for_selector("#messages .error:has-text('Not done: ')")
    assert page.evaluate(tops) == before
    assert _in_viewport(page, "#messages .error")
    page.click("#stop")
    page.wait_for_selector("#end-title:focus")
    assert page.inner_text("#end-title") == "Wrong STOP"
    assert _in_viewport(page, "#end-title")
    assert _in_viewport(page, "#next")


def test_play__shows_the_item_under_the_pointer(page):
    _begin(page)
    page.hover(".cells button[data-column='8'][data-row='2']")
    ghost = page.locator(".ghost.shape-circle.colour-yellow").bounding_box()
    cell = page.locator(".cells button[data-column='8'][data-row='2']").bounding_box()
    assert ghost["x"] == pytest.approx(cell["x"], abs=1)
    assert ghost["y"] == pytest.approx(cell["y"], abs=1)


def _annotate(page):
    page.goto(f"/annotate?appearance=tower&split=dev&statement_id={STATEMENT_ID}")
    page.wait_for_selector("#work:not([aria-busy])")
    page.wait_for_selector("#scenes img")


@pytest.mark.parametrize("size", SIZES)
def test_annotate__a_program_is_run_submitted_and_downloaded(opened, size):
    page = opened(*size).page
    _annotate(page)
    shown = page.locator("#scenes img").count()
    program = right_program()
    page.fill("#program", f"NOT({program})")
    page.click("#run")
    page.wait_for_selector("#messages .error:has-text('does not have the statement')")
    assert page.is_disabled("#submit")
    page.fill("#program", overfitted(shown))
    assert page.locator("#result li").count() == page.locator("#messages .notice").count() == 0
    page.click("#run")
    page.wait_for_selector("#submit:not([disabled])")
    assert _in_viewport(page, "#messages .success")
    page.click("#submit")  # without a name
    assert page.evaluate("document.activeElement.name") == "name"
    page.fill("[name=name]", "Ada")
    page.click("#submit")
    page.wait_for_selector("#messages .error:has-text('in every hidden scene')")
    page.fill("#program", program)
    page.click("#run")
    page.wait_for_selector("#submit:not([disabled])")
    posted = []
    page.on("request", lambda request: posted.append(request.url) if "/annotations?" in request.url else None)
    page.dblclick("#submit")
    page.wait_for_selector("#messages .success:has-text('hidden ones included')")
    assert len(posted) == 1
    assert _in_viewport(page, "#messages .success")
    assert page.inner_text("#progress").startswith("1 of ")
    with page.expect_download() as download:
        page.click("text=Download all annotations")
    assert len(Path(download.value.path()).read_text().splitlines()) == 2
    page.click("text=Next statement")
    page.wait_for_selector("#work:not([aria-busy])")
    assert page.input_value("#program") == ""


@contextmanager
def _late(page, path):
    """The first response from `path` comes after the block."""
    held = []
    page.route(path, lambda route: held.append(route), times=1)
    yield
    with page.expect_response(path):
        held[0].continue_()
    page.wait_for_timeout(100)  # for the page to read it


def test_annotate__a_late_answer_does_not_replace_the_statement_chosen_since(page):
    _annotate(page)
    late, chosen = [option.get_attribute("value") for option in page.locator("[name=statement] option").all()][1:3]
    with _late(page, f"**/api/annotate/statement?*statement_id={late}*"):
        for each in (late, chosen):
            page.select_option("[name=statement]", each)
        page.wait_for_url(f"**statement_id={chosen}*")
        shown = page.inner_text("#statement")
    assert page.inner_text("#statement") == shown
    assert chosen in page.url


def test_annotate__late_values_are_not_shown_beside_the_statement_chosen_since(page):
    _annotate(page)
    with _late(page, "**/api/annotate/run?*"):
        page.fill("#program", "exist(all_items)")
        page.click("#run")
        page.select_option("[name=statement]", index=1)
        page.wait_for_selector("#work:not([aria-busy])")
    assert page.inner_text("#result") == page.inner_text("#messages") == ""


def test_sentence__a_late_answer_does_not_replace_that_to_the_last_question(page):
    pytest.importorskip("torch")
    page.goto("/sentence")
    with _late(page, "**/api/sentence"):
        for colour in ("blue", "yellow"):
            page.fill("[name=sentence]", f"There is a {colour} block.")
            page.click("#ask .primary")
        page.wait_for_selector("#answer-title:has-text('yellow')")
    assert "yellow" in page.inner_text("#answer-title")


def test_watch__a_late_answer_does_not_replace_the_recording_chosen_since(opened, runs):
    page = opened(runs=runs).page
    page.goto("/watch")
    page.wait_for_selector("#viewer .strip img")
    chosen = page.input_value("#recording")
    late = page.get_attribute(f"#recording option:not([value='{chosen}'])", "value")
    shown = page.inner_text("#about-title")
    with _late(page, f"**/api/watch/recordings/{late}"):
        page.select_option("#recording", late)
        with page.expect_response(f"**/api/watch/recordings/{chosen}"):
            page.select_option("#recording", chosen)
    assert page.inner_text("#about-title") == shown
    assert page.input_value("#recording") == chosen


def test_play__a_late_solution_is_not_shown_beside_another_task(page):
    _begin(page)
    begun = page.evaluate("episode.id")
    with _late(page, "**/solution"):
        page.keyboard.press("e")
        page.click("#setup [type=submit]")
        page.wait_for_function("id => episode.id !== id", arg=begun)
    assert page.is_hidden("#expert")


def test_sentence__a_late_failure_is_not_shown_beside_the_answer_to_the_last_question(opened):
    pytest.importorskip("torch")
    page = opened().page
    page.goto("/sentence")
    held = []
    page.route("**/api/sentence", lambda route: held.append(route), times=1)
    for colour in ("blue", "yellow"):
        page.fill("[name=sentence]", f"There is a {colour} block.")
        page.click("#ask .primary")
    page.wait_for_selector("#answer-title:has-text('yellow')")
    held[0].abort()
    page.wait_for_timeout(100)
    assert page.inner_text("#messages") == ""


@pytest.mark.parametrize(
    ("path", "form", "shown", "requested"),
    [
        ("/game", "#setup", "#seat:not([hidden]):not([aria-busy])", "/api/game/games"),
        ("/watch", "#request", "#viewer .strip img", "/api/watch/recordings"),
    ],
)
def test_submit__a_second_click_is_ignored(page, path, form, shown, requested):
    pytest.importorskip("torch")
    posted = []
    page.on("request", lambda request: posted.append(request) if request.method == "POST" else None)
    page.goto(path)
    page.locator(f"{form} [type=submit]").evaluate("button => [button.click(), button.click()]")
    page.wait_for_selector(shown)
    assert [request.url.endswith(requested) for request in posted] == [True]


def test_annotate__the_text_and_the_name_survive_a_reload(page):
    _annotate(page)
    page.fill("[name=name]", "Ada")
    page.fill("#program", "exist(all_items")
    page.wait_for_selector("#program-fault:not(:empty)")
    page.reload()
    page.wait_for_selector("#scenes img")
    page.wait_for_selector("#work:not([aria-busy])")
    assert page.input_value("#program") == "exist(all_items"
    assert page.input_value("[name=name]") == "Ada"


def test_watch__the_heat_map_leaves_items_alone(opened, runs):
    page = opened(runs=runs).page
    page.goto("/watch")
    page.wait_for_selector("#viewer .strip img")
    page.wait_for_selector(".heat rect[opacity]", state="attached")
    items = page.evaluate("sides[0].view.scene.items")

    def pixels():
        image = Image.open(io.BytesIO(page.locator(".side .scene").first.screenshot()))
        return np.asarray(image.convert("RGB").resize((760, 200)), np.int64)

    heated = pixels()
    page.click("#heat")
    difference = np.abs(heated - pixels()).max(axis=2)
    assert items
    assert difference.max() > 10
    for item in items:
        x, y, side = (2 * item[name] for name in ("x", "y", "side"))
        middle = slice(y + side // 2 - 4, y + side // 2 + 5), slice(x + side // 2 - 4, x + side // 2 + 5)
        assert difference[middle].max() <= 2, item


def test_game__key_1_accepts_and_the_end_reveals_the_task(page):
    _begin_game(page, "#preset", "judge")
    assert "playing with an expert (edits towards its goal)" in page.inner_text("#seat-title")
    assert "Round 1 of" in page.inner_text("#task-line")
    assert page.locator("#answers button").first.inner_text().startswith("accept")
    for _ in range(20):
        page.wait_for_selector("#turn:text-matches('your turn|is over')")
        if page.is_visible("#end"):
            break
        page.press("#seat-title", "1")
        page.wait_for_selector("#board:not([aria-busy])")
    assert "The game is over: the goal was " in page.inner_text("#turn")
    assert "The proposer was " in page.inner_text("#end-line")
    page.click("#again")
    page.wait_for_selector("#turn:text-matches('your turn')")


def test_game__in_audit_key_1_says_that_the_claim_holds(page):
    _begin_game(page, "#preset", "catch")
    assert page.locator("#answers button").all_inner_texts() == ["holds 1", "does not hold 2"]
    page.mouse.click(5, 5)
    page.keyboard.press("1")
    page.wait_for_selector("#turn:text-matches('is over')")


def test_game__a_message_of_a_past_turn_is_explained(page):
    page.goto("/game")
    page.click("#more summary")
    page.select_option("[name=protocol]", "critique")
    page.select_option("[name=proposer]", "helpful")
    page.select_option("[name=verifier]", "person")
    page.click("#setup [type=submit]")
    page.click("#answers button:has-text('reject, message 3')")
    message = page.locator("#past li abbr").first
    message.wait_for()
    assert message.inner_text() == "message 3"
    assert "no fixed meaning" in message.get_attribute("title")


def test_keys__act_after_a_click_on_the_blank_page_but_not_on_another_control(page):
    _begin(page)
    page.mouse.click(5, 700)
    page.keyboard.press("a")
    assert page.get_attribute("[data-choice=kind] [data-value=REMOVE]", "aria-pressed") == "true"
    page.focus("text=Draw a task")
    page.keyboard.press("a")
    assert page.get_attribute("[data-choice=kind] [data-value=REMOVE]", "aria-pressed") == "true"


def test_play__remove_crosses_the_item_out_and_a_right_click_removes_it(page):
    _begin(page)
    item, name = page.evaluate("Object.entries(board.removable).map(([name, item]) => [item, name])[0]")
    column, row = name[len("REMOVE(") : -1].split(", ")
    cell = page.locator(f".cells button[data-column='{column}'][data-row='{row}']")
    page.click("[data-choice=kind] [data-value=REMOVE]")
    cell.hover()
    assert _left(page, ".ghost.removed") == pytest.approx(item["x"], abs=1)
    ghost, scene = page.locator(".ghost.removed").bounding_box(), page.locator("#board .scene").bounding_box()
    assert ghost["width"] * 380 / scene["width"] == pytest.approx(item["side"], abs=1)
    page.click("[data-choice=kind] [data-value=ADD]")
    cell.click(button="right")
    page.wait_for_selector(f"#history:has-text('{name}')")


def test_play__the_end_says_whether_the_solution_is_the_shortest_and_folds_the_program(page):
    _begin(page, "/play?configuration=TowerFlipIt&task=tower-dev-001-a")
    steps = page.evaluate("request('POST', `/api/play/episodes/${episode.id}/solution`)")["steps"]
    for detour in (True, False):
        actions = ["ADD(RIGHT, BLACK)", "REMOVE(RIGHT)"] * detour + [step["action"] for step in steps]
        for count, action in enumerate(actions, start=1):
            page.evaluate("action => act(action)", action)
            page.wait_for_function("count => episode.actions.length === count", arg=count)
        expected = f"; the expert needs {len(steps)}" if detour else ", the shortest possible"
        page.wait_for_selector(f"#end-title:has-text('Solved in {len(actions)} actions{expected}')")
        assert page.is_hidden("#parts li >> nth=0")
        page.click("#why summary")
        assert page.inner_text("#parts .value >> nth=0") == "false"
        if detour:
            page.keyboard.press("r")
            page.wait_for_selector("#tools:not([hidden])")


def test_home__is_a_playable_tower_task(page):
    _begin(page, "/")
    assert page.inner_text("#target") in ("true", "false")
    page.keyboard.press("t")
    page.wait_for_selector("#end-title:has-text('Wrong STOP')")
    assert page.locator("main a[href='./play']").count() == 1


def test_play__on_a_phone_the_scene_and_stop_are_in_view_and_no_key_is_shown(chromium, tmp_path):
    phone = {"viewport": {"width": 360, "height": 740}, "has_touch": True, "is_mobile": True}
    with served(tmp_path) as url, closing(chromium.new_context(base_url=url, **phone)) as context:
        page = context.new_page()
        _begin(page)
        assert page.locator("#board").bounding_box()["y"] < 300
        assert _in_viewport(page, "#stop")
        assert page.locator("kbd:visible").count() == 0


def test_game__the_verifier_sees_the_proposed_item(page):
    page.goto("/game")
    page.select_option("[name=configuration]", "ScatterFlipIt")
    page.select_option("#preset", "judge")
    for _ in range(12):
        page.evaluate("begin()")
        page.hover("#board .picture", force=True)
        page.hover("#seat-title")
        seat = page.evaluate("seat")
        kind, item = seat["proposal"].partition("(")[0], seat["proposed_item"]
        if kind == "STOP":
            continue
        ghost = f".ghost.proposed{'.removed' if kind == 'REMOVE' else ':not(.removed)'}"
        assert _left(page, ghost) == pytest.approx(item["x"], abs=1)
        is_there = item["description"] in [each["description"] for each in seat["scene"]["items"]]
        assert is_there is (kind == "REMOVE")


def test_sentence__readings_and_unknown_words_are_shown_and_the_plan_is_played(page):
    pytest.importorskip("torch")
    page.goto("/sentence")
    page.fill("[name=sentence]", "There is a blue block, zyxwv.")
    page.click("#ask .primary")
    page.wait_for_selector("#answer-title:has-text('will be true with a probability of')")
    assert "'zyxwv'" in page.inner_text("#notes")
    readings = page.locator("#readings li").all_inner_texts()
    assert any("✓" in reading and "%" in reading for reading in readings)
    page.wait_for_selector("#plan .step:has-text(': STOP')")  # without a click
    assert "blue" in page.get_attribute("#plan img", "alt")
    page.click("#plan .back")
    assert "STOP" not in page.inner_text("#plan .step")


def test_beat__ten_tasks_are_scored_beside_an_agent_and_give_a_picture(page):
    pytest.importorskip("torch")
    dynamics = Settings("TowerFlipIt").dynamics()
    solver, tasks = Solver(dynamics), load_tasks("builtin", "tower", "flipit", "dev")
    page.goto("/beat?seed=7")
    page.wait_for_selector("#progress:has-text('Task 1 of 10')")
    for number in range(1, 11):
        page.wait_for_selector("#tools:not([hidden])")
        solution = solver.solve(tasks.by_id(page.evaluate("episode.task_id"))).actions
        for action in solution if number > 1 else ["STOP"]:
            page.evaluate("action => act(action)", action if number == 1 else describe(action))
        line = page.locator(f"#rows tr:nth-child({number})")
        line.wait_for()
        you, agent, shortest = line.locator(".number").all_inner_texts()
        assert (you, shortest) == ("–" if number == 1 else str(len(solution)), str(len(solution)))
        assert agent == "–" or int(agent) >= int(shortest)
        if number == 2:
            page.reload()
            page.wait_for_selector("#rows tr:nth-child(2)")
        if number < 10:
            page.locator("#next").evaluate("button => { button.click(); button.click(); }")
            page.wait_for_selector(f"#progress:has-text('Task {number + 1} of 10')")
    page.wait_for_selector("#share:not([hidden])")
    assert "You solved 9 of 10" in page.inner_text("#score")
    with page.expect_download() as download:
        page.click("#download")
    with Image.open(download.value.path()) as picture:
        assert (picture.format, picture.width) == ("PNG", 1000)


@pytest.mark.parametrize("dark", [False, True])
def test_pages__fit_360_pixels_and_load_no_external_resources(opened, dark):
    watched = opened(360, 740, dark=dark)
    page = watched.page
    for path in PAGES:
        page.goto(path, wait_until="networkidle")
        if path in ("/play", "/game"):
            page.select_option("[name=configuration]", "ScatterFlipIt")
            page.click("#setup [type=submit]")
            page.wait_for_selector(".cells button")
        wider = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
        assert page.evaluate(wider) <= 0, path
        tops = "links => [...new Set(links.map(link => link.getBoundingClientRect().top))]"
        assert len(page.locator(".top nav a").evaluate_all(tops)) == 1, "the navigation takes one line"
    _assert_clean(watched, "404", "icon.svg")  # navigation may cancel the request for the icon


RULES = "{runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'wcag22aa', 'best-practice']}"


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("width", [360, 1280])
def test_pages__pass_axe(opened, runs, dark, width):
    watched = opened(width, runs=runs, dark=dark, bypass_csp=True)
    page = watched.page
    found = []
    for path in PAGES:
        page.goto(path, wait_until="networkidle")
        if path in ("/play", "/game"):
            page.click("#setup [type=submit]")
            page.wait_for_selector(".cells button")
        if path == "/sentence":
            page.click("#ask .primary")
            page.wait_for_selector("#plan .step:has-text(': STOP')")
        if path == "/watch":
            page.locator("#episodes button").first.click()
            page.wait_for_selector("#viewer .strip img")
        found += _barriers(watched, path)
    assert found == []


def _barriers(watched, where):
    """Accessibility violations that axe-core finds in the current state of a page."""
    return [f"{where}: {rule}: {nodes[0][:150]}" for rule, nodes in watched.violations(RULES)]


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("width", [360, 1280])
def test_pages__pass_axe_during_and_after_interaction(opened, dark, width):
    """The program editor empty, with an error, and with an agreeing program; the end of an episode and of a game."""
    watched = opened(width, dark=dark, bypass_csp=True)
    page, found = watched.page, list[str]()
    _annotate(page)
    found += _barriers(watched, "editor")
    page.fill("#program", "exist(")
    page.wait_for_selector("#program-fault:not(:empty)")
    found += _barriers(watched, "editor with an error")
    page.fill("#program", right_program())
    page.click("#run")
    page.wait_for_selector("#submit:not([disabled])")
    found += _barriers(watched, "editor with an agreeing program")
    page.goto("/play")
    page.click("#setup [type=submit]")
    page.wait_for_selector(".cells button")
    page.click("#stop")
    page.click("#why summary")
    page.wait_for_selector("#parts li")
    found += _barriers(watched, "end of an episode")
    _begin_game(page, "[name=configuration]", "TowerScratch")
    page.click("#legal")
    _play_out(page)
    found += _barriers(watched, "end of a game")
    assert found == []


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A directory with recordings of two policies on the same tasks."""
    from tests.web.test_watch import record

    place = tmp_path_factory.mktemp("runs")
    record(place / "tower", "random-legal")
    record(place / "tower", "expert")
    return place


def test_watch__steps_through_two_recordings_by_keyboard(opened, runs):
    watched = opened(runs=runs)
    page = watched.page
    page.goto("/watch")
    page.wait_for_selector("#episodes button")
    page.select_option("#recording", label=page.inner_text("#recording option:text-matches('^expert')"))
    page.wait_for_selector("#about-title:has-text('expert')")
    page.fill("[name=text]", "black")
    page.wait_for_selector("#episodes:not(:has(button:not(:has-text('black'))))")
    assert page.locator("#episodes button").count()
    page.fill("[name=text]", "")
    page.select_option("[name=outcome]", "wrong_stop")
    page.wait_for_selector("#total:has-text('No episode matches')")
    page.wait_for_selector("#viewer", state="hidden")
    page.select_option("[name=outcome]", "success")
    page.wait_for_selector("#episodes button")
    page.press("#viewer", "Space")
    page.wait_for_selector("#play[aria-label=Pause]")
    page.press("#viewer", "Space")
    page.wait_for_selector("#play[aria-label=Play]")
    page.select_option("#beside", index=1)
    page.locator("#episodes button").nth(3).click()
    page.wait_for_selector("#sides.two .side:nth-child(2) .strip img")
    sides = page.locator(".side")
    assert sides.nth(0).locator(".statement").inner_text() == sides.nth(1).locator(".statement").inner_text()
    assert sides.nth(0).locator("h3").all_inner_texts()[:2] == ["Type of action", "Likeliest actions"]
    assert "✓" in sides.nth(0).locator(".bars").nth(1).inner_text()
    assert sides.nth(0).locator(".facts:has-text('Optimal according to the expert') >> text=yes").count() == 1
    assert page.locator(".side:nth-child(2) .heat g rect").count() > 0
    page.keyboard.press("h")
    assert page.locator(".heat g rect").count() == 0
    page.keyboard.press("ArrowRight")
    page.wait_for_selector("#step-line:has-text('Step 2')")
    assert sides.nth(0).locator("[aria-current=step]").inner_text().startswith(("2.", "End"))
    page.keyboard.press("End")
    page.wait_for_selector("#step-line:has-text('End')")
    page.keyboard.press("j")
    page.wait_for_selector("#step-line:has-text('Step 1 ')")
    page.reload()
    page.wait_for_selector("#sides.two .side:nth-child(2) .strip img")
    _assert_clean(watched, "/picture")  # a reload may cancel requests


def test_watch__without_recordings_lets_a_shipped_agent_play(page):
    pytest.importorskip("torch")
    page.goto("/watch")
    page.wait_for_selector("#nothing:has-text('--record-decisions')")
    page.click("#request [type=submit]")
    page.wait_for_selector("#about-title:has-text('parse-and-plan, TowerFlipIt')")
    page.wait_for_selector("#viewer .strip img")
    assert page.is_hidden("#nothing")
    assert page.locator("#episodes button").count() == 12
    facts = page.inner_text(".side > div .facts")
    assert "when its plan has no action left" in facts
    assert "Satisfied readings" in facts
    page.press("#viewer", "End")
    page.press("#viewer", "ArrowLeft")  # the step at which it stops
    page.wait_for_selector(".side [role=status]:has-text('STOP')")
    assert "✓" in page.inner_text(".side .bars >> nth=2")


def test_watch__offers_each_agent_where_it_can_play(page):
    pytest.importorskip("torch")
    page.goto("/watch")
    offered = page.locator("#request option").all_inner_texts()
    own = {text.partition(": ")[2] for text in offered if text.startswith("ppo-tower ")}
    assert own == {"TowerScratch", "TowerFlipIt"}
    assert page.input_value("[name=play]") == "agent:parse-and-plan TowerFlipIt"


def test_menus__with_a_corpus_of_another_appearance_say_what_cannot_be_played(opened, tmp_path):
    """A corpus of Scatter alone: Tower is shown as missing, and no agent of Tower is offered."""
    pytest.importorskip("torch")
    path = write_thin_corpus(tmp_path / "scatter.jsonl", 40)
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(line for line in lines if '"tower"' not in line))
    page = opened(corpus=str(path)).page
    for address in ("/annotate", "/explore"):
        page.goto(address)
        assert page.inner_text("[name=appearance] option:disabled") == "tower: not in this corpus"
    page.goto("/play")
    page.wait_for_selector("#statement:not(:empty)")
    configurations = page.eval_on_selector_all("[name=configuration] option", "all => all.map(one => one.text)")
    assert configurations == ["ScatterScratch", "ScatterFlipIt"]
    page.goto("/watch")
    disabled = page.eval_on_selector_all("#request optgroup:disabled", "all => all.map(each => each.innerText)")
    assert all("plays no tasks of this corpus" in text for text in disabled)
    assert len(disabled) == 3  # imitation-tower, ppo-tower, reward-model-tower


def _play_out(page):
    """Plays a Tower game to its end: alternates ADD and REMOVE, then STOP, as proposer; cycles answers as verifier."""
    kinds = cycle(("ADD", "REMOVE"))
    for turn in range(60):
        page.wait_for_selector("#turn:text-matches('your turn|is over')")
        if "is over" in page.inner_text("#turn"):
            return
        if page.is_hidden("#proposing"):
            answers = page.locator("#answers button")
            answers.nth(turn % answers.count()).click()
        elif turn % 3 == 2 and page.is_enabled("#stop"):
            page.click("#stop")
        else:
            page.click(f"[data-choice=kind] [data-value={next(kinds)}]")
            page.locator(".cells button.legal:not(:disabled)").first.click()
        page.wait_for_selector("#board:not([aria-busy])")
    raise AssertionError("the game did not end")


def test_beat__the_shared_address_begins_the_same_tasks_again(chromium, page):
    with watched_page(chromium) as other:
        _begin(page, "/beat?seed=7")
        page.wait_for_selector("#progress:has-text('Task 1 of 10')")
        page.click("#stop")
        page.wait_for_selector("#rows tr")
        _begin(other.page, page.url)
        assert other.page.evaluate("tasks") == page.evaluate("tasks")
        assert other.page.evaluate("episode.id") != page.evaluate("episode.id")
        assert other.page.evaluate("episode.over") is False
        page.reload()
        page.wait_for_selector("#rows tr")


def test_explore__the_link_to_recordings_opens_one_with_the_statement(opened, tmp_path):
    from tests.web.test_watch import record

    record(tmp_path / "runs" / "a", "random-legal", "ScatterFlipIt", decisions="")
    record(tmp_path / "runs" / "b", "random-legal", decisions="")
    page = opened(runs=tmp_path / "runs").page
    page.goto("/explore/tower/dev/tower-dev-001")
    title = page.inner_text("h1")
    page.click("text=Watch recorded episodes with this statement")
    page.wait_for_selector("#viewer .strip img")
    assert page.inner_text(".side .statement") == title
    page.goto("/watch?text=zyxwv")
    page.wait_for_selector("#messages:has-text('No recording has an episode with “zyxwv”.')")


def test_play__keys_act_beside_the_experts_solution_and_arrows_enter_the_board(page):
    _begin(page)
    page.keyboard.press("ArrowRight")
    page.wait_for_selector(".cells button:focus")
    page.keyboard.press("e")
    page.wait_for_selector("#expert-scene .forth:focus")
    page.keyboard.press("a")
    assert page.get_attribute("[data-choice=kind] [data-value=REMOVE]", "aria-pressed") == "true"
    page.keyboard.press("t")
    page.wait_for_selector("#end-title:focus")


def test_play__an_action_chosen_while_the_last_one_is_sent_comes_after_it(page):
    _begin(page, "/play?configuration=TowerScratch")
    page.evaluate("document.querySelectorAll('.cells button').forEach((cell) => cell.click())")
    page.wait_for_selector("#history:has-text('ADD(LEFT, YELLOW), ADD(MIDDLE, YELLOW), ADD(RIGHT, YELLOW)')")


def test_play__a_double_click_acts_once(page):
    _begin(page, "/play?configuration=TowerScratch")
    page.dblclick(".cells button[data-column='1']")
    page.wait_for_selector("#history:has-text('So far: ADD(MIDDLE, YELLOW)')")
    page.evaluate("(act('ADD(LEFT, BLUE)'), act('ADD(LEFT, BLUE)'))")
    page.wait_for_selector("#history:has-text('ADD(LEFT, BLUE)')")
    page.wait_for_selector("#board:not([aria-busy])")
    assert page.evaluate("episode.actions.length") == 2
    assert page.inner_text("#messages") == ""


@pytest.mark.parametrize(
    ("address", "said"),
    {
        "/play?configuration=towerflipit": "there is no configuration “towerflipit”; choose from",
        "/play?split=exam": "there is no split “exam”; choose from",
        "/play?task=nothing": "'nothing'",
        "/play#stale": "there is no such episode",
        "/#stale": "there is no such episode",
        "/beat?configuration=tower": "there is no configuration “tower”",
    }.items(),
)
def test_play__an_address_that_names_nothing_is_reported_beside_another_task(opened, address, said):
    watched = opened()
    page = watched.page
    page.goto(address)
    page.wait_for_selector("#messages .error:has-text('This is another task.')")
    assert said in page.inner_text("#messages")
    assert page.locator("#episode:not([aria-busy]) .cells button:not(:disabled)").count() > 0
    _assert_clean(watched, "status of 4")


def test_play__no_ghost_is_drawn_on_a_full_tower(page):
    _begin(page, "/play?configuration=TowerScratch")
    for count in range(1, 5):
        page.evaluate("act('ADD(LEFT, BLUE)')")
        page.wait_for_function("count => episode.actions.length === count", arg=count)
    page.hover(".cells button[data-column='1']")
    assert page.locator(".ghost").count() == 1
    page.hover(".cells button[data-column='0']")
    assert page.locator(".ghost").count() == 0


@pytest.mark.parametrize("shape", ["triangle", "circle", "square"])
def test_game__a_proposed_item_of_any_shape_is_outlined(page, shape):
    _begin_game(page, "#preset", "judge")
    page.evaluate(
        "shape => { drawGhost(board.proposed, { x: 180, y: 30, side: 30, shape, colour: 'blue' }, false);"
        " board.proposed.classList.add('proposed'); }",
        shape,
    )
    picture = Image.open(io.BytesIO(page.locator("#board .scene").screenshot())).convert("RGB")
    pixels = np.asarray(picture, np.int64)
    assert (np.abs(pixels - (0xD6, 0x00, 0x6C)).max(axis=2) < 70).sum() > 100


def test_play__in_forced_colours_the_tools_of_a_phone_have_icons(page):
    page.set_viewport_size({"width": 360, "height": 740})
    page.emulate_media(forced_colors="active")
    _begin(page)
    for selector in ("[data-value=TRIANGLE]", "[data-value=BLUE]", "[data-value=LARGE]"):
        shown = Image.open(io.BytesIO(page.locator(f".tools {selector} .icon").screenshot())).convert("RGB")
        around = Image.open(io.BytesIO(page.locator(f".tools {selector}").screenshot())).convert("RGB")
        middle = shown.getpixel((shown.width // 2, shown.height // 2))
        assert middle != around.getpixel((5, around.height // 2)), selector


def test_annotate__a_completion_writes_a_call_only_where_a_value_is_expected(page):
    _annotate(page)
    for typed, expected in (
        ("exist(filter_obj(all_items, is_bl", "exist(filter_obj(all_items, is_blue"),
        (
            "exist(filter_obj(union(all_items, all_items), is_bl",
            "exist(filter_obj(union(all_items, all_items), is_blue",
        ),
        ("exist(filter_obj(all_items, lambda x: is_bl", "exist(filter_obj(all_items, lambda x: is_blue("),
        ("exi", "exist("),
    ):
        page.fill("#program", "")
        page.locator("#program").press_sequentially(typed)
        page.wait_for_selector("#completions li")
        page.keyboard.press("Tab")
        assert page.input_value("#program") == expected


def _proxied(apps):
    """A reverse proxy of several servers, by the prefix of their paths, which changes the Host header."""

    async def proxy(scope, receive, send):
        prefix = "/" + scope["path"].split("/")[1]
        headers = [(name, value) for name, value in scope["headers"] if name != b"host"]
        path = scope["path"].removeprefix(prefix)
        changed = {
            "path": path,
            "raw_path": path.encode(),
            "scheme": "http",
            "headers": [*headers, (b"host", b"inside")],
        }
        await apps[prefix]({**scope, **changed}, receive, send)

    return proxy


def test_proxy__with_tls_prefixes_and_another_host_name_serves_two_servers(chromium, tmp_path):
    key, certificate = tmp_path / "key.pem", tmp_path / "certificate.pem"
    command = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-subj", "/CN=localhost", "-days", "2"]
    if shutil.which("openssl") is None:
        pytest.skip("openssl is not installed")
    subprocess.run([*command, "-keyout", key, "-out", certificate], check=True, capture_output=True)
    options = {"hosts": None, "host_names": ("localhost",)}
    (tmp_path / "one").mkdir()
    (tmp_path / "two").mkdir()
    with (
        server(tmp_path / "one", token="first-token", **options) as one,
        server(tmp_path / "two", token="second-token", **options) as two,
    ):
        proxy = _proxied({"/one": one, "/two": two})
        tls = {"ssl_keyfile": str(key), "ssl_certfile": str(certificate)}
        with running(proxy, **tls) as port:
            context = chromium.new_context(base_url=f"https://localhost:{port}", ignore_https_errors=True)
            page = context.new_page()
            page.goto("/two/?token=second-token")
            _begin(page, "/one/play?token=first-token")
            page.click("#stop")
            page.wait_for_selector("#end-title:has-text('Wrong STOP')")
            for title in ("Watch", "Game", "Annotate", "Explore"):
                page.click(f".top nav a:text-is('{title}')")
                assert page.inner_text("h1") == {"Game": "Proposer and verifier"}.get(title, title)
            page.click("#results a")
            page.click("text=Play this task")
            page.wait_for_selector("#episode:not([aria-busy]) .cells button")
            assert page.url.startswith(f"https://localhost:{port}/one/play?")
            _begin(page, "/two/")
            context.close()


def test_sentence__an_example_is_read_and_nothing_understood_is_said(page):
    pytest.importorskip("torch")
    page.goto("/sentence")
    assert 6 <= page.locator("[name=example]").count() <= 8
    page.click("[name=example] >> nth=0")
    page.wait_for_selector("#answer-title:has-text('There is a blue block.')")
    assert page.inner_text("#readings-title") == "Readings; ✓ has the target value, true, in the last scene"
    page.fill("[name=sentence]", "zyxwv qqrrs")
    page.click("#ask .primary")
    page.wait_for_selector("#answer-title:has-text('Nothing was understood')")


def test_pages__beat_and_sentence_are_in_the_bar_and_a_hint_fills_the_line_of_play(page):
    _begin(page, "/play?configuration=TowerScratch")
    assert page.locator(".top nav a").all_inner_texts()[-2:] == ["Beat", "Sentence"]
    hint = "() => getComputedStyle(document.getElementById('messages'), '::before').content"
    assert "Point at the scene" in page.evaluate(hint)
    page.hover(".cells button[data-column='2']")
    assert "ADD(RIGHT, YELLOW)" in page.evaluate(hint)


def test_game__an_illegal_edit_is_refused_with_its_reason(opened):
    page = opened().page
    _begin_game(page, "[name=configuration]", "TowerScratch")
    assert "playing with an oracle (knows the truth)" in page.inner_text("#seat-title")
    page.click("[data-choice=kind] [data-value=REMOVE]")
    page.click(".cells button[data-column='0']")
    page.wait_for_selector("#messages:has-text('there is no block to remove')")


def test_beat__the_address_names_the_opponent(page):
    pytest.importorskip("torch")
    page.goto("/beat?seed=7&agent=agent:imitation-tower")
    page.wait_for_selector("#progress:has-text('Task 1 of 10')")
    assert page.input_value("#setup [name=agent]") == "agent:imitation-tower"
    assert "agent=agent%3Aimitation-tower" in page.url
    page.select_option("#setup [name=agent]", "agent:ppo-tower")
    page.wait_for_url("**agent=agent%3Appo-tower")


def test_statement_without_a_program__is_explored_and_annotated(opened, tmp_path):
    blue, pair, _ = small_entries()
    write_corpus(tmp_path / "open.jsonl", "open", "MIT", [{**blue, "program": None}, pair])
    watched = opened(corpus=str(tmp_path / "open.jsonl"))
    page = watched.page
    page.goto("/explore/tower/train/blue")
    page.wait_for_selector("article:has-text('The statement is true here.')")
    page.click("text=None yet, so it is not played: write one")
    page.wait_for_selector("#scenes figure:has-text('Here the statement is true.')")
    assert page.inner_text("#statement") == "Blue is here."
    _assert_clean(watched)
