"""Summaries of solved tasks, and tasks of the official corpus."""

import pytest

from lilgym_mp.cli.solve import TaskReport, summarise, summary_rows
from lilgym_mp.corpus import load_tasks
from lilgym_mp.envs.rules import Outcome
from lilgym_mp.solver import Solver, Status
from lilgym_mp.solver.solution import Solution
from tests.solver.tasks import mdp, played, task

SOLVED = Solution(Status.SOLVED, (), 0, 7)
UNSOLVABLE = Solution(Status.UNSOLVABLE, (), 12, 9, "no scene has that value")


def test_summary__excludes_unsolvable_tasks_from_the_share():
    one = task("True")
    summary = summarise([TaskReport(one, SOLVED, 0.0015), TaskReport(one, UNSOLVABLE, 0.0045)])
    (row,) = summary_rows({"TowerFlipIt dev": summary})
    assert row == ("TowerFlipIt dev", "2", "1 (100.00 %)", "0", "1", "0", "0.00", "0", "3.00", "3.00")


@pytest.mark.parametrize(("appearance", "rules"), [("tower", "release"), ("scatter", "paper"), ("scatter", "release")])
def test_official_tasks__are_solved_and_proven_shortest(appearance, rules, official_data):
    dynamics = mdp(appearance, rules)
    solver = Solver(dynamics)
    for given in load_tasks("lilgym", appearance, "flipit", "dev")[::20]:
        solution = solver.solve(given)
        assert solution.proven_optimal, given.id
        assert played(dynamics, dynamics.start(given), solution.actions).outcome is Outcome.SUCCESS
