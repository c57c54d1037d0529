"""/play: episodes follow the environment's rules and are explained at their end."""

import base64
import sqlite3
from contextlib import closing

import numpy as np
import pytest

from lilgym_mp.contrib.web.bodies import png
from lilgym_mp.corpus import load_tasks
from lilgym_mp.corpus.matching import well_spelt_ids
from lilgym_mp.evaluation import Settings
from lilgym_mp.scene.actions import describe, named
from tests.web.web_app import Browser, assert_refused, server

EPISODES = "/api/play/episodes"


def begin(browser, **chosen):
    response = browser.post(EPISODES, {"configuration": "ScatterFlipIt", **chosen})
    assert response.status_code == 201, response.text
    return response.json()


def act(browser, episode, action, steps=None):
    steps = episode["steps"] if steps is None else steps
    return browser.post(f"{EPISODES}/{episode['id']}/actions", {"action": action, "steps": steps})


@pytest.mark.parametrize("configuration", ["TowerScratch", "TowerFlipIt", "ScatterScratch", "ScatterFlipIt"])
def test_play__the_experts_solution_earns_the_environments_reward_and_legal_is_the_exact_mask(browser, configuration):
    episode = begin(browser, configuration=configuration)
    env = Settings(configuration).make("dev")
    env.reset(options={"task": episode["task_id"]})
    solution = browser.post(f"{EPISODES}/{episode['id']}/solution").json()
    appearance, reward, info = env.dynamics.appearance, 0.0, {}
    for step in solution["steps"]:
        assert episode["scene"]["picture"].endswith(base64.b64encode(png(env.scene)).decode())
        names = browser.get(f"{EPISODES}/{episode['id']}/legal").json()["actions"]
        assert names == [describe(appearance.decode(index)) for index in np.flatnonzero(env.action_masks())]
        response = act(browser, episode, step["action"])
        assert response.status_code == 200, response.text
        episode = response.json()
        _, given, _, _, info = env.step(appearance.encode(named(step["action"])))
        reward += float(given)
    assert episode["over"]
    assert episode["outcome"] == info["outcome"] == "success"
    assert episode["reward"] == pytest.approx(reward)


def test_illegal_action__is_refused_with_its_reason_and_changes_nothing(browser):
    episode = begin(browser)
    response = act(browser, episode, "ADD(5, 0, CIRCLE, BLUE, SMALL)")
    assert_refused(response, 409, "items cannot lie between the boxes")
    assert browser.get(f"{EPISODES}/{episode['id']}").json() == episode


@pytest.mark.parametrize("action", ["JUMP", "ADD(LEFT, BLUE)", "ADD(99, 0, CIRCLE, BLUE, SMALL)", "", "x" * 300])
def test_action__with_an_invalid_name_is_refused(browser, action):
    assert_refused(act(browser, begin(browser), action), 422)


def test_action__after_the_end_or_from_a_stale_page_is_refused(browser):
    episode = begin(browser)
    assert act(browser, episode, "STOP", steps=3).status_code == 409
    ended = act(browser, episode, "STOP").json()
    assert ended["outcome"] == "wrong_stop"
    assert_refused(act(browser, ended, "STOP"), 409, "over")


def test_end__explains_the_outcome_and_marks_items(browser):
    episode = begin(browser)
    assert episode["end"] is None
    assert "program" not in str(episode)
    body = act(browser, episode, "STOP").json()["end"]
    task = load_tasks("builtin", "scatter", "flipit", "dev").by_id(episode["task_id"])
    assert body["program"] == task.program
    assert body["truth"] == task.truth(task.start) != episode["target"]
    assert body["parts"][0]["value"] == str(body["truth"])
    items = {(item["box"], item["index"]) for item in episode["scene"]["items"]}
    assert all(tuple(item) in items for part in body["parts"] for item in part["items"])


def test_episode__survives_a_restart(tmp_path):
    with server(tmp_path) as app:
        browser = Browser(app)
        episode = begin(browser, configuration="TowerScratch")
        episode = act(browser, episode, "ADD(LEFT, BLUE)").json()
    with server(tmp_path) as app:
        assert Browser(app).get(f"{EPISODES}/{episode['id']}").json() == episode


def test_database__keeps_the_players_name_and_whether_the_solution_was_shown(tmp_path, browser):
    shown, unaided = begin(browser, player="7"), begin(browser, player="7")
    browser.post(f"{EPISODES}/{shown['id']}/solution")
    act(browser, unaided, "STOP")
    browser.post(f"{EPISODES}/{unaided['id']}/solution")
    with closing(sqlite3.connect(tmp_path / "web.sqlite3")) as database:
        rows = database.execute("SELECT id, player, shown_solution, outcome FROM played_episodes").fetchall()
    assert sorted(rows) == sorted([(shown["id"], "7", 1, None), (unaided["id"], "7", 0, "wrong_stop")])


def test_drawn_tasks__are_not_mistyped():
    tasks = load_tasks("builtin", "tower", "flipit", "dev")
    mistyped = {task.id for task in tasks if "mistyped" in task.tags}
    assert mistyped
    assert set(well_spelt_ids(tasks)) == set(tasks.ids) - mistyped


def test_task__with_an_unknown_id_or_configuration_is_refused(browser):
    response = browser.post(EPISODES, {"configuration": "TowerScratch", "task_id": "nowhere"})
    assert_refused(response, 404, "no task 'nowhere'")
    assert browser.post(EPISODES, {"configuration": "Towers"}).status_code == 422
