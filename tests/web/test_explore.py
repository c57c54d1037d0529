"""/explore: search, and the details of a statement."""

import re

import pytest

from lilgym_mp.corpus import load_tasks
from lilgym_mp.evaluation import Settings
from lilgym_mp.solver import Solver
from tests.web.web_app import Browser, server

API = "/api/explore"


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with server(tmp_path_factory.mktemp("server")) as app:
        yield Browser(app)


def found(browser, **filters):
    """The number of matching statements, and the ids of those on the page."""
    response = browser.get("/explore", params={"appearance": "tower", "split": "dev", **filters})
    assert response.status_code == 200, response.text
    total = re.search(r"Statements \d+ to \d+ of (\d+)", response.text)
    ids = re.findall(r'<a href="[./]*explore/tower/dev/([^"]+)">', response.text)
    return int(total[1]) if total else 0, ids


@pytest.fixture(scope="module")
def tasks():
    return load_tasks("builtin", "tower", "scratch", "dev")


@pytest.mark.long
def test_search__pages_through_every_statement_of_a_split(browser, tasks):
    total, ids = found(browser)
    assert total == len({task.statement for task in tasks})
    for first in range(len(ids), total, len(ids)):
        ids += found(browser, first=first)[1]
    assert len(set(ids)) == total
    assert found(browser, first=total) == (0, [])


@pytest.mark.long
def test_search__keeps_matching_statements_only(browser, tasks):
    total, ids = found(browser, text="BLUE")
    assert 0 < total < found(browser)[0]
    assert all("blue" in f"{task.statement}{task.program}".lower() for task in map(tasks.by_id, ids))
    assert found(browser, text=ids[0]) == (1, [ids[0]])


def test_statement__has_its_scenes_solutions_and_parts(browser):
    statement_id = found(browser, text="blue")[1][0]
    body = browser.get(f"{API}/statement", params={"statement_id": statement_id}).json()
    for scene in body["scenes"]:
        settings = Settings(scene["configuration"])
        task = load_tasks("builtin", "tower", settings.start, "dev").by_id(scene["task_id"])
        assert scene["steps"] == Solver(settings.dynamics()).solve(task).steps
        assert scene["truth"] == task.truth(task.start)
        assert scene["parts"][0]["value"] == str(scene["truth"])
    assert browser.get(f"/explore/tower/dev/{statement_id}").status_code == 200
    assert browser.get(f"/explore/tower/dev/{body['scenes'][-1]['task_id']}").status_code == 200


@pytest.mark.parametrize(
    ("path", "status"),
    {
        f"{API}/statement?statement_id=nowhere": 404,
        "/explore/tower/dev/nowhere": 404,
        "/explore/towers/dev/x": 422,
        "/explore?appearance=towers": 422,
        "/explore?first=-1": 422,
    }.items(),
)
def test_bad_requests__get_an_error_response(browser, path, status):
    response = browser.get(path)
    assert response.status_code == status
    assert "Traceback" not in response.text
