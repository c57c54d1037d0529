"""The expert: shortest solutions of tasks, over the rules and programs alone.

`Solver(dynamics).solve(task)` plans from a start, `solve_from(state)` from anywhere, `optimal_actions(state)` gives
the good first actions; `Expert(env).act()` follows an environment. docs/solver.md tells how, and how well.
"""

from lilgym_mp.solver.expert import Expert
from lilgym_mp.solver.solution import ActionSet, Solution, Status
from lilgym_mp.solver.solving import Solver
from lilgym_mp.solver.weighted import WeightedGoal, WeightedPlan

__all__ = ["ActionSet", "Expert", "Solution", "Solver", "Status", "WeightedGoal", "WeightedPlan"]
