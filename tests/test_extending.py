"""The code in docs/extending.md does what the recipes say, in the files that they name."""

import json
import os
import re
import sys
from functools import partial
from importlib.metadata import EntryPoint
from textwrap import dedent
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest

import lilgym_mp  # noqa: F401  (registers the environments)
from lilgym_mp.envs.proposer_verifier import protocols
from lilgym_mp.envs.proposer_verifier.rewards import register_reward_term
from lilgym_mp.envs.registration import register_appearance
from lilgym_mp.scene import choices
from lilgym_mp.wrappers.gymnasium_adapter import factory
from tests.command_line import python
from tests.scripts import ROOT, needs

TEXT = (ROOT / "docs" / "extending.md").read_text()
WORD, WRAPPER, LAMPS, PROTOCOL, TERM, REWARDS = (
    dedent(code) for code in re.findall(r"^ *```python\n(.*?)^ *```", TEXT, re.S | re.M)
)
USE = """
import gymnasium as gym
import numpy as np
from lilgym_mp.envs.workers import WorkerVectorEnv
from lilgym_mp.programs import compile_program
from lilgym_mp.scene import Scene

if __name__ == "__main__":
    import sys
    assert not compile_program("exist(filter_obj(all_items, is_high))")(Scene.empty())
    corpus = sys.argv[1]
    envs = WorkerVectorEnv("lilgym_mp/LampsScratch-v0", 4, 2, start_method="spawn", corpus=corpus)
    batch = gym.make_vec("lilgym_mp/LampsScratch-v0", num_envs=4, corpus=corpus)
    assert np.array_equal(envs.reset(seed=0)[0]["image"], batch.reset(seed=0)[0]["image"])
    envs.close()
    from lilgym_mp.envs.proposer_verifier import BatchedGames
    rewards = {"proposer_0": "mdp", "verifier_0": {"cautious": 1.0}}
    BatchedGames(2, configuration="LampsScratch", corpus=corpus, protocol="claims", rewards=rewards).reset(seed=0)
    print("used")
"""
WEB = """
from pathlib import Path
from tests.web.web_app import Browser, server

with server(Path("."), corpus="lamps.jsonl") as app:
    browser = Browser(app)
    assert browser.get("/play").status_code == 200
    begun = browser.post("/api/play/episodes", {"configuration": "LampsScratch", "split": "train"})
    print(begun.status_code, begun.json()["statement"])
"""


# Runs each command in a fork of its own: this process has imported the libraries that take longest, but no extension.
FORKS = """
import os, sys
import gymnasium, numba, numpy, rich.console

for number, command in enumerate(sys.argv[1:]):
    if child := os.fork():
        os.waitpid(child, 0)
        continue
    said = os.open(f"said-{number}.txt", os.O_CREAT | os.O_TRUNC | os.O_WRONLY)
    os.dup2(said, 1)
    os.dup2(said, 2)
    os.dup2(os.open("asked.txt", os.O_RDONLY), 0)
    if command.startswith("import "):
        exec(command)
        sys.exit()
    from lilgym_mp.cli import main
    sys.exit(main(command.split()))
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A directory with an installed package that nobody imports, its corpus and recorded episodes to come."""
    path = tmp_path_factory.mktemp("installed")
    package = path / "lamp_world"
    package.mkdir()
    (package / "__init__.py").write_text("\n".join((WORD, LAMPS, PROTOCOL, TERM.split("game =")[0])))
    lamps = (ROOT / "tests" / "envs" / "lamps.py").read_text()
    (package / "lamps.py").write_text(f"{lamps}\n\ndef make_lamps(grid):\n    return Lamps()\n")
    info = path / "lamp_world-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Name: lamp_world\nVersion: 1\n")
    (info / "entry_points.txt").write_text("[lilgym_mp]\nlamp_world = lamp_world\n")
    entry = {"id": "2", "appearance": "lamps", "split": "train", "statement": "Exactly two of the lamps shine."}
    entry["program"] = "exist(filter_obj(all_items, is_high)) and count(all_items) == 2"
    entry["starts"] = [{"id": "2-no", "label": False, "scene": [[], [], []]}]
    header = {"format": "lilgym_mp-corpus", "version": 1, "name": "lamps", "licence": "MIT"}
    (path / "lamps.jsonl").write_text(f"{json.dumps(header)}\n{json.dumps(entry)}\n")
    (path / "use.py").write_text(USE)
    (path / "web.py").write_text(WEB)
    (path / "first.py").write_text(FORKS)
    (path / "asked.txt").write_text("hint\nadd left yellow\n")  # by a player
    return path


def run_in(installed, *arguments):
    """What a new process of Python does in which the package is installed."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(ROOT), str(installed)))}
    return python(*arguments, cwd=installed, env=environment)


NO_EXPERT = "appearance 'lamps' has no expert; those that have one: scatter, tower"
NO_HEADS = "appearance 'lamps' has no heads for its actions; choose another model"
NO_STATEMENTS = "appearance 'lamps' has no generator of statements; those that have one: scatter, tower"
NO_RECIPE = "appearance 'lamps' has no recipe for this learner; those that have one: scatter, tower"
NO_SAMPLER = "appearance 'lamps' has no sampler of scenes; those that have one: scatter, tower"
LAMPS_TRAIN = "LampsScratch --corpus lamps.jsonl --split train"
NEW_RUN = "--corpus lamps.jsonl --held-out 0 --out run"
MAKE = "import gymnasium{}; gymnasium.make('{}lilgym_mp/LampsScratch-v0', corpus='lamps.jsonl')"
FIRST = {  # and a part of what they say
    MAKE.format(", lilgym_mp", ""): "",
    f"play {LAMPS_TRAIN} --protocol claims": "ADD(MIDDLE, YELLOW)",
    "data check lamps.jsonl": "no faults",
    f"solve {LAMPS_TRAIN}": NO_EXPERT,
    MAKE.format("", "lilgym_mp:"): "",
    f"evaluate --policy random-legal --configuration {LAMPS_TRAIN} --record played": "random-legal",
    f"play {LAMPS_TRAIN}": f"{NO_EXPERT}\n> add left yellow",
    "explain --configuration LampsScratch --program exist(filter_obj(all_items,is_high))": NO_SAMPLER,
    "explain --configuration LampsScratch --program is_high(all_items)": "is_high",
    "data generate 1 --appearances tower lamps --out new.jsonl": NO_STATEMENTS,
    "data synthesize lamps.jsonl --out new.jsonl": NO_SAMPLER,
    f"data collect {LAMPS_TRAIN} --quality random-legal --episodes 2 --out set.jsonl": "set.jsonl",
    f"evaluate --policy expert --configuration {LAMPS_TRAIN}": NO_EXPERT,
    "evaluate --protocol poker": "claims",
    f"train ppo LampsScratch {NEW_RUN}": NO_HEADS,
    f"train game LampsScratch --protocol claims {NEW_RUN}": NO_HEADS,
    f"train imitation LampsScratch {NEW_RUN}": NO_RECIPE,
    f"train reward-model LampsScratch {NEW_RUN}": NO_RECIPE,
    "llm prompts --kind plan --appearance lamps --episodes 1 --out new.jsonl": NO_SAMPLER,
    f"data collect {LAMPS_TRAIN} --episodes 2 --out other.jsonl": NO_EXPERT,
    "bench LampsScratch --corpus lamps.jsonl --quick --only single": "single",
}


@pytest.fixture(scope="module")
def said(installed):
    """What each command says as the first of its process."""
    run_in(installed, "first.py", *FIRST)
    return {command: (installed / f"said-{index}.txt").read_text() for index, command in enumerate(FIRST)}


@pytest.mark.long
@pytest.mark.parametrize("command", FIRST)
def test_first_command__knows_what_an_installed_package_adds(said, command):
    for word, module in (("train", "torch"), ("--protocol", "pettingzoo")):
        if word in command.split():
            needs(module)
    text = said[command]
    assert FIRST[command] in text
    assert "Traceback" not in text
    if FIRST[command] in (NO_HEADS, NO_STATEMENTS, NO_RECIPE):
        assert len(text.splitlines()) == 1


@pytest.mark.long
@pytest.mark.parametrize(
    ("script", "module", "last"),
    [("use.py", "pettingzoo", "used"), ("web.py", "fastapi", "201 Exactly two of the lamps shine.")],
)
def test_recipes__work_in_batches_workers_and_games_and_in_the_browser(installed, script, module, last):
    needs(module)
    done = run_in(installed, script, "lamps.jsonl")
    assert done.stdout.splitlines()[-1:] == [last], done.stderr


@pytest.mark.long
def test_report__has_the_episodes_of_an_appearance_of_an_installed_package(installed):
    pytest.importorskip("matplotlib")
    policy = ("--policy", "random-legal", "--record", "recorded")
    run_in(installed, "-m", "lilgym_mp", "evaluate", *policy, "--configuration", *LAMPS_TRAIN.split())
    assert run_in(installed, "-m", "lilgym_mp", "report", "recorded", "--out", "page").stderr == ""
    assert "LampsScratch" in (installed / "page" / "index.html").read_text()


def test_extensions__that_cannot_be_imported_or_exit_are_named_and_others_load(monkeypatch):
    loaded = []
    broken = EntryPoint("broken", "no_such_module", choices.EXTENSIONS)
    rude = SimpleNamespace(name="rude", load=lambda: sys.exit(3))
    good = SimpleNamespace(load=lambda: loaded.append("good"))
    monkeypatch.setattr(choices, "_PENDING", iter([broken, rude, good]))
    with (
        pytest.warns(UserWarning, match="'broken' .*no_such_module"),
        pytest.warns(UserWarning, match="'rude' cannot be imported: SystemExit"),
    ):
        choices.load_extensions()
    assert loaded == ["good"]


def test_registrations__of_a_name_that_is_taken_are_refused():
    for register, message in (
        (partial(register_appearance, "tower", "module:function"), "appearance 'tower' is already registered"),
        (partial(protocols.register_protocol, protocols.PROTOCOLS["veto"]), "protocol 'veto' is already registered"),
        (partial(register_reward_term, "hidden", float), "reward 'hidden' is already registered"),
    ):
        with pytest.raises(ValueError, match=message):
            register()


def test_recipe_of_a_wrapper__counts_items_of_one_environment_and_of_a_batch():
    names = {}
    exec(WRAPPER, names)
    item_count_v0 = factory(names["ItemCount"])
    env = item_count_v0(gym.make("lilgym_mp/TowerFlipIt-v0"))
    observation, _ = env.reset(seed=0)
    assert observation["items"] == sum(len(box.items) for box in env.unwrapped.scene.boxes)
    assert env.observation_space.contains(observation)
    batch = item_count_v0(gym.make_vec("lilgym_mp/TowerFlipIt-v0", num_envs=3))
    counted = batch.reset(seed=[0, 1, 2])[0]["items"]
    assert counted[0] == observation["items"]
    assert np.shape(counted) == (3,)


def test_recipe_of_a_protocol__asks_about_stops_only(monkeypatch):
    pytest.importorskip("pettingzoo")
    from lilgym_mp.envs.proposer_verifier import parallel_env

    monkeypatch.setitem(protocols.PROTOCOLS, "claims", None)
    del protocols.PROTOCOLS["claims"]
    exec(PROTOCOL, {})
    game = parallel_env(protocol="claims")
    game.reset(seed=0)
    game.step({"proposer_0": 1, "verifier_0": 0})
    assert game.engine.state.mdp.steps == 1
    game.step({"proposer_0": 0, "verifier_0": 0})
    assert game.engine.state.mdp.steps == 1


def test_recipes__name_existing_files():
    new = ("item_count.py", "appearances/lamps.py", "learning/sarsa", "own_statements")
    named = re.findall(r"`((?:lilgym_mp|wrappers|tests|docs|scripts)/[\w/.*]+)`", TEXT)
    missing = [name for name in named if not any(part in name for part in new) and not list(ROOT.glob(name))]
    assert len(named) > 15
    assert missing == []


def test_recipe_of_rewards__punishes_accepted_false_claims():
    pytest.importorskip("pettingzoo")
    names = {}
    exec(REWARDS, names)
    game = names["game"]
    game.reset(seed=0)
    game.step({"proposer_0": 0, "verifier_0": 2})
    assert game.step({"proposer_0": 13, "verifier_0": 1})[1] == {"proposer_0": -1.0, "verifier_0": -3.0}
