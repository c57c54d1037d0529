"""/explore: search, filters, and the details of a statement."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lilgym_mp import corpus
from lilgym_mp.contrib.report.phenomena import phenomena
from lilgym_mp.corpus import load_tasks
from lilgym_mp.evaluation import Settings
from lilgym_mp.evaluation.episodes import Header, RecordedEpisode, write_episodes
from lilgym_mp.scene.actions import STOP
from lilgym_mp.solver import Solver
from tests.web.web_app import Browser, server

API = "/api/explore"


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with server(tmp_path_factory.mktemp("server")) as app:
        yield Browser(app)


def found(browser: Browser, **filters: Any) -> dict[str, Any]:
    response = browser.get(f"{API}/statements", params={"appearance": "tower", "split": "dev", **filters})
    assert response.status_code == 200, response.text
    return response.json()


def test_search__finds_every_statement_of_a_split(browser: Browser):
    body = found(browser)
    assert body["total"] == len({task.statement for task in load_tasks("builtin", "tower", "scratch", "dev")})
    assert len(body["statements"]) == body["page"]
    assert found(browser, first=body["total"])["statements"] == []


def test_filters__keep_matching_statements_only(browser: Browser):
    programs = {task.statement: task.program for task in load_tasks("builtin", "tower", "scratch", "dev")}
    body = found(browser, phenomenon="negation")
    assert 0 < body["total"] < found(browser)["total"]
    assert all("negation" in phenomena(programs[line["statement"]]) for line in body["statements"])
    body = found(browser, word="exist", text="blue")
    assert body["total"]
    assert all("exist(" in programs[line["statement"]] for line in body["statements"])
    body = found(browser, least=6, most=6)
    assert body["total"]
    assert all(len(corpus.words(line["statement"])) == 6 for line in body["statements"])


def test_choices__count_statements(browser: Browser):
    body = browser.get(f"{API}/choices").json()
    for name, count in body["phenomena"].items():
        assert found(browser, phenomenon=name)["total"] == count
    word, count = next(iter(body["words"].items()))
    assert found(browser, word=word)["total"] == count


def test_statement__has_its_scenes_solutions_and_parts(browser: Browser):
    line = found(browser, text="blue")["statements"][0]
    body = browser.get(f"{API}/statement", params={"statement_id": line["id"]}).json()
    assert body["statement"] == line["statement"]
    for scene in body["scenes"]:
        settings = Settings(scene["configuration"])
        task = load_tasks("builtin", "tower", settings.start, "dev").by_id(scene["task_id"])
        solver = Solver(settings.dynamics())
        best = solver.optimal_actions(solver.dynamics.start(task))
        assert (scene["steps"], scene["optimal_first"]) == (best.steps, len(best.actions))
        assert scene["truth"] == task.truth(task.start)
        assert scene["parts"][0]["value"] == str(scene["truth"])
    assert browser.get(f"/explore/tower/dev/{line['id']}").status_code == 200
    assert browser.get(f"/explore/tower/dev/{body['scenes'][-1]['task_id']}").status_code == 200


def test_statement__lists_outcomes_of_recorded_runs(tmp_path: Path):
    runs = tmp_path / "runs"
    runs.mkdir()
    tasks = load_tasks("builtin", "tower", "scratch", "dev")
    task = tasks[0]
    counts = {"seed": 0, "training_seed": None, "passes": 1, "episodes": 1, "start_scenes": 1, "contexts": 1}
    names = {"package": "0", "split": "dev", "agent": "stops at once", "supervision": "none", "actions": "greedy"}
    flags = {"mask": False, "stop_forcing": False, "expert": False, "corpus": "builtin", "tasks_sha256": ""}
    header = Header(settings=Settings("TowerScratch"), **counts, **names, **flags)
    told_of = {"statement_seen": False, "form_seen": False, "tags": ()}
    came = {"outcome": "wrong_stop", "invalid_reason": None, "actions": (STOP,), "rewards": (-1.0,)}
    of_task = {"statement": task.statement, "program": task.program, "target": task.target, "start": task.start}
    episode = RecordedEpisode(task=task.id, **of_task, **told_of, **came)
    write_episodes(runs / "some.episodes.jsonl.gz", header, [episode])
    (runs / "broken.episodes.jsonl.gz").write_bytes(b"no recording")
    with server(tmp_path, runs=runs) as app:
        body = Browser(app).get(f"{API}/statement", params={"statement_id": task.id}).json()
    assert [run["task_id"] for run in body["runs"]] == [task.id]
    assert (body["runs"][0]["agent"], body["runs"][0]["outcome"]) == ("stops at once", "wrong_stop")
    assert "broken" in body["unreadable"][0]
    assert str(tmp_path) not in str(body)


@pytest.mark.parametrize(
    ("path", "status"),
    [
        (f"{API}/statement?statement_id=nowhere", 404),
        ("/explore/tower/dev/nowhere", 404),
        ("/explore/towers/dev/x", 422),
        (f"{API}/statements?phenomenon=magic", 422),
        (f"{API}/statements?least=-1", 422),
    ],
)
def test_bad_requests__get_an_error_response(browser: Browser, path: str, status: int):
    response = browser.get(path)
    assert response.status_code == status
    assert "Traceback" not in response.text


def test_page__loads(browser: Browser):
    assert browser.get("/explore").status_code == 200
