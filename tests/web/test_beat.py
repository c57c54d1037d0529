"""/beat: the score of a person beside an agent."""

import pytest

from tests.web.web_app import assert_refused

pytest.importorskip("torch")


@pytest.mark.long
def test_opponent__is_any_agent_that_plays_the_tasks(browser):
    page = browser.get("/beat").text
    assert '<option value="agent:parse-and-plan" selected>' in page
    assert '<option value="agent:imitation-tower">' in page
    task = {"configuration": "TowerScratch", "split": "dev", "player": "", "task_id": "tower-dev-001"}
    begun = browser.post("/api/play/episodes", task).json()
    browser.post(f"/api/play/episodes/{begun['id']}/actions", {"action": "STOP", "steps": 0})
    place, asked = "/api/beat/round", {"episode": begun["id"]}
    score = browser.get(place, params={**asked, "agent": "agent:imitation-tower"}).json()
    assert ", imitation-tower 1 in 2." in score["summary"]
    assert score["verdict"] == "imitation-tower won."
    refused = browser.get(place, params={**asked, "agent": "agent:imitation-scatter"})
    assert_refused(refused, 422, "not TowerScratch; choose another")
    assert browser.get(place, params={**asked, "agent": "run:none"}).status_code == 404
