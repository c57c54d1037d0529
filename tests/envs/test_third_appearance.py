"""An appearance that the package does not have, made of the protocol alone: what plays it, and what refuses it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from lilgym_mp import testing
from lilgym_mp.corpus import load_tasks
from lilgym_mp.corpus.generator import training_pairs
from lilgym_mp.envs.batched import BatchedEnv
from lilgym_mp.envs.rules import make_dynamics
from lilgym_mp.envs.single import LilGymEnv
from lilgym_mp.scene import appearances
from lilgym_mp.solver import Solver
from tests.envs.lamps import NAME, Lamps

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def known(monkeypatch: pytest.MonkeyPatch) -> None:
    """The new appearance is known for the time of the test."""
    monkeypatch.setitem(appearances.BUILDERS, NAME, lambda grid: Lamps())


@pytest.fixture
def corpus(tmp_path: Path) -> str:
    """A corpus of the new appearance."""
    lamp = {"x_loc": 40, "y_loc": 40, "type": "circle", "color": "Yellow", "size": 20}
    entries = [
        {
            "id": f"{count}",
            "appearance": NAME,
            "split": split,
            "statement": f"Exactly {word} of the lamps shine.",
            "program": f"count(all_items) == {count}",
            "starts": [{"id": f"{count}-no", "label": False, "scene": [[], [], [lamp] if count == 3 else []]}],
        }
        for count, word, split in ((2, "two", "train"), (3, "three", "train"), (1, "one", "dev"))
    ]
    path = tmp_path / "lamps.jsonl"
    header = {"format": "lilgym_mp-corpus", "version": 1, "name": "lamps", "licence": "MIT"}
    path.write_text("\n".join(json.dumps(line) for line in (header, *entries)) + "\n")
    return str(path)


@pytest.mark.parametrize("start", ["scratch", "flipit"])
def test_third_appearance__keeps_the_contracts_single_and_batched(corpus: str, start: str):
    settings: Any = {"appearance": NAME, "start": start, "corpus": corpus}
    testing.check_env(lambda: LilGymEnv(**settings))
    testing.check_vector_env(partial(BatchedEnv, **settings), lambda: LilGymEnv(**settings), num_envs=16, steps=20)


@pytest.mark.parametrize("protocol", ["veto", "joint"])
def test_third_appearance__works_in_the_two_agent_game(corpus: str, protocol: str):
    pytest.importorskip("pettingzoo", reason="pettingzoo is not installed: it comes with the extra `pettingzoo`")
    from lilgym_mp.envs.proposer_verifier import parallel_env

    game = parallel_env(appearance=NAME, start="scratch", corpus=corpus, protocol=protocol)
    observations, _ = game.reset(options={"task": "2"})
    rewards: dict[str, float] = {}
    while game.agents:
        lit = sum(bool(box.items) for box in game.scene.boxes)
        wanted = {"proposer_0": lit + 1 if lit < 2 else 0, "verifier_0": int(protocol == "veto" or lit == 2)}
        masks = {agent: observation["action_mask"] for agent, observation in observations.items()}
        actions = {agent: want if masks[agent][want] else int(masks[agent].argmax()) for agent, want in wanted.items()}
        observations, rewards, *_ = game.step(actions)
    assert rewards["proposer_0"] > 0


def test_third_appearance__is_refused_by_expert_and_generator():
    with pytest.raises(ValueError, match=r"no expert for appearance 'lamps'; choose from scatter, tower"):
        Solver(make_dynamics(Lamps()))
    with pytest.raises(ValueError, match=r"unknown appearance 'lamps'; choose from scatter, tower"):
        next(training_pairs(NAME, 0))
    for start in ("scratch", "flipit"):
        with pytest.raises(ValueError, match=r"unknown appearance 'lamps'; choose from scatter, tower"):
            load_tasks("generated:1", NAME, start, "train")


def test_third_appearance__is_unknown_unless_registered(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delitem(appearances.BUILDERS, NAME)
    with pytest.raises(ValueError, match=r"unknown appearance 'lamps'"):
        LilGymEnv(appearance=NAME)


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A copy of the package with the new appearance: one file and one line."""
    ignored = shutil.ignore_patterns("__pycache__")
    for name in ("lilgym_mp", "wrappers"):
        shutil.copytree(ROOT / name, tmp_path / "copy" / name, ignore=ignored)
    (tmp_path / "copy" / "data").symlink_to(ROOT / "data")
    package = tmp_path / "copy" / "lilgym_mp" / "scene" / "appearances"
    lamps = (ROOT / "tests" / "envs" / "lamps.py").read_text()
    (package / "lamps.py").write_text(f"{lamps}\n\ndef make_lamps(grid):\n    return Lamps()\n")
    table = (package / "__init__.py").read_text()
    line = '    "tower": "lilgym_mp.scene.appearances.tower:make_tower",\n'
    assert table.count(line) == 1
    added = line.replace("tower", "lamps")
    (package / "__init__.py").write_text(table.replace(line, line + added))
    return tmp_path / "copy"


EVERYTHING = """
import contextlib, io, sys
from pathlib import Path
import gymnasium as gym
import lilgym_mp
from lilgym_mp.cli import main
from lilgym_mp.wrappers import text_observation_v0
corpus, place = sys.argv[1], Path(sys.argv[2])

def command(*words, lines=()):
    sys.stdin = io.StringIO("".join(line + "\\n" for line in lines))
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        assert main([*words, "--corpus", corpus]) == 0, words
    return said.getvalue()

env = gym.make("lilgym_mp/LampsScratch-v0", corpus=corpus, render_mode="rgb_array")
env.reset(seed=0)
assert env.render().shape == (304, 784, 3)
words = text_observation_v0(gym.make("lilgym_mp/LampsFlipIt-v0", corpus=corpus))
assert "circle" in str(words.reset(seed=0)[0])
assert "lights the lamp" in words.instructions()
said = command("play", "LampsScratch", "--split", "dev", lines=["help", "add left yellow", "stop", "quit"])
assert "such as: ADD(LEFT, YELLOW)" in said and "success" in said
game = ["play", "LampsScratch", "--protocol", "veto", "--split", "dev"]
assert "ADD(LEFT, YELLOW)" in command(*game, lines=["legal", "quit"])
both = ["LampsScratch", "LampsFlipIt"]
command("evaluate", "--policy", "random-legal", "--configuration", *both, "--record", str(place))
from lilgym_mp.contrib.report import make_report
make_report([place], place / "report")
assert "LampsFlipIt" in (place / "report" / "index.html").read_text()
import warnings
warnings.simplefilter("ignore")
from starlette.testclient import TestClient
from lilgym_mp.contrib.web.app import ServeOptions, create_app
app = create_app(ServeOptions(database=place / "web.sqlite3", runs=place, corpus=corpus))
browser = TestClient(app)
recordings = browser.get("/api/watch/recordings").json()["recordings"]
assert len(recordings) == 2
for recording in recordings:
    assert browser.get(f"/api/watch/recordings/{recording['id']}/episodes/0").json()["grid"] == [3, 1]
token = browser.get("/api/session").json()["csrf_token"]
new = {"configuration": "LampsScratch", "split": "dev"}
episode = browser.post("/api/play/episodes", json=new, headers={"X-CSRF-Token": token}).json()
assert episode["grid"] is None and episode["actions_left"] == 12, episode
solution = browser.post(f"/api/play/episodes/{episode['id']}/solution", headers={"X-CSRF-Token": token})
assert (solution.status_code, "no expert" in solution.text) == (404, True), solution.text
app.state.services.close()
"""


@pytest.mark.long
def test_third_appearance__plays_renders_records_is_watched_and_reported_after_adding_a_file_and_a_line(
    copy: Path, corpus: str, tmp_path: Path
):
    for package in ("pettingzoo", "fastapi", "matplotlib", "jinja2", "httpx"):
        pytest.importorskip(package)
    done = subprocess.run(
        [sys.executable, "-c", EVERYTHING, corpus, tmp_path / "runs"],
        cwd=copy,
        env={**os.environ, "PYTHONPATH": str(copy)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
