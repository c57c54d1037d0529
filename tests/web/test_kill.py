"""Kills the server during submissions: every acknowledged submission must be stored after a restart."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from tests.web.web_app import Browser, server

httpx = pytest.importorskip("httpx", reason="the browser suite's tests need httpx")

STATEMENTS, SENDERS, ENOUGH = 160, 4, 30
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


def _send(url: str, path: str, acknowledged: list[tuple[int, str]]) -> None:
    """Submits until the connection breaks; collects acknowledged submissions."""
    with httpx.Client(base_url=url, timeout=60) as client:
        client.get(path)
        client.headers["X-CSRF-Token"] = client.get("/api/session").json()["csrf_token"]
        for line in client.get("/api/annotate/assignments").json():
            key = f"key-{line['id']}"
            where = f"/api/annotate/assignments/{line['id']}/skip"
            try:
                response = client.post(where, json={"key": key, "reason": "other", "comment": key})
            except httpx.HTTPError:
                return
            if response.status_code == 201:
                acknowledged.append((line["id"], key))


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")
def test_kill__loses_no_acknowledged_submission(tmp_path: Path):
    paths = _prepare(tmp_path)
    running, url, _ = _started(tmp_path)
    acknowledged: list[list[tuple[int, str]]] = [[] for _ in paths]
    threads = [
        threading.Thread(target=_send, args=(url, path, kept)) for path, kept in zip(paths, acknowledged, strict=True)
    ]
    for thread in threads:
        thread.start()
    end = time.monotonic() + 60
    while sum(map(len, acknowledged)) < ENOUGH and time.monotonic() < end:
        time.sleep(0.005)
    running.send_signal(signal.SIGKILL)
    running.wait()
    assert running.stdout is not None
    running.stdout.close()
    for thread in threads:
        thread.join()
    sent = sum(map(len, acknowledged))
    assert ENOUGH <= sent < STATEMENTS, "the server must be killed while submissions are under way"
    with server(tmp_path) as app:
        for path, kept in zip(paths, acknowledged, strict=True):
            browser = Browser(app)
            browser.get(path, follow_redirects=False)
            found: list[dict[str, Any]] = browser.get("/api/annotate/history").json()
            stored = {(line["assignment"], line["comment"]) for line in found}
            assert set(kept) <= stored
            assert len(stored) == len(found) <= len(kept) + 1
