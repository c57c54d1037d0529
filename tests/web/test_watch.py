"""/watch: recordings are listed, filtered and replayed step by step; damaged ones are reported."""

import io
import re
import shutil
from dataclasses import replace
from importlib.resources import files

import pytest
from PIL import Image

from lilgym_mp.contrib.web.runs import Runs
from lilgym_mp.envs.proposer_verifier import GameSettings, Role
from lilgym_mp.evaluation import Settings
from lilgym_mp.evaluation.episode_files import read_episodes, write_episodes
from lilgym_mp.evaluation.files import SUFFIX
from lilgym_mp.learning.common.run_directory import AGENT_FILE
from tests.command_line import succeeds
from tests.corpora import write_thin_corpus
from tests.web.web_app import Browser, assert_refused, server

API = "/api/watch/recordings"
JUDGED = "--record-decisions --judge-decisions"


def record(directory, name, configuration="TowerFlipIt", corpus="builtin", decisions=JUDGED):
    """The path of a recording that the command makes."""
    command = f"evaluate --alone --policy {name} --configuration {configuration} --corpus {corpus} {decisions} --record"
    succeeds(command, directory)
    (path,) = directory.glob(f"{name}*{SUFFIX}")
    return path


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Recordings of two policies on the same tasks, of another configuration, and one without decisions."""
    place = tmp_path_factory.mktemp("runs")
    thin = str(write_thin_corpus(tmp_path_factory.mktemp("corpus") / "thin.jsonl", 30))
    record(place / "tower", "random-legal", corpus=thin)
    record(place / "tower", "expert", corpus=thin)
    record(place / "scatter", "random-legal", "ScatterFlipIt", thin, "--record-decisions")
    record(place / "old", "random-legal", "TowerScratch", thin, "")
    return place


@pytest.fixture
def browser(tmp_path, runs):
    with server(tmp_path, runs=runs) as app:
        yield Browser(app)


def found(browser, name):
    """The recording whose name contains the text."""
    lines = browser.get(API).json()["recordings"]
    (line,) = [line for line in lines if name in line["name"]]
    return browser.get(f"{API}/{line['id']}").json()


def episode(browser, name, index=0):
    return browser.get(f"{API}/{found(browser, name)['id']}/episodes/{index}").json()


@pytest.mark.long
def test_recordings__are_listed_with_their_headers(browser):
    lines = browser.get(API).json()["recordings"]
    assert [(line["name"].split("/")[0], line["configuration"]) for line in lines] == [
        ("old", "TowerScratch"),
        ("scatter", "ScatterFlipIt"),
        ("tower", "TowerFlipIt"),
        ("tower", "TowerFlipIt"),
    ]


def test_request__a_shipped_agent_plays_and_is_listed_first(browser, runs):
    pytest.importorskip("torch")
    before = sorted(runs.rglob("*"))
    answer = browser.post(API, {"agent": "agent:imitation-tower", "configuration": "TowerFlipIt"})
    assert answer.status_code == 201, answer.text
    first = browser.get(API).json()["recordings"][0]
    assert (first["id"], first["agent"], first["episodes"]) == (answer.json()["id"], "imitation-tower", 12)
    steps = browser.get(f"{API}/{first['id']}/episodes/0").json()["steps"]
    assert all(step["decision"]["steps_to_go"] for step in steps[:-1])
    assert sorted(runs.rglob("*")) == before


@pytest.mark.long
def test_request__may_play_an_agent_with_a_recording_in_the_directory(tmp_path):
    pytest.importorskip("torch")
    recorded = record(tmp_path / "runs", "expert", decisions="")
    recorded.rename(recorded.with_name(f"imitation-TowerFlipIt-dev-0{SUFFIX}"))
    with server(tmp_path, runs=tmp_path / "runs") as app:
        browser, new = Browser(app), {"agent": "agent:imitation-tower", "configuration": "TowerFlipIt"}
        assert browser.post(API, new).status_code == 201
        assert len(browser.get(API).json()["recordings"]) == 2


def test_agents__of_replaced_files_are_loaded_again(tmp_path):
    pytest.importorskip("torch")
    runs, file = Runs(tmp_path), tmp_path / "mine" / AGENT_FILE
    file.parent.mkdir()
    for kind in ("imitation", "reward-model"):
        file.write_bytes((files("lilgym_mp.data") / f"agent-{kind}-tower.safetensors").read_bytes())
        (name,) = (name for name in runs.agents() if name.startswith("run:"))
        assert runs.agent(name).description.kind == kind
    assert runs.partner(name, Role.VERIFIER, GameSettings("TowerScratch")) == runs.agent(name).answer


@pytest.mark.parametrize(
    ("agent", "configuration", "status", "reason"),
    [
        ("agent:none", "TowerFlipIt", 404, "no such agent"),
        ("agent:imitation-tower", "ScatterFlipIt", 422, "does not play ScatterFlipIt; it plays Tower"),
        ("agent:imitation-tower", "Towers", 422, "configuration"),
    ],
)
def test_request__that_cannot_be_played_says_why(browser, agent, configuration, status, reason):
    pytest.importorskip("torch")
    assert_refused(browser.post(API, {"agent": agent, "configuration": configuration}), status, reason)


def test_recording__has_outcome_counts_and_comparable_recordings(browser, runs):
    body = found(browser, "tower/random-legal")
    recorded = read_episodes(next((runs / "tower").glob("random-legal*.gz")))
    assert body["successes"] == sum(episode.is_success for episode in recorded.episodes)
    assert sum(body["outcomes"].values()) == body["episodes"] == len(recorded.episodes)
    assert [line["agent"] for line in body["comparable"]] == ["expert"]
    assert [(line["task"], line["outcome"]) for line in body["played"]] == [
        (episode.task, episode.outcome) for episode in recorded.episodes
    ]


def test_recording__without_decisions_says_so(browser):
    assert all(step["decision"] is None for step in episode(browser, "old/")["steps"])


def test_episode__the_expert_is_certain_and_optimal_and_counts_down(browser):
    for index in range(5):
        *steps, end = episode(browser, "expert", index)["steps"]
        assert (end["action"], end["decision"]) == (None, None)
        assert [step["decision"]["steps_to_go"] for step in steps] == list(range(len(steps), 0, -1))
        for step in steps:
            decision = step["decision"]
            assert decision["optimal"]
            assert decision["likeliest"] == [[step["action"], 1.0]]


def test_episode__counts_legal_actions_by_the_exact_mask(browser, runs):
    recorded = read_episodes(next((runs / "scatter").glob("*.gz")))
    decision = episode(browser, "scatter/")["steps"][0]["decision"]
    env = Settings("ScatterFlipIt").make("dev")
    env.reset(options={"task": recorded.episodes[0].task})
    assert sum(decision["legal"]) == env.action_masks().sum()
    assert {cell for cell, _ in decision["add_cells"]} <= set(range(19 * 5))


def test_episode__tower_cells_are_its_boxes(browser):
    shown = episode(browser, "tower/random-legal")
    assert shown["grid"] == [3, 1]
    assert {cell for cell, _ in shown["steps"][0]["decision"]["add_cells"]} <= {0, 1, 2}


@pytest.mark.parametrize(
    ("path", "status"),
    {
        f"{API}/0123456789abcdef": 404,
        f"{API}/0123456789abcdef/episodes/0": 404,
        f"{API}/..%2F..%2Fetc%2Fpasswd": 404,
        f"{API}/%2e%2e": 422,
    }.items(),
)
def test_recording__only_listed_ids_are_found(browser, path, status):
    response = browser.get(path)
    assert response.status_code == status, response.text
    assert "root:" not in response.text


def test_episode__beyond_the_last_is_not_found(browser):
    response = browser.get(f"{API}/{found(browser, 'old/')['id']}/episodes/100000")
    assert_refused(response, 404, "this recording has episodes 0 to")


def damaged(runs, target, how):
    """Writes a damaged copy of a recording."""
    source = next((runs / "old").glob("*.gz"))
    target.parent.mkdir()
    if how == "horizon":
        recording = read_episodes(source)
        impossible = replace(recording.header.settings, horizon=-5)
        write_episodes(target, replace(recording.header, settings=impossible), recording.episodes)
    else:
        target.write_bytes({"text": b"not a recording", "cut": source.read_bytes()[:-200]}[how])


@pytest.mark.parametrize(
    ("how", "said"),
    {"text": "damaged", "cut": "truncated", "horizon": "horizon"}.items(),
)
def test_recording__a_damaged_file_is_left_out_or_refused_and_the_others_work(tmp_path, runs, how, said, caplog):
    place = tmp_path / "runs"
    damaged(runs, place / f"bad{SUFFIX}", how)
    shutil.copytree(runs / "tower", place / "tower")
    with server(tmp_path, runs=place) as app:
        browser = Browser(app)
        lines = {line["name"]: line for line in browser.get(API).json()["recordings"]}
        line = lines.pop("bad", None)
        assert len(lines) == 2
        if line is None:
            assert said in caplog.text
            return
        opened = browser.get(f"{API}/{line['id']}")
        if opened.status_code == 200:
            opened = browser.get(f"{API}/{line['id']}/episodes/0")
        assert_refused(opened, 422, said)
        assert str(tmp_path) not in opened.json()["message"]


def test_recording__a_rewritten_file_is_read_again(tmp_path, runs):
    place = tmp_path / "runs"
    path = record(place, "expert", "TowerScratch", decisions="")
    recording = read_episodes(path)
    with server(tmp_path, runs=place) as app:
        browser = Browser(app)
        assert found(browser, "expert")["episodes"] == len(recording.episodes) > 3
        write_episodes(path, replace(recording.header, episodes=3), recording.episodes[:3])
        assert found(browser, "expert")["episodes"] == 3


@pytest.mark.long
def test_watch__offers_agents_only_in_the_configurations_that_they_play(browser):
    pytest.importorskip("torch")
    page = browser.get("/watch").text
    offered = set(re.findall(r'<option value="agent:(\S+) (\w+)"', page))
    assert ("ppo-tower", "TowerFlipIt") in offered
    assert ("ppo-tower", "ScatterFlipIt") not in offered
    assert ("imitation-scatter", "ScatterScratch") in offered
    assert ">ppo-tower (included): TowerFlipIt<" in page, "the closed menu shows the agent too"


def test_film__of_an_episode_is_a_gif_with_a_frame_for_each_action(browser):
    found_id = found(browser, "expert")["id"]
    answer = browser.get(f"{API}/{found_id}/episodes/0/film")
    assert answer.headers["content-type"] == "image/gif"
    with Image.open(io.BytesIO(answer.content)) as picture:
        steps = browser.get(f"{API}/{found_id}/episodes/0").json()["steps"]
        assert getattr(picture, "n_frames", 1) == len(steps)
