"""Labelled states: reproducible, and preserved by writing and reading a file."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lilgym_mp.cli import main
from lilgym_mp.corpus import load_tasks
from lilgym_mp.observation import item_array
from lilgym_mp.solver import Solver
from lilgym_mp.solver.action_sets import (
    ActionSetFileError,
    ActionSets,
    LabelledState,
    Origin,
    explore,
    label,
    load_action_sets,
    pack_action_sets,
    write_action_sets,
)
from tests.solver.tasks import mdp

APPEARANCES = ("tower", "scatter")
ARRAYS = [name for name in ActionSets.__dataclass_fields__ if name != "about"]


def explored(appearance: str, **options: Any) -> list[LabelledState]:
    return explore(load_tasks("builtin", appearance, "flipit", "dev")[:8], mdp(appearance), **options)


@pytest.mark.parametrize("appearance", APPEARANCES)
def test_explore__consecutive_states_are_linked_by_legal_actions(appearance: str):
    dynamics = mdp(appearance)
    found = explored(appearance, exploration=0.5, seed=3)
    solver = Solver(dynamics)
    assert sum(origin is Origin.START for _, _, origin in found) == 8
    for before, after in itertools.pairwise(found):
        assert after.found == solver.optimal_actions(after.state)
        if after.origin is Origin.PATH:
            legal = dynamics.legal_mask(before.state).nonzero()[0].tolist()
            reached = (dynamics.step(before.state, dynamics.appearance.decode(action)).state for action in legal)
            assert any(state == after.state for state in reached)


@pytest.mark.parametrize("appearance", APPEARANCES)
def test_explore__without_exploration_follows_shortest_solutions(appearance: str):
    found = explored(appearance, exploration=0.0)
    for before, after in itertools.pairwise(found):
        if after.origin is Origin.PATH:
            assert after.found.steps == before.found.steps - 1
        else:
            assert before.found.steps == 1


def test_explore__depends_on_the_seed_but_not_on_the_number_of_processes():
    assert explored("scatter", seed=1, repeats=2) == explored("scatter", seed=1, repeats=2, jobs=2)
    assert explored("scatter", seed=1) != explored("scatter", seed=2)


@pytest.mark.parametrize("appearance", APPEARANCES)
def test_label__gives_each_state_its_optimal_actions(appearance: str):
    states = [state for state, _, _ in explored(appearance)]
    found = label(states, mdp(appearance))
    solver = Solver(mdp(appearance))
    assert found == [LabelledState(state, solver.optimal_actions(state), Origin.GIVEN) for state in states]


@pytest.mark.parametrize("appearance", APPEARANCES)
def test_file__preserves_what_was_written(appearance: str, tmp_path: Path):
    dynamics = mdp(appearance)
    states = explored(appearance, seed=5)
    sets = pack_action_sets(states, dynamics, {"corpus_sha256": "abc"})
    write_action_sets(tmp_path / "sets.npz", sets)
    read = load_action_sets(tmp_path / "sets.npz", corpus_sha256="abc")
    assert read.about == sets.about
    assert (read.about["appearance"], read.about["rules"], read.about["version"]) == (appearance, "paper", 1)
    for name in ARRAYS:
        assert np.array_equal(getattr(read, name), getattr(sets, name)), name
    assert read.scenes() == [state.scene for state, _, _ in states]
    capacity = int(read.box_sizes.max()) + 2
    assert np.array_equal(read.items(capacity), [item_array(state.scene, capacity) for state, _, _ in states])
    for index, (state, found, origin) in enumerate(states):
        first, last = read.action_starts[index : index + 2].tolist()
        assert tuple(read.action[first:last].tolist()) == found.actions
        assert (read.steps_to_go[index], read.complete[index]) == (found.steps, found.complete)
        assert (read.steps_taken[index], read.origin[index]) == (state.steps, origin)
        task = read.state_task[index]
        assert (read.task[task], read.program[task]) == (state.task.id, state.task.program)
        assert (read.statement[task], read.target[task]) == (state.task.statement, state.task.target)


def test_file__is_reproducible(tmp_path: Path):
    sets = pack_action_sets(explored("tower"), mdp("tower"), {})
    for name in ("one.npz", "two.npz"):
        write_action_sets(tmp_path / name, sets)
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_file__that_is_truncated_is_refused(share: float, tmp_path: Path):
    path = tmp_path / "sets.npz"
    write_action_sets(path, pack_action_sets(explored("tower"), mdp("tower"), {}))
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(ActionSetFileError, match=r"sets\.npz is not an npz file, or is truncated"):
        load_action_sets(path)


def test_file__with_another_corpus_version_or_format_is_refused(tmp_path: Path):
    path = tmp_path / "sets.npz"
    sets = pack_action_sets(explored("tower"), mdp("tower"), {"corpus_sha256": "abc"})
    write_action_sets(path, sets)
    with pytest.raises(ActionSetFileError, match="comes from the corpus with checksum abc, not xyz"):
        load_action_sets(path, corpus_sha256="xyz")
    arrays = {name: getattr(sets, name) for name in ARRAYS}
    np.savez(path, about=np.array(json.dumps({**sets.about, "version": 99})), **arrays)
    with pytest.raises(ActionSetFileError, match="has version 99; this package reads version 1"):
        load_action_sets(path)
    np.savez(path, about=np.array(json.dumps(sets.about)), **{**arrays, "action_starts": sets.action_starts[:-1]})
    with pytest.raises(ActionSetFileError, match="arrays are inconsistent"):
        load_action_sets(path)
    np.savez(path, about=np.array(json.dumps(sets.about)), **{**arrays, "action": sets.action.astype(np.float32)})
    with pytest.raises(ActionSetFileError, match="action must have 1 axes of i4"):
        load_action_sets(path)
    np.savez(path, about=np.array("{}"))
    with pytest.raises(ActionSetFileError, match="does not contain action sets"):
        load_action_sets(path)
    with pytest.raises(FileNotFoundError):
        load_action_sets(tmp_path / "nowhere.npz")


def test_items__refuse_a_capacity_that_is_too_small():
    sets = pack_action_sets(explored("tower"), mdp("tower"), {})
    with pytest.raises(ValueError, match="a capacity of 0 is too small"):
        sets.items(0)


def test_bad_input__is_named():
    with pytest.raises(ValueError, match=r"exploration must be a probability from 0 to 1, not 1\.5"):
        explored("tower", exploration=1.5)
    with pytest.raises(ValueError, match="repeats must be at least 1, not 0"):
        explored("tower", repeats=0)
    with pytest.raises(ValueError, match="jobs must be at least 1, not 0"):
        explored("tower", jobs=0)
    with pytest.raises(ValueError, match="at least one state"):
        pack_action_sets([], mdp("tower"), {})


@pytest.mark.parametrize("configuration", ["TowerScratch", "TowerFlipIt", "ScatterScratch", "ScatterFlipIt"])
def test_command__writes_sets(configuration: str, corpus: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    path = tmp_path / "sets.npz"
    command = ["demos", configuration, "--corpus", corpus, "--sets", "--out", str(path), "--jobs", "1", "--seed", "2"]
    assert main(command) == 0
    read = load_action_sets(path)
    assert f"{len(read):,} states of {len(read.task):,} tasks" in capsys.readouterr().out
    assert read.about["settings"]["configuration"] == configuration
    assert (read.about["seed"], read.about["exploration"]) == (2, 0.25)


def test_command__refuses_options_that_do_not_apply_to_sets(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["demos", "TowerFlipIt", "--sets", "--images", "--out", str(tmp_path / "sets.npz")]) != 0
    assert "--sets needs --out and excludes" in capsys.readouterr().err
