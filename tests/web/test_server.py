"""Security headers, limits, origins, the token, error responses, databases, and the command `lilgym-mp serve`."""

import signal
import socket
import sqlite3
import subprocess
import sys
from contextlib import closing, nullcontext
from types import SimpleNamespace

import pytest

from lilgym_mp.cli import USAGE_ERROR
from lilgym_mp.contrib.web.database import Database, DatabaseError
from lilgym_mp.corpus.extras import install
from tests.command_line import error_of, lilgym
from tests.web.web_app import Browser, assert_refused, server

httpx = pytest.importorskip("httpx")


def test_pages__set_a_strict_policy_and_no_cookie(browser):
    response = browser.get("/")
    assert response.status_code == 200
    policy = response.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert response.headers["x-content-type-options"] == "nosniff"
    assert "set-cookie" not in response.headers


def test_errors__are_json_under_api_and_html_elsewhere(browser):
    response = browser.get("/api/nowhere")
    assert response.status_code == 404
    assert response.json()["status"] == 404
    response = browser.get("/nowhere")
    assert response.status_code == 404
    assert "<h1>Not Found</h1>" in response.text
    assert f"there is nothing at {response.url.path}" in response.text


CHECK, EMPTY = "/api/annotate/check", {"program": ""}


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 200),
        ({"Origin": "http://testserver", "Sec-Fetch-Site": "same-origin"}, 200),
        ({"Origin": "http://elsewhere.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Sec-Fetch-Site": "same-site"}, 403),
        ({"Sec-Fetch-Site": "cross-site"}, 403),
    ],
)
def test_csrf__a_request_from_a_page_of_another_server_is_refused(browser, headers, status):
    assert browser.post(CHECK, EMPTY, headers=headers).status_code == status


@pytest.mark.parametrize(
    "headers", [{"Origin": "https://lab.example"}, {"Origin": "https://x.example:8", "X-Forwarded-Host": "x.example:8"}]
)
def test_csrf__a_request_through_a_proxy_needs_its_name_or_x_forwarded_host(tmp_path, headers):
    with server(tmp_path, host_names=("lab.example",)) as app:
        assert Browser(app).post(CHECK, EMPTY, headers=headers).status_code == 200
        headers = {**headers, "Origin": "https://other.example"}
        refused = Browser(app).post(CHECK, EMPTY, headers=headers)
        assert_refused(refused, 403, "'other.example'")
        assert_refused(refused, 403, "name it with --host-name")
        assert Browser(app).get("/", headers={"Host": "lab.example"}).status_code == 200


def test_head__has_the_headers_of_get_and_no_body(browser):
    for path in ("/", "/explore", "/assets/style.css", "/api/play/episodes/none"):
        answers = [browser.request(method, path) for method in ("GET", "HEAD")]
        assert answers[1].status_code == answers[0].status_code
        assert answers[1].headers.get("content-length") == answers[0].headers.get("content-length")
        assert answers[1].content == b""


def test_pages__link_relatively_and_name_the_version_of_scripts(browser):
    assert '="/' not in browser.get("/").text
    assert 'src="../../../assets/common.js?v=' in browser.get("/explore/tower/dev/tower-dev-001").text
    answer = browser.get("/play/?split=dev", follow_redirects=False)
    assert (answer.status_code, answer.headers["location"]) == (307, "../play?split=dev")


def test_hosts__an_unknown_host_name_is_refused(browser):
    response = browser.get("/", headers={"Host": "elsewhere.example"})
    assert response.status_code == 400
    assert "elsewhere.example" in response.text


@pytest.mark.parametrize("has_content_length", [True, False])
def test_size__a_body_that_is_large_or_without_a_length_is_refused(browser, has_content_length):
    body = b"x" * 10_000_000
    content = body if has_content_length else iter([body[:100_000]] * 100)
    response = browser.post("/api/annotate/check", content=content)
    assert_refused(response, 413, "at most 262,144 bytes")
    assert response.headers["connection"] == "close"


def test_size__a_length_of_chunks_is_not_believed(browser):
    headers = {"Transfer-Encoding": "chunked", "Content-Length": "10"}
    assert browser.post(CHECK, EMPTY, headers=headers).status_code == 413


def test_database__a_lock_held_by_another_program_delays_writes_alone(tmp_path, monkeypatch):
    monkeypatch.setattr("lilgym_mp.contrib.web.database.LOCK_SECONDS", 0.2)
    with server(tmp_path) as app:
        browser = Browser(app)
        episode = browser.post("/api/play/episodes", {"configuration": "TowerScratch"}).json()["id"]
        holder = sqlite3.connect(tmp_path / "web.sqlite3", isolation_level=None)
        holder.execute("BEGIN IMMEDIATE")
        assert_refused(browser.post("/api/play/episodes", {"configuration": "TowerScratch"}), 503, "try again")
        assert browser.get(f"/api/play/episodes/{episode}").status_code == 200
        holder.execute("ROLLBACK")
        holder.close()
        assert browser.post("/api/play/episodes", {"configuration": "TowerScratch"}).status_code == 201


def test_database__that_is_moved_away_is_created_again(tmp_path):
    with server(tmp_path) as app:
        browser = Browser(app)
        first = browser.post("/api/play/episodes", {"configuration": "TowerScratch"}).json()["id"]
        for file in tmp_path.glob("web.sqlite3*"):
            file.rename(tmp_path / f"moved-{file.name}")
        assert browser.get(f"/api/play/episodes/{first}").status_code == 404
        assert browser.post("/api/play/episodes", {"configuration": "TowerScratch"}).status_code == 201


TOKEN = "a-token-for-everybody"


def test_token__is_needed_for_every_page_and_kept_in_a_cookie(tmp_path):
    with server(tmp_path, token=TOKEN, hosts=None) as app:
        browser = Browser(app)
        for path in ("/", "/openapi.json", "/?token=", "/?token=guess", f"/?token={TOKEN}x"):
            assert browser.get(path).status_code == 401, path
        assert browser.get("/assets/style.css").status_code == 200
        answer = browser.get(f"/explore?split=dev&token={TOKEN}", follow_redirects=False)
        assert (answer.status_code, answer.headers["location"]) == (303, "./explore?split=dev")
        cookie = next(line for line in answer.headers.get_list("set-cookie") if line.startswith("lilgym_token_"))
        assert "HttpOnly" in cookie
        assert "SameSite=lax" in cookie
        assert browser.get("/").status_code == 200
        assert browser.post(CHECK, EMPTY).status_code == 200
        answer = Browser(app).get(f"http://testserver//elsewhere.example?token={TOKEN}", follow_redirects=False)
        assert answer.headers["location"] == "./elsewhere.example", "the redirection stays on this server"


def test_token__is_needed_whatever_url_the_host_header_makes(tmp_path, monkeypatch):
    url = SimpleNamespace(path="/assets/")  # as Starlette before 1.0 reads it from "Host: localhost/assets/?"
    monkeypatch.setattr("starlette.requests.HTTPConnection.url", url)
    with server(tmp_path, token=TOKEN, hosts=None) as app:
        assert Browser(app).get("/api/watch/recordings").status_code == 401


def test_token__the_cookie_of_another_token_is_refused(tmp_path):
    with server(tmp_path, token=TOKEN, hosts=None) as app:
        browser = Browser(app)
        browser.get(f"/?token={TOKEN}")
        cookies = dict(browser.cookies)
    with server(tmp_path, token=f"{TOKEN}-2", hosts=None) as app:
        again = Browser(app)
        again.cookies.update(cookies)
        assert again.get("/").status_code == 401


def test_database__another_kind_of_file_is_refused(tmp_path):
    (tmp_path / "notes.txt").write_text("no database " * 100)
    with pytest.raises(DatabaseError, match="not a database"):
        Database(tmp_path / "notes.txt")


@pytest.mark.parametrize("change", ["CREATE TABLE recipes (id INTEGER)", "PRAGMA user_version=99"])
def test_database__of_another_program_or_version_is_refused(tmp_path, change):
    if change.startswith("PRAGMA"):
        Database(tmp_path / "web.sqlite3")
    with closing(sqlite3.connect(tmp_path / "web.sqlite3")) as other:
        other.execute(change)
    with pytest.raises(DatabaseError, match=r"another program or version; name another file"):
        Database(tmp_path / "web.sqlite3")


def _serve(*words, directory):
    command = [sys.executable, "-m", "lilgym_mp", "serve", *words]
    return subprocess.Popen(command, cwd=directory, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.long
def test_command__serves_and_stops_cleanly_on_interrupt(tmp_path):
    running = _serve("--port", "0", directory=tmp_path)
    assert running.stdout.readline().startswith("serving at http://127.0.0.1:")
    running.send_signal(signal.SIGINT)
    _, errors = running.communicate(timeout=30)
    assert running.returncode == 0
    assert errors == "stopped\n"


@pytest.mark.long
@pytest.mark.parametrize("chosen", [[], ["--token", TOKEN]])
def test_command__beyond_loopback_prints_a_link_that_opens_the_pages(tmp_path, chosen):
    running = _serve("--port", "0", "--host", "0.0.0.0", *chosen, directory=tmp_path)
    link = running.stdout.readline().split()[-1]
    try:
        assert "0.0.0.0" not in link
        assert not chosen or link.endswith(f"?token={TOKEN}")
        assert httpx.get(link.partition("?")[0], timeout=60).status_code == 401
        with httpx.Client(follow_redirects=True, timeout=60) as client:
            assert client.get(link).status_code == 200
            assert client.get(link.replace("/?", "/play?")).status_code == 200
    finally:
        running.send_signal(signal.SIGINT)
        running.communicate(timeout=30)


def hold_lock(place):
    Database(place)
    holder = sqlite3.connect(place, isolation_level=None)
    holder.execute("BEGIN EXCLUSIVE")
    return holder


@pytest.mark.parametrize(
    ("option", "value", "hold", "said"),
    [
        *(("--token", token, None, "must be 8 to 200 letters") for token in ("", "with a space", "a" * 201)),
        ("--runs", "{}/none", None, "there is no such directory"),
        ("--database", "{}/none/web.sqlite3", None, "none/web.sqlite3: unable to open database file"),
        ("--database", "{}/held", lambda place: hold_lock(place / "held"), "held: it is locked by another program"),
        ("--port", "{port}", lambda _: socket.create_server(("127.0.0.1", 0)), "already in use; choose another"),
        ("--port", "99999", None, "must be in 0 .. 65535, not 99999"),
    ],
)
def test_command__what_cannot_be_served_is_reported_in_one_line(
    tmp_path,
    capsys,
    monkeypatch,
    option,
    value,
    hold,
    said,
):
    monkeypatch.setattr("lilgym_mp.contrib.web.database.LOCK_SECONDS", 0.1)
    with closing(hold(tmp_path)) if hold else nullcontext() as held:
        port = held.getsockname()[1] if isinstance(held, socket.socket) else 0
        options = {"--port": 0, "--database": tmp_path / "web.sqlite3", option: value.format(tmp_path, port=port)}
        error = error_of(capsys, "serve", *(word for pair in options.items() for word in pair))
    assert said in error
    assert error.count("\n") == 1


def test_command__a_missing_extra_is_named(monkeypatch, capsys):
    for name in [name for name in sys.modules if name.startswith("lilgym_mp.contrib.web")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "fastapi", None)
    assert lilgym("serve --port 0") == USAGE_ERROR
    assert capsys.readouterr().err == f"lilgym-mp serve: needs fastapi: {install('web')}\n"
