"""Kills the server while people submit, save drafts, play and run programs; starts it again on what is left."""

from __future__ import annotations

import json
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from tests.stress.program_language import ATTACKS
from tests.web.web_app import Browser, server

httpx = pytest.importorskip("httpx", reason="tests of the web application need httpx")

STATEMENTS, SENDERS, ENOUGH = 160, 4, 60
BLOCK = {"x_loc": 40, "y_loc": 80, "type": "square", "color": "Black", "size": 20}
SCENE = {"label": "true", "structured_rep": [[BLOCK], [], []]}


def _started(directory: Path) -> tuple[subprocess.Popen[str], str, str]:
    """A server in a separate process, its URL, and the organiser's login path."""
    command = [sys.executable, "-m", "lilgym_mp", "serve", "--port", "0", "--database", "web.sqlite3"]
    running = subprocess.Popen(command, cwd=directory, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert running.stdout is not None
    lines = [running.stdout.readline().split() for _ in range(2)]
    return running, lines[0][-1], "/login" + lines[1][-1].rpartition("/login")[2]


def _prepare(directory: Path) -> list[str]:
    """Imports and assigns statements to SENDERS annotators; returns their login paths."""
    lines = [
        json.dumps(
            {"sentence": f"S {n}.", "identifier": f"{n}-0", "label": "true", "structured_rep": [[BLOCK], [], []]}
        )
        for n in range(STATEMENTS)
    ]
    with server(directory) as app:
        organiser = Browser(app).log_in("Olga", "organiser")
        assert organiser.post("/api/annotate/imports", content="\n".join(lines).encode()).json()["added"] == STATEMENTS
        paths = [organiser.post("/api/annotate/people", {"name": f"Ann {n}"}).json()["path"] for n in range(SENDERS)]
        people = [line["id"] for line in organiser.get("/api/annotate/people").json() if line["role"] == "annotator"]
        body = {"name": "all", "people": people, "statements": STATEMENTS, "annotators_each": 1}
        assert organiser.post("/api/annotate/batches", body).json()["assignments"] == STATEMENTS
    return paths


@contextmanager
def _client(url: str, path: str) -> Iterator[Any]:
    """A client that has opened the page; the block ends quietly when the connection breaks."""
    with suppress(httpx.HTTPError), httpx.Client(base_url=url, timeout=60) as client:
        client.get(path)
        client.headers["X-CSRF-Token"] = client.get("/api/session").json()["csrf_token"]
        yield client


def _submit(url: str, path: str, acknowledged: list[tuple[int, str]]) -> None:
    """Saves drafts and submits until the connection breaks; collects what was acknowledged."""
    with _client(url, path) as client:
        for line in client.get("/api/annotate/assignments").json():
            key = f"key-{line['id']}"
            where = f"/api/annotate/assignments/{line['id']}"
            if client.put(f"{where}/draft", json={"program": key, "version": 0}).status_code == 200:
                acknowledged.append((line["id"], "draft"))
            if client.post(f"{where}/skip", json={"key": key, "reason": "other", "comment": key}).status_code == 201:
                acknowledged.append((line["id"], key))


def _play(url: str, played: list[tuple[str, int]], cookies: dict[str, str]) -> None:
    """Plays until the connection breaks; collects each episode's acknowledged number of steps."""
    with _client(url, "/play") as client:
        cookies.update(client.cookies)
        while True:
            episode = client.post("/api/play/episodes", json={"configuration": "TowerScratch"}).json()
            played.append((episode["id"], 0))
            for steps, action in enumerate(("ADD(LEFT, BLUE)", "REMOVE(LEFT)", "ADD(RIGHT, BLACK)")):
                body = {"action": action, "steps": steps}
                client.post(f"/api/play/episodes/{episode['id']}/actions", json=body).raise_for_status()
                played[-1] = episode["id"], steps + 1


def _run_slow_programs(url: str, path: str) -> None:
    """Keeps a worker process evaluating."""
    with _client(url, path) as client:
        (line, *_) = client.get("/api/annotate/assignments").json()
        while True:
            client.post(f"/api/annotate/assignments/{line['id']}/run", json={"program": ATTACKS["text of filters"]})


def _children(pid: int) -> list[int]:
    lists = Path(f"/proc/{pid}/task").glob("*/children")  # of each thread
    return [int(child) for children in lists for child in children.read_text().split()]


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="finds the worker processes in /proc")
def test_kill__loses_nothing_acknowledged_and_leaves_no_process(tmp_path: Path):
    paths = _prepare(tmp_path)
    running, url, _ = _started(tmp_path)
    acknowledged: list[list[tuple[int, str]]] = [[] for _ in paths]
    played: list[tuple[str, int]] = []
    cookies: dict[str, str] = {}
    slow = threading.Thread(target=_run_slow_programs, args=(url, paths[0]))
    slow.start()
    end = time.monotonic() + 60
    while not _children(running.pid) and time.monotonic() < end:
        time.sleep(0.05)
    playing = threading.Thread(target=_play, args=(url, played, cookies))
    playing.start()
    while not played and time.monotonic() < end:
        time.sleep(0.005)
    threads = [
        threading.Thread(target=_submit, args=(url, path, kept)) for path, kept in zip(paths, acknowledged, strict=True)
    ]
    for thread in threads:
        thread.start()
    while sum(map(len, acknowledged)) < ENOUGH and time.monotonic() < end:
        time.sleep(0.005)
    workers = _children(running.pid)
    running.send_signal(signal.SIGKILL)
    running.wait()
    assert running.stdout is not None
    running.stdout.close()
    for thread in [*threads, playing, slow]:
        thread.join()
    assert workers
    assert ENOUGH <= sum(map(len, acknowledged)) < 2 * STATEMENTS, "the server must be killed during submissions"
    with closing(sqlite3.connect(tmp_path / "web.sqlite3")) as database:
        assert database.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
    with server(tmp_path) as app:
        for path, kept in zip(paths, acknowledged, strict=True):
            browser = Browser(app)
            browser.get(path, follow_redirects=False)
            found: list[dict[str, Any]] = browser.get("/api/annotate/history").json()
            stored = {(line["assignment"], line["comment"]) for line in found}
            assert {entry for entry in kept if entry[1] != "draft"} <= stored
            assert len(stored) == len(found) <= len(kept) + 1
            for number in (number for number, what in kept if what == "draft"):
                assert browser.get(f"/api/annotate/assignments/{number}").json()["draft"] == f"key-{number}"
        player = Browser(app)
        player.client.cookies.update(cookies)
        for episode, steps in played:
            assert player.get(f"/api/play/episodes/{episode}").json()["steps"] in (steps, steps + 1)
    end = time.monotonic() + 30
    while any(Path(f"/proc/{pid}").exists() for pid in workers) and time.monotonic() < end:
        time.sleep(0.1)
    assert not [pid for pid in workers if Path(f"/proc/{pid}").exists()]
