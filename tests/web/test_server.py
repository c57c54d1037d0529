"""Security headers, limits, CSRF, tokens, error responses, databases, and the command `lilgym-mp serve`."""

from __future__ import annotations

import asyncio
import signal
import socket
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from lilgym_mp.cli import USAGE_ERROR, main
from lilgym_mp.cli.serve import server_config
from lilgym_mp.extras import install
from lilgym_mp.web.app import ServeOptions
from lilgym_mp.web.store.database import DatabaseError, open_database
from tests.web.web_app import Browser, server

httpx = pytest.importorskip("httpx")
uvicorn = pytest.importorskip("uvicorn")

STARTED = "organiser's link"


@pytest.fixture
def app(tmp_path: Path) -> Iterator[Any]:
    with server(tmp_path) as made:
        yield made


def test_pages__set_a_strict_policy_and_an_http_only_cookie(app: Any):
    response = Browser(app).get("/")
    assert response.status_code == 200
    policy = response.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert response.headers["x-content-type-options"] == "nosniff"
    cookie = response.headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Lax" in cookie


def test_pages__load_no_external_resources(app: Any):
    browser = Browser(app)
    for entry in ("/", "/assets/style.css", "/assets/common.js", "/nowhere"):
        text = browser.get(entry).text.replace("http://www.w3.org/2000/svg", "")
        assert "http://" not in text
        assert "https://" not in text


def test_errors__are_json_under_api_and_html_elsewhere(app: Any):
    browser = Browser(app)
    response = browser.get("/api/nowhere")
    assert response.status_code == 404
    assert response.json()["status"] == 404
    response = browser.get("/nowhere")
    assert response.status_code == 404
    assert "<h1>Not Found</h1>" in response.text
    assert f"there is nothing at {response.url.path}" in response.text


def test_csrf__a_request_without_the_token_or_from_another_origin_is_refused(app: Any):
    browser = Browser(app)
    assert browser.client.post("/api/session/logout").status_code == 403
    assert browser.post("/api/session/logout").status_code == 204
    response = browser.post("/api/session/logout", headers={"Origin": "http://elsewhere.example"})
    assert response.status_code == 403
    assert Browser(app).client.post("/api/session/logout", headers={"X-CSRF-Token": "x"}).status_code == 403


def test_csrf__the_token_of_another_browser_is_refused(app: Any):
    other = Browser(app).get("/api/session").json()["csrf_token"]
    browser = Browser(app)
    browser.get("/")
    assert browser.client.post("/api/session/logout", headers={"X-CSRF-Token": other}).status_code == 403


def test_hosts__an_unknown_host_name_is_refused(app: Any):
    response = Browser(app).get("/", headers={"Host": "elsewhere.example"})
    assert response.status_code == 400
    assert "elsewhere.example" in response.text


@pytest.mark.parametrize("has_content_length", [True, False])
def test_size__a_large_body_is_refused_by_header_and_by_received_bytes(app: Any, has_content_length: bool):
    body = b"x" * 10_000_000
    content: Any = body if has_content_length else iter([body[:100_000]] * 100)
    response = Browser(app).post("/api/annotate/check", content=content)
    assert response.status_code == 413
    assert response.headers["connection"] == "close"
    assert "at most 262,144 bytes" in response.json()["message"]


@contextmanager
def _listening(app: Any, *proxies: str) -> Iterator[int]:
    """The port of a server started as the command does."""
    running = uvicorn.Server(server_config(app, list(proxies)))
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        thread = threading.Thread(target=running.run, kwargs={"sockets": [listening]})
        thread.start()
        try:
            yield listening.getsockname()[1]
        finally:
            running.should_exit = True
            thread.join(30)


def _sent(port: int, *lines: str) -> bytes:
    """What the server answers to an unfinished request until it closes the connection."""
    with socket.create_connection(("127.0.0.1", port), timeout=10) as connection:
        connection.sendall("\r\n".join(lines).encode())
        return b"".join(iter(lambda: connection.recv(1 << 16), b""))


def test_unfinished_requests__are_closed_after_a_limit(app: Any, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("lilgym_mp.web.security.BODY_LIMITS", (1_000, 0.3))
    monkeypatch.setattr("lilgym_mp.web.security.REQUEST_SECONDS", 0.3)
    browser = Browser(app)
    token = browser.get("/api/session").json()["csrf_token"]
    cookie = f"Cookie: lilgym_visitor={browser.client.cookies['lilgym_visitor']}"
    with _listening(app) as port:
        begun = ("POST /api/annotate/check HTTP/1.1", "Host: 127.0.0.1", cookie, f"X-CSRF-Token: {token}")
        body = _sent(port, *begun, "Content-Type: application/json", "Content-Length: 100", "", "{")
        assert b" 408 " in body.splitlines()[0]
        assert b"did not arrive in 0.3 s" in body
        assert _sent(port, *begun[:2]) == b""
        assert _sent(port, "GET /healthz HTTP/1.1", "Host: 127.0.0.1", "", "GET /hea").count(b"HTTP/1.1") == 1


@pytest.mark.parametrize(("proxies", "limited"), [((), True), (("127.0.0.1",), False)])
def test_rate__forwarded_addresses_count_only_from_a_trusted_proxy(
    tmp_path: Path, proxies: tuple[str, ...], limited: bool
):
    with server(tmp_path, requests_per_second=0.1) as app, _listening(app, *proxies) as port:
        url = f"http://127.0.0.1:{port}/healthz"
        answers = [httpx.get(url, headers={"X-Forwarded-For": f"10.0.0.{n}"}).status_code for n in range(20)]
    assert (429 in answers) is limited


def test_database__a_lock_held_by_another_program_delays_writes_alone(
    app: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("lilgym_mp.web.store.database.LOCK_SECONDS", 0.5)
    browser = Browser(app)
    begin = {"configuration": "TowerScratch"}
    episode = browser.post("/api/play/episodes", begin).json()["id"]

    async def send_all(count: int) -> list[int]:
        transport = httpx.ASGITransport(app, raise_app_exceptions=False)
        headers, cookies = {"X-CSRF-Token": browser.csrf_token}, dict(browser.client.cookies)
        async with httpx.AsyncClient(transport=transport, base_url="http://testserver", headers=headers) as client:
            client.cookies.update(cookies)
            sent = [client.post("/api/play/episodes", json=begin) for _ in range(count)]
            return [response.status_code for response in await asyncio.gather(*sent)]

    holder = sqlite3.connect(tmp_path / "web.sqlite3", isolation_level=None)
    holder.execute("BEGIN IMMEDIATE")
    start = time.monotonic()
    assert asyncio.run(send_all(60)) == [503] * 60
    assert time.monotonic() - start < 20  # one after the other they would wait for 30 seconds
    assert browser.get(f"/api/play/episodes/{episode}").status_code == 200
    holder.execute("ROLLBACK")
    holder.close()
    assert asyncio.run(send_all(2)) == [201] * 2


def test_rate__requests_beyond_the_limit_are_refused(tmp_path: Path):
    with server(tmp_path, requests_per_second=0.1) as app:
        browser = Browser(app)
        answers = [browser.get("/api/session").status_code for _ in range(14)]
    assert answers[0] == 200
    assert answers[-1] == 429


def test_tokens__are_needed_for_every_page_if_required(tmp_path: Path):
    with server(tmp_path, requires_tokens=True, hosts=None) as app:
        browser = Browser(app)
        assert browser.get("/").status_code == 401
        assert browser.get("/api/session").status_code == 401
        assert browser.get("/openapi.json").status_code == 401
        assert browser.get("/assets/style.css").status_code == 200
        assert browser.get("/login?token=guess").status_code == 401
        browser.log_in("Ada")
        assert browser.get("/").status_code == 200
        assert browser.get("/api/session").json()["person"] == "Ada"
        assert browser.post("/api/session/logout").status_code == 204
        assert browser.get("/").status_code == 401


def test_login__sets_a_new_cookie(app: Any):
    browser = Browser(app)
    browser.get("/")
    before = browser.client.cookies["lilgym_visitor"]
    browser.log_in("Ada")
    assert browser.client.cookies["lilgym_visitor"] != before


def test_login__survives_a_restart(tmp_path: Path):
    with server(tmp_path) as app:
        browser = Browser(app).log_in("Ada")
        cookies = dict(browser.client.cookies)
    with server(tmp_path) as app:
        again = Browser(app)
        again.client.cookies.update(cookies)
        assert again.get("/api/session").json()["person"] == "Ada"


def test_database__another_kind_of_file_is_refused(tmp_path: Path):
    (tmp_path / "notes.txt").write_text("no database " * 100)
    with pytest.raises(DatabaseError, match="not a database"):
        open_database(f"sqlite:///{tmp_path / 'notes.txt'}")


def test_database__of_another_program_is_refused(tmp_path: Path):
    with sqlite3.connect(tmp_path / "other.sqlite3") as other:
        other.execute("CREATE TABLE recipes (id INTEGER)")
    other.close()
    with pytest.raises(DatabaseError, match="another program"):
        open_database(f"sqlite:///{tmp_path / 'other.sqlite3'}")


def test_database__of_another_version_is_refused(tmp_path: Path):
    url = f"sqlite:///{tmp_path / 'web.sqlite3'}"
    open_database(url).close()
    with sqlite3.connect(tmp_path / "web.sqlite3") as newer:
        newer.execute("UPDATE alembic_version SET version_num = '9999'")
    newer.close()
    with pytest.raises(DatabaseError, match=r"another version .*pip install --upgrade"):
        open_database(url)


@pytest.mark.parametrize(
    ("url", "reason"),
    [("sqlite://", "in-memory"), ("mysql://host/name", "must be SQLite or PostgreSQL"), ("://", "not a database URL")],
)
def test_database__unsupported_urls_are_refused(url: str, reason: str):
    with pytest.raises(DatabaseError, match=reason):
        open_database(url)


def _serve(*words: str, directory: Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "lilgym_mp", "serve", *words]
    return subprocess.Popen(command, cwd=directory, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.long
def test_command__serves_and_stops_cleanly_on_interrupt(tmp_path: Path):
    running = _serve("--port", "0", directory=tmp_path)
    assert running.stdout is not None
    lines = [running.stdout.readline() for _ in range(3)]
    assert lines[0].startswith("serving at        http://127.0.0.1:")
    assert STARTED in lines[1]
    running.send_signal(signal.SIGINT)
    _, errors = running.communicate(timeout=30)
    assert running.returncode == 0
    assert errors == "stopped\n"


def test_command__a_taken_port_is_reported_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert main(["serve", "--port", str(port), "--database", str(tmp_path / "a")]) == USAGE_ERROR
    assert capsys.readouterr().err == (
        f"lilgym-mp serve: port {port} is in use; choose another with --port, or 0 for any free one\n"
    )


def test_command__an_unwritable_database_is_reported_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    place = tmp_path / "nowhere" / "web.sqlite3"
    assert main(["serve", "--port", "0", "--database", str(place)]) == USAGE_ERROR
    error = capsys.readouterr().err
    assert str(place) in error
    assert "unable to open" in error
    assert error.count("\n") == 1


def test_command__a_locked_database_is_reported_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("lilgym_mp.web.store.database.LOCK_SECONDS", 0.1)
    place = tmp_path / "web.sqlite3"
    open_database(f"sqlite:///{place}").close()
    holder = sqlite3.connect(place, isolation_level=None)
    holder.execute("BEGIN EXCLUSIVE")
    assert main(["serve", "--port", "0", "--database", str(place)]) == USAGE_ERROR
    holder.close()
    error = capsys.readouterr().err
    assert "locked by another program" in error
    assert error.count("\n") == 1


def test_command__a_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    for name in [name for name in sys.modules if name.startswith("lilgym_mp.web")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "fastapi", None)
    assert main(["serve", "--port", "0"]) == USAGE_ERROR
    assert capsys.readouterr().err == f"lilgym-mp serve: needs fastapi: {install('web')}\n"


def test_command__a_missing_runs_directory_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["serve", "--port", "0", "--runs", str(tmp_path / "none")]) == USAGE_ERROR
    assert "there is no such directory" in capsys.readouterr().err


def test_options__loopback_needs_no_tokens():
    assert not ServeOptions().requires_tokens
