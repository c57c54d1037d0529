"""/game: every protocol is playable from either seat, and a seat's responses contain nothing outside of its view."""

import json

import numpy as np
import pytest

from lilgym_mp.contrib.web import live_games
from lilgym_mp.envs.proposer_verifier import GameSettings, Role
from tests.web.web_app import Browser, assert_refused

GAMES, SEATS = "/api/game/games", "/api/game/seats"
FORBIDDEN = (
    "truth",
    "goal_reached",
    "program",
    "judgement",
    "holds",
    "outcome",
    "is_success",
    "invalid",
    "label",
    "task",
)


def begin(browser, **chosen):
    response = browser.post(GAMES, chosen)
    assert response.status_code == 201, response.text
    return response.json()


def seat(browser, key):
    response = browser.get(f"{SEATS}/{key}")
    assert response.status_code == 200, response.text
    return response.json()


def act(browser, key, action, own_actions=None):
    if own_actions is None:
        own_actions = len(seat(browser, key)["own_actions"])
    return browser.post(f"{SEATS}/{key}/actions", {"action": action, "own_actions": own_actions})


def legal(browser, key):
    return browser.get(f"{SEATS}/{key}/legal").json()["actions"]


def live_game(app, key):
    return app.state.services.games.find(key)[0]


def play_out(browser, keys, seed=0):
    """Plays random legal actions in the people's seats to the end; returns all response bodies."""
    rng = np.random.default_rng(seed)
    bodies = []
    for _ in range(400):
        for key in keys.values():
            response = browser.get(f"{SEATS}/{key}")
            bodies.append(response.text)
            state = response.json()
            if state["over"]:
                return bodies
            if state["your_turn"]:
                names = browser.get(f"{SEATS}/{key}/legal")
                bodies.append(names.text)
                name = str(rng.choice(names.json()["actions"]))
                bodies.append(act(browser, key, name, len(state["own_actions"])).text)
    raise AssertionError("the game did not end")


def people(made):
    """The seat keys by role."""
    return {role: key for role, key in made.items() if key is not None}


PROTOCOLS = ["veto", "joint", "audit", "critique"]


@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize("seats", [("person", "oracle"), ("helpful", "person")])
def test_game__every_protocol_can_be_played_to_the_end(browser, protocol, seats):
    made = begin(browser, protocol=protocol, proposer=seats[0], verifier=seats[1], configuration="TowerFlipIt")
    ((role, key),) = people(made).items()
    assert role == ("proposer" if seats[0] == "person" else "verifier")
    play_out(browser, {role: key})
    body = seat(browser, key)
    assert body["over"]
    assert not body["your_turn"]
    assert body["reward"] == pytest.approx(live_game(browser.app, key).rewards[Role[role.upper()]])
    assert act(browser, key, "STOP").status_code == 409


def keys_of(value):
    """Every key in a JSON value, recursively."""
    if isinstance(value, dict):
        return {str(key) for key in value} | {name for inner in value.values() for name in keys_of(inner)}
    if isinstance(value, list):
        return {name for inner in value for name in keys_of(inner)}
    return set()


@pytest.mark.parametrize(
    ("protocol", "configuration"), list(zip(PROTOCOLS, ["TowerFlipIt", "ScatterFlipIt"] * 2, strict=True))
)
def test_responses__contain_only_what_the_seat_may_know_until_the_end(browser, protocol, configuration):
    made = begin(
        browser, protocol=protocol, configuration=configuration, proposer="person", verifier="person", rewards="hidden"
    )
    bodies = play_out(browser, people(made))
    state = live_game(browser.app, made["proposer"]).engine.state
    task = state.mdp.task
    assert json.loads(bodies[0])["intent"] in ("helpful", "deceptive")
    for text in bodies:
        body = json.loads(text)
        assert task.program not in text
        assert task.id not in text
        if body.get("over"):
            continue
        assert body.get("end") is None
        assert not {key for key in keys_of(body) if any(word in key for word in FORBIDDEN)}
        if body.get("role") == "verifier":
            assert body["intent"] is None
            assert "helpful" not in text
            assert "deceptive" not in text
    ends = [seat(browser, key)["end"] for key in people(made).values()]
    value = task.truth(state.mdp.scene)
    told = {"reached": value is task.target, "statement": task.statement, "value": value, "target": task.target}
    assert ends == [{**told, "intent": state.intent.name.lower()}] * 2


def test_view__simultaneous_choices_stay_hidden_until_both_are_made(browser):
    made = begin(browser, protocol="joint", proposer="person", verifier="person")
    before = browser.get(f"{SEATS}/{made['verifier']}").text
    response = act(browser, made["proposer"], "ADD(LEFT, BLUE)").json()
    assert (response["waiting_for_other"], response["your_turn"]) == (True, False)
    assert browser.get(f"{SEATS}/{made['verifier']}").text == before
    after = act(browser, made["verifier"], "continue").json()
    assert {"proposal": "ADD(LEFT, BLUE)", "answer": "continue"}.items() <= after["history"][-1].items()


def test_seat__two_browsers_share_a_game(app):
    one, other = Browser(app), Browser(app)
    made = begin(one, proposer="person", verifier="person")
    assert not seat(other, made["verifier"])["your_turn"]
    act(one, made["proposer"], "ADD(MIDDLE, BLACK)")
    asked = seat(other, made["verifier"])
    assert (asked["proposal"], asked["answers"]) == ("ADD(MIDDLE, BLACK)", ["reject", "accept"])
    act(other, made["verifier"], "accept")
    scene = seat(one, made["proposer"])["scene"]
    assert [(item["box"], item["description"]) for item in scene["items"]] == [(1, "black block at the bottom")]


def test_seat__a_rejection_keeps_the_scene_and_is_visible_to_the_proposer(browser):
    made = begin(browser, proposer="person", verifier="always_reject")
    body = act(browser, made["proposer"], "ADD(LEFT, BLUE)").json()
    assert body["scene"]["items"] == []
    assert [turn["answer"] for turn in body["history"]][-1] == "reject"
    assert body["your_turn"]


def test_critique__a_message_reaches_the_proposer(browser):
    made = begin(browser, protocol="critique", proposer="person", verifier="person")
    act(browser, made["proposer"], "ADD(LEFT, BLUE)")
    answers = seat(browser, made["verifier"])["answers"]
    assert "reject, message 3" in answers
    act(browser, made["verifier"], "reject, message 3")
    assert seat(browser, made["proposer"])["message"] == 3


def test_legal__equals_the_agents_mask(browser):
    made = begin(browser, proposer="person", verifier="oracle", configuration="ScatterScratch")
    game = live_game(browser.app, made["proposer"])
    mask = game.engine.observe(Role.PROPOSER)["action_mask"]
    names = set(legal(browser, made["proposer"]))
    assert names == {game.engine.game.describe(Role.PROPOSER, index) for index in np.flatnonzero(mask)}


@pytest.mark.parametrize(
    ("action", "own_actions", "said"),
    [
        ("ADD(LEFT, PINK)", 0, "not legal now; nothing was done"),
        ("REMOVE(LEFT)", 0, "not legal now: there is no block to remove; nothing was done"),
        ("ADD(LEFT, BLUE)", 5, "you have acted since"),
    ],
)
def test_action__invalid_is_refused_and_changes_nothing(browser, action, own_actions, said):
    made = begin(browser, proposer="person", verifier="oracle")
    before = seat(browser, made["proposer"])
    assert_refused(act(browser, made["proposer"], action, own_actions), 409, said)
    assert seat(browser, made["proposer"]) == before


def test_action__out_of_turn_is_refused(browser):
    made = begin(browser, proposer="person", verifier="person")
    assert act(browser, made["verifier"], "accept").status_code == 409
    assert act(browser, made["proposer"], "ADD(LEFT, BLUE)").status_code == 200
    assert act(browser, made["verifier"], "perhaps").status_code == 409


@pytest.mark.parametrize(
    ("chosen", "status", "said"),
    [
        ({"proposer": "helpful", "verifier": "oracle"}, 422, "at least one of the seats must"),
        ({"verifier": "helpful"}, 422, "cannot be verifier; choose from person, oracle"),
        ({"verifier": "run:0123456789abcdef"}, 404, "no such agent"),
        ({"verifier": "agent:../../etc/passwd"}, 422, "verifier"),
        ({"verifier": "agent:imitation-tower", "configuration": "ScatterFlipIt"}, 422, "does not play"),
        ({"protocol": "auction"}, 422, "protocol"),
        ({"rewards": "brier"}, 422, "rewards"),
    ],
)
def test_begin__names_the_invalid_setting(browser, chosen, status, said):
    if "agent:" in chosen.get("verifier", "") or "run:" in chosen.get("verifier", ""):
        pytest.importorskip("torch")
    assert_refused(browser.post(GAMES, chosen), status, said)


@pytest.mark.parametrize("seats", [("agent:parse-and-plan", "person"), ("person", "agent:parse-and-plan")])
def test_trained_partner__takes_either_seat(browser, seats):
    pytest.importorskip("torch")
    made = begin(browser, proposer=seats[0], verifier=seats[1], configuration="TowerFlipIt")
    (key,) = people(made).values()
    if seats[1] == "person":
        assert act(browser, key, "accept").status_code == 200
        assert seat(browser, key)["history"]
    else:
        body = act(browser, key, legal(browser, key)[1]).json()
        assert body["history"][-1]["answer"] == "accept"
        assert body["your_turn"]


def test_agent_of_the_game__plays_its_own_protocol(browser, tmp_path, monkeypatch):
    pytest.importorskip("torch")
    from lilgym_mp.learning.game.training import train_game
    from tests.learning.conftest import SMALL_GAME

    settings = GameSettings(protocol="audit", rewards="correctness")
    trained = train_game(settings, SMALL_GAME, tmp_path, steps=64, device="cpu")
    name = "agent:parse-and-plan"
    monkeypatch.setattr(browser.app.state.services.runs, "_agent", {name: trained}.get)
    chosen = {"verifier": name, "proposer": "person", "configuration": "TowerScratch"}
    refused = browser.post(GAMES, {**chosen, "protocol": "veto"})
    assert_refused(refused, 422, "this agent plays tower under the protocol audit")
    (key,) = people(begin(browser, **chosen, protocol="audit")).values()
    body = act(browser, key, "STOP").json()
    assert body["over"]
    assert body["history"][-1]["answer"] in ("holds", "does not hold")


def test_games__are_limited_in_number(browser, monkeypatch):
    monkeypatch.setattr(live_games, "MAX_SEATS", 5)
    keys = [begin(browser)["proposer"] for _ in range(7)]
    assert [browser.get(f"{SEATS}/{key}").status_code for key in keys] == [404, 404, *[200] * 5]
