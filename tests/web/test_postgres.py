"""The web application on a temporary PostgreSQL server; skipped if PostgreSQL is not installed."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lilgym_mp.web.store.database import DatabaseError, open_database
from tests.web.test_annotate import API, BLUE, assigned, first_assignment, imported, nlvr_file, submit
from tests.web.web_app import Browser, server


def _programs() -> Path:
    """The directory with PostgreSQL's binaries."""
    found = shutil.which("initdb")
    places = [Path(found).parent] if found else sorted(Path("/usr/lib/postgresql").glob("*/bin"))
    if not places:
        pytest.skip("postgresql is not installed (apt-get install postgresql)")
    return places[-1]


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    """The URL of a database in a temporary cluster."""
    pytest.importorskip("psycopg", reason="needs psycopg: pip install 'psycopg[binary]'")
    programs = _programs()
    user: dict[str, Any] = {"user": "postgres", "cwd": "/"} if os.geteuid() == 0 else {}
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with tempfile.TemporaryDirectory(prefix="lilgym-pg-", ignore_cleanup_errors=True) as place:
        if user:
            shutil.chown(place, "postgres")
        data = f"{place}/data"

        def run(program: str, *words: str) -> None:
            subprocess.run([programs / program, *words], check=True, stdout=subprocess.DEVNULL, timeout=120, **user)

        run("initdb", "-D", data, "-U", "lilgym", "-A", "trust", "--no-sync")
        run("pg_ctl", "-D", data, "-o", f"-p {port} -h 127.0.0.1 -k {place}", "-l", f"{place}/log", "-w", "start")
        try:
            yield f"postgresql+psycopg://lilgym@127.0.0.1:{port}/postgres"
        finally:
            run("pg_ctl", "-D", data, "-m", "immediate", "stop")


def test_postgres__stores_play_and_annotation(url: str, tmp_path: Path):
    with server(tmp_path, database=url) as app:
        organiser = Browser(app).log_in("Olga", "organiser")
        assert imported(organiser, nlvr_file(2))["added"] == 2
        (ada,) = assigned(organiser, "Ada", statements=2)
        path = first_assignment(ada)
        assert ada.send("PUT", f"{path}/draft", {"program": BLUE, "version": 0}).json() == {"version": 1}
        assert submit(ada, path, BLUE).json()["verdict"] == "accepted"
        assert submit(ada, path, BLUE).json()["verdict"] == "accepted"
        assert len(organiser.get(f"{API}/reviews").json()[0]["submissions"]) == 1
        assert organiser.get(f"{API}/statistics").json()["kept"] == 1
        assert organiser.get(f"{API}/export").status_code == 200
        episode = ada.post("/api/play/episodes", {"configuration": "TowerScratch"}).json()
        response = ada.post(f"/api/play/episodes/{episode['id']}/actions", {"action": "ADD(LEFT, BLUE)", "steps": 0})
        assert response.status_code == 200
        assert ada.get("/api/play/best").status_code == 200
        cookies = dict(ada.client.cookies)
    with server(tmp_path, database=url) as app:
        again = Browser(app)
        again.client.cookies.update(cookies)
        assert again.get(path).json()["state"] == "done"
        assert again.get(f"/api/play/episodes/{episode['id']}").json() == response.json()


def test_postgres__an_unreachable_server_is_reported_without_the_password(url: str):
    assert url
    with pytest.raises(DatabaseError) as raised:
        open_database("postgresql+psycopg://lilgym:secret@127.0.0.1:1/nowhere")
    assert "secret" not in str(raised.value)
    assert "127.0.0.1:1" in str(raised.value)
