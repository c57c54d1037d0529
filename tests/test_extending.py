"""The code in docs/extending.md does what the recipes say, in the files that they name."""

from __future__ import annotations

import re
from pathlib import Path
from textwrap import dedent
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import lilgym_mp  # noqa: F401  (registers the environments)
from lilgym_mp.envs.proposer_verifier import protocols
from lilgym_mp.programs import compile_program, words
from lilgym_mp.programs.functions import items
from lilgym_mp.wrappers.gymnasium_adapter import factory
from tests.scenes import B, scene, tower

ROOT = Path(__file__).resolve().parents[1]
TEXT = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
WORD, WRAPPER, DECISION, ROW, REWARDS = (
    dedent(code) for code in re.findall(r"^ *```python\n(.*?)^ *```", TEXT, re.S | re.M)
)


def test_recipe_of_a_word__compiles_and_is_true_of_high_items() -> None:
    exec(WORD, dict(vars(items)))
    try:
        program = compile_program("exist(filter_obj(all_items, is_high))")
        assert program(scene(tower(B, B, B, B), [], []))
        assert not program(scene(tower(B, B), [], []))
    finally:
        del words.WORDS["is_high"]


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
    names = dict(vars(protocols))
    exec(DECISION, names)
    added = eval(ROW, names)
    monkeypatch.setitem(protocols.PROTOCOLS, "claims", added)
    pytest.importorskip("pettingzoo", reason="pettingzoo is not installed: it comes with the extra `pettingzoo`")
    from lilgym_mp.envs.proposer_verifier import parallel_env

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
