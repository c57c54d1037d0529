"""The server and its client: three sessions at once, the expert's reward, and OpenEnv's validation."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from lilgym_env import LilgymAction, LilgymEnv

from lilgym_mp.contrib.adapters.openenv import PlanEnvironment
from lilgym_mp.contrib.rlvr import expert_reply, rows

PACKAGE = Path(__file__).parent / "lilgym_env"


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "uvicorn", "server.app:app", "--port", str(port), "--log-level", "warning"]
    with subprocess.Popen(command, cwd=PACKAGE) as server:
        address = f"http://127.0.0.1:{port}"
        for _ in range(600):
            try:
                httpx.get(f"{address}/health", timeout=5)
                break
            except httpx.HTTPError:
                time.sleep(0.2)
        yield address
        server.terminate()


def test_three_sessions_at_once__each_play_their_own_task(url: str):
    tasks = [next(rows("plan", level=2, seed=seed)) for seed in (1, 2, 3)]
    plans = [expert_reply(row).splitlines() for row in tasks]
    sessions = [LilgymEnv(base_url=url).sync() for _ in tasks]
    for session, row, seed in zip(sessions, tasks, (1, 2, 3), strict=True):
        session.connect()
        assert row.task.statement in session.reset(seed=seed, level=2).observation.text
    results = [None] * 3
    while any(plans):
        for index, (session, plan) in enumerate(zip(sessions, plans, strict=True)):
            if plan:
                results[index] = session.step(LilgymAction(reply=f"So:\n{plan.pop(0)}"))
    assert [(result.reward, result.done, result.observation.outcome) for result in results] == [
        (1, True, "success")
    ] * 3
    assert [(result.observation.regret, result.observation.distance_after) for result in results] == [(0, 0)] * 3
    for session in sessions:
        session.close()


@pytest.mark.parametrize(("scene", "count"), [("list", 0), ("image", 1)])
def test_observation__has_pictures_if_they_are_shown(scene: str, count: int):
    environment = PlanEnvironment()
    observed = [environment.reset(seed=1, level=1, scene=scene), environment.step(LilgymAction(reply="hm"))]
    assert [len(each.images) for each in observed] == [count, count]
    assert all(image.startswith("data:image/png;base64,") for each in observed for image in each.images)
    assert environment.step(LilgymAction(reply="STOP")).images == []


@pytest.mark.parametrize("settings", [{"level": 99}, {"scene": "film"}, {"appearance": "mosaic"}, {"difficulty": 2}])
def test_reset__with_invalid_settings_is_refused(url: str, settings: dict[str, object]):
    response = httpx.post(f"{url}/reset", json={"seed": 1, **settings}, timeout=60)
    assert response.status_code == 422
    assert str(next(iter(settings.values()))) in response.text or "difficulty" in response.text


def test_openenv__validates_the_package():
    command = [str(Path(sys.executable).with_name("openenv")), "validate", str(PACKAGE), "--skip-build"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(r"Verdict: (?:PASS|WARN)", done.stdout), done.stdout
    assert "FAIL" not in done.stdout
