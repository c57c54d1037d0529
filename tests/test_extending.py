"""The code in docs/extending.md does what the recipes say, in the files that they name."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import EntryPoint
from importlib.util import find_spec
from pathlib import Path
from textwrap import dedent
from types import SimpleNamespace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import lilgym_mp  # noqa: F401  (registers the environments)
from lilgym_mp.envs.proposer_verifier import protocols
from lilgym_mp.envs.proposer_verifier.rewards import register_reward_term
from lilgym_mp.envs.registration import register_appearance
from lilgym_mp.scene import choices
from lilgym_mp.wrappers.gymnasium_adapter import factory

ROOT = Path(__file__).resolve().parents[1]
TEXT = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
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


def test_recipes__work_from_an_installed_package_that_nobody_imports(tmp_path: Path) -> None:
    package = tmp_path / "lamp_world"
    package.mkdir()
    (package / "__init__.py").write_text("\n".join((WORD, LAMPS, PROTOCOL, TERM.split("game =")[0])))
    lamps = (ROOT / "tests" / "envs" / "lamps.py").read_text()
    (package / "lamps.py").write_text(f"{lamps}\n\ndef make_lamps(grid):\n    return Lamps()\n")
    info = tmp_path / "lamp_world-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Name: lamp_world\nVersion: 1\n")
    (info / "entry_points.txt").write_text("[lilgym_mp]\nlamp_world = lamp_world\n")
    task = {"id": "2", "appearance": "lamps", "split": "train", "statement": "Exactly two of the lamps shine."}
    start = {"id": "2-no", "label": False, "scene": [[], [], []]}
    corpus, script = tmp_path / "lamps.jsonl", tmp_path / "use.py"
    header = {"format": "lilgym_mp-corpus", "version": 1, "name": "lamps", "licence": "MIT"}
    lines = [header, {**task, "program": "count(all_items) == 2", "starts": [start]}]
    corpus.write_text("".join(json.dumps(line) + "\n" for line in lines))
    script.write_text(USE)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(ROOT), str(tmp_path)))}
    done = subprocess.run(
        [sys.executable, script, corpus], capture_output=True, text=True, env=environment, check=False
    )
    assert done.stdout.splitlines()[-1:] == ["used"], done.stderr

    def error_of(*arguments: object) -> str:
        command = [sys.executable, *map(str, arguments)]
        return subprocess.run(
            command, capture_output=True, text=True, env=environment, check=False, input="hint"
        ).stderr

    make = f"import gymnasium, lilgym_mp; gymnasium.make('lilgym_mp/LampsScratch-v0', corpus={str(corpus)!r})"
    assert error_of("-c", make) == ""
    command = ("-m", "lilgym_mp")
    assert "claims" in error_of(*command, "evaluate", "--protocol", "poker")
    no_sampler = "appearance 'lamps' has no sampler of scenes; those that have one: scatter, tower"
    assert no_sampler in error_of(*command, "data", "synthesize", corpus, "--out", tmp_path / "starts.jsonl")
    word = "exist(filter_obj(all_items, is_high))"
    assert no_sampler in error_of(*command, "explain", "--program", word, "--configuration", "LampsScratch")
    played = ("play", "LampsScratch", "--corpus", corpus, "--split", "train")
    assert error_of(*command, *played) == ""  # the hint that there is none does not end the session
    if find_spec("torch") is not None:
        game = ("train", "game", "LampsScratch", "--protocol", "claims", "--corpus", tmp_path / "none.jsonl")
        assert "none.jsonl" in error_of(*command, *game, "--out", tmp_path / "game")


def test_extension__that_cannot_be_imported_is_named_and_others_load(monkeypatch: pytest.MonkeyPatch) -> None:
    loaded: list[str] = []
    broken = EntryPoint("broken", "no_such_module", choices.EXTENSIONS)
    monkeypatch.setattr(choices, "_PENDING", iter([broken, SimpleNamespace(load=lambda: loaded.append("good"))]))
    with pytest.warns(UserWarning, match="the extension 'broken' cannot be imported: .*no_such_module"):
        choices.load_extensions()
    assert loaded == ["good"]


def test_extension__that_exits_is_one_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(choices, "_PENDING", iter([SimpleNamespace(name="rude", load=lambda: sys.exit(3))]))
    with pytest.warns(UserWarning, match="the extension 'rude' cannot be imported: SystemExit"):
        choices.load_extensions()


def test_registrations__of_a_name_that_is_taken_are_refused() -> None:
    taken: list[tuple[Callable[..., object], tuple[Any, ...], str]] = [
        (register_appearance, ("tower", "module:function"), "appearance 'tower' is already registered"),
        (protocols.register_protocol, (protocols.PROTOCOLS["veto"],), "protocol 'veto' is already registered"),
        (register_reward_term, ("hidden", float), "reward 'hidden' is already registered"),
    ]
    for register, arguments, message in taken:
        with pytest.raises(ValueError, match=message):
            register(*arguments)


def test_recipe_of_a_wrapper__counts_items_of_one_environment_and_of_a_batch() -> None:
    names: dict[str, Any] = {}
    exec(WRAPPER, names)
    item_count_v0 = factory(names["ItemCount"])
    env = item_count_v0(gym.make("lilgym_mp/TowerFlipIt-v0"))
    observation, _ = env.reset(seed=0)
    assert observation["items"] == sum(len(box.items) for box in env.unwrapped.scene.boxes)
    assert env.observation_space.contains(observation)
    batch = item_count_v0(gym.make_vec("lilgym_mp/TowerFlipIt-v0", num_envs=3))
    assert batch.reset(seed=[0, 1, 2])[0]["items"][0] == observation["items"]
    assert np.shape(batch.reset(seed=0)[0]["items"]) == (3,)


def test_recipe_of_a_protocol__asks_about_stops_only(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pettingzoo", reason="pettingzoo is not installed: it comes with the extra `pettingzoo`")
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


def test_recipes__name_existing_files() -> None:
    new = ("item_count.py", "appearances/lamps.py", "learning/sarsa", "own_statements")
    named = re.findall(r"`((?:lilgym_mp|wrappers|tests|docs|scripts)/[\w/.*]+)`", TEXT)
    missing = [name for name in named if not any(part in name for part in new) and not list(ROOT.glob(name))]
    assert len(named) > 15
    assert missing == []


def test_recipe_of_rewards__punishes_accepted_false_claims() -> None:
    pytest.importorskip("pettingzoo", reason="pettingzoo is not installed: it comes with the extra `pettingzoo`")
    names: dict[str, Any] = {}
    exec(REWARDS, names)
    game = names["game"]
    game.reset(seed=0)
    game.step({"proposer_0": 0, "verifier_0": 2})
    assert game.step({"proposer_0": 13, "verifier_0": 1})[1] == {"proposer_0": -1.0, "verifier_0": -3.0}
