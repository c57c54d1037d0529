"""`lilgym-mp solve`."""

import pytest

from lilgym_mp.corpus import load_tasks
from lilgym_mp.envs.rules import make_dynamics
from lilgym_mp.scene.actions import describe
from lilgym_mp.scene.appearances import make_appearance
from lilgym_mp.solver import Solver
from tests.command_line import error_of, lilgym, output_of, succeeds
from tests.json_files import read_json


def test_solve__prints_shares_and_writes_solutions(corpus, tmp_path, capsys):
    out = tmp_path / "solutions.json"
    succeeds("solve --corpus", corpus, "--out", out)
    printed = capsys.readouterr()
    assert f"corpus {corpus}, rules paper, horizon 12, grid 19x5" in printed.out
    for name, count in (("TowerScratch dev", 3), ("ScatterFlipIt dev", 9)):
        assert f"{name} {count} {count} (100.00 %) {count} " in " ".join(printed.out.split())
        assert f"{count} of {count} tasks of {name}" in printed.err
    data = read_json(out)
    assert data["summaries"]["ScatterFlipIt dev"]["solved"] == 9
    assert {(record["status"], record["actions"][-1]) for record in data["tasks"]} == {("solved", 0)}


def test_solve__limits_the_number_of_tasks(corpus, capsys):
    printed = output_of(capsys, "solve TowerFlipIt --split dev train --episodes 2 --corpus", corpus)
    assert "TowerFlipIt train 2 2 (100.00 %) 2 " in " ".join(printed.split())


def test_solve__lists_tasks_without_solution(corpus, capsys):
    printed = output_of(capsys, "solve TowerScratch --horizon 1 --corpus", corpus)
    assert "unsolvable, no scene within 0 edits has that value" in printed


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--budget 0", "budget must be a positive whole number of scenes"),
        ("--episodes 0", "--episodes must be at least 1, not 0"),
        ("--horizon 0", "horizon must be a positive whole number"),
        ("--corpus nowhere.jsonl", "nowhere.jsonl"),
        ("Sideways", "unknown configuration 'Sideways'"),
        ("TowerFlipIt --show", "--show needs --task ID"),
        ("--task 1", "--task needs exactly one CONFIGURATION"),
        ("TowerFlipIt --task 1 --episodes 3", "--task excludes"),
        ("TowerFlipIt --task none-such", "no task 'none-such'"),
    ],
)
def test_solve__names_the_mistake(options, message, capsys):
    assert lilgym(f"solve {options}") == 2
    printed = capsys.readouterr()
    assert message in printed.err
    assert printed.out == ""


def test_solve__shows_single_tasks_action_by_action(corpus, capsys):
    task, *_ = load_tasks(corpus, "scatter", "flipit", "dev")
    printed = output_of(capsys, "solve ScatterFlipIt --show --task", task.id, "--corpus", corpus)
    solution = Solver(make_dynamics(make_appearance("scatter"))).solve(task)
    assert task.statement in printed
    assert task.program in printed
    for number, action in enumerate(solution.actions, 1):
        assert f"  {number}. {describe(action)}: reward" in printed
    assert printed.count("+--------------------+  +") == 2 * solution.steps


def test_task__is_found_in_its_split(capsys):
    command = "solve TowerScratch --task tower-train-005"
    assert "tower-train-005: make" in output_of(capsys, command)
    assert "no task 'tower-train-005'" in error_of(capsys, f"{command} --split dev")
