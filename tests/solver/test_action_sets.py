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
from lilgym_mp.solver import Solver
from lilgym_mp.solver.action_sets import (
    LabelledState,
    Origin,
    action_set_arrays,
    explore,
    label,
    write_action_sets,
)
from tests.solver.tasks import mdp

APPEARANCES = ("tower", "scatter")


def read(path: Path) -> dict[str, Any]:
    with np.load(path) as arrays:
        return dict(arrays)


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
def test_file__describes_every_state(appearance: str, tmp_path: Path):
    states = explored(appearance, seed=5)
    for name in ("one.npz", "two.npz"):
        write_action_sets(tmp_path / name, states, mdp(appearance), {"seed": 5})
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()
    sets = read(tmp_path / "one.npz")
    about = json.loads(str(sets["about"]))
    assert (about["appearance"], about["rules"], about["version"], about["seed"]) == (appearance, "paper", 1, 5)
    items = np.split(sets["item"], sets["box_sizes"].ravel().cumsum()[:-1])
    for index, (state, found, origin) in enumerate(states):
        first, last = sets["action_starts"][index : index + 2].tolist()
        assert tuple(sets["action"][first:last].tolist()) == found.actions
        assert (sets["steps_to_go"][index], sets["complete"][index]) == (found.steps, found.complete)
        assert (sets["steps_taken"][index], sets["origin"][index]) == (state.steps, origin)
        task = sets["state_task"][index]
        assert (sets["task"][task], sets["program"][task]) == (state.task.id, state.task.program)
        assert (sets["statement"][task], sets["target"][task]) == (state.task.statement, state.task.target)
        boxes = [[tuple(item) for item in box.tolist()] for box in items[3 * index : 3 * index + 3]]
        assert boxes == [[tuple(item) for item in box.items] for box in state.scene.boxes]


def test_bad_input__is_named():
    with pytest.raises(ValueError, match=r"exploration must be a probability from 0 to 1, not 1\.5"):
        explored("tower", exploration=1.5)
    with pytest.raises(ValueError, match="repeats must be at least 1, not 0"):
        explored("tower", repeats=0)
    with pytest.raises(ValueError, match="jobs must be at least 1, not 0"):
        explored("tower", jobs=0)
    with pytest.raises(ValueError, match="at least one state"):
        action_set_arrays([])


@pytest.mark.parametrize("configuration", ["TowerScratch", "TowerFlipIt", "ScatterScratch", "ScatterFlipIt"])
def test_command__writes_sets(configuration: str, corpus: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    path = tmp_path / "sets.npz"
    command = ["demos", configuration, "--corpus", corpus, "--sets", "--out", str(path), "--jobs", "1", "--seed", "2"]
    assert main(command) == 0
    sets = read(path)
    assert f"{len(sets['complete']):,} states of {len(sets['task']):,} tasks" in capsys.readouterr().out
    about = json.loads(str(sets["about"]))
    assert about["settings"]["configuration"] == configuration
    assert (about["seed"], about["exploration"]) == (2, 0.25)


def test_command__refuses_options_that_do_not_apply_to_sets(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["demos", "TowerFlipIt", "--sets", "--images", "--out", str(tmp_path / "sets.npz")]) != 0
    assert "--sets needs --out and excludes" in capsys.readouterr().err
