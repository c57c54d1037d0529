"""An appearance that the package does not have, made of the protocol alone: what plays it, and what refuses it."""

from functools import partial

import pytest

from lilgym_mp import testing
from lilgym_mp.corpus import load_tasks, write_corpus
from lilgym_mp.corpus.generator.pairs import TEMPLATES
from lilgym_mp.corpus.generator.tower import TowerStatements
from lilgym_mp.envs import registration
from lilgym_mp.envs.batched import BatchedEnv
from lilgym_mp.envs.rules import make_dynamics
from lilgym_mp.envs.single import LilGymEnv
from lilgym_mp.scene import appearances
from lilgym_mp.solver import Solver
from tests.command_line import succeeds
from tests.corpora import entry
from tests.envs.lamps import LAMP, NAME, Lamps
from tests.json_files import read_json_lines
from tests.scenes import scene


@pytest.fixture(autouse=True)
def known(monkeypatch):
    """The new appearance is known for the time of the test."""
    monkeypatch.setitem(appearances.APPEARANCES, NAME, lambda grid: Lamps())
    for start in registration.START_TITLES:
        monkeypatch.setitem(registration.CONFIGURATIONS, registration.configuration_name(NAME, start), (NAME, start))


@pytest.fixture
def corpus(tmp_path):
    """A corpus of the new appearance."""
    entries = [
        entry(
            *(f"{count}", NAME, split, f"Exactly {word} of the lamps shine.", f"count(all_items) == {count}"),
            no=scene([], [], [LAMP] if count == 3 else []).to_json(),
        )
        for count, word, split in ((2, "two", "train"), (3, "three", "train"), (1, "one", "dev"))
    ]
    write_corpus(tmp_path / "lamps.jsonl", "lamps", "MIT", entries)
    return str(tmp_path / "lamps.jsonl")


def test_third_appearance__keeps_the_contracts_single_and_batched(corpus):
    settings = {"appearance": NAME, "start": "flipit", "corpus": corpus}
    testing.check_env(lambda: LilGymEnv(**settings), steps=40)
    testing.check_vector_env(partial(BatchedEnv, **settings), lambda: LilGymEnv(**settings), num_envs=9, steps=10)


def test_third_appearance__works_in_the_two_agent_game(corpus):
    pytest.importorskip("pettingzoo")
    from lilgym_mp.envs.proposer_verifier import BatchedGames, parallel_env

    settings = {"appearance": NAME, "start": "scratch", "corpus": corpus, "protocol": "veto"}
    testing.check_batched_games(partial(BatchedGames, **settings), partial(parallel_env, **settings), steps=12)


def test_third_appearance__is_refused_by_expert_and_generator():
    with pytest.raises(ValueError, match="'lamps' has no expert; those that have one: scatter, tower"):
        Solver(make_dynamics(Lamps()))
    with pytest.raises(ValueError, match="'lamps' has no generator of statements; those that have one: scatter, tower"):
        load_tasks("generated:1", NAME, "scratch", "train")


def test_data_generate__offers_an_appearance_that_has_statements(tmp_path, monkeypatch):
    monkeypatch.setitem(appearances.APPEARANCES, "blocks", "lilgym_mp.scene.appearances.tower.rules:make_tower")
    monkeypatch.setitem(TEMPLATES, "blocks", TowerStatements)
    out = tmp_path / "blocks.jsonl"
    succeeds("data generate 2 --level 1 --split train --appearances blocks --out", out)
    assert [line.get("appearance") for line in read_json_lines(out)] == [None, "blocks", "blocks"]


def test_third_appearance__is_unknown_unless_registered(monkeypatch):
    monkeypatch.delitem(appearances.APPEARANCES, NAME)
    with pytest.raises(ValueError, match=r"unknown appearance 'lamps'"):
        LilGymEnv(appearance=NAME)
