"""The expert: shortest solutions of tasks.

`Solver(dynamics).solve(task)` solves a task from its start, `solve_from(state)` from any state, and
`optimal_actions(state)` returns the first actions of shortest solutions. `Expert(env).act()` plays an environment.
docs/solver.md describes the algorithm and its results. The modules:

    solver, solution         entry point, results and their values
    weighted_goals           plans for several uncertain goals
    layered_search           breadth-first layers of a box, and search over scenes from those of each box
    tower_search             exact search for Tower
    scatter_search           search for Scatter: abstract scenes first, then refinement
    box_classes              which boxes are interchangeable for a program
    class_search             search over box classes instead of boxes
    program_features         static analysis: which features of items a program depends on
    canonical_items          one item for each class that item tests can distinguish
    abstraction              Scatter boxes without geometry
    refinement               edits that realise abstract edits under the exact rules
    pruned_layers            edits and signatures for Scatter programs that relate items
    first_actions            all optimal first actions in Scatter
    box_editor, edit_tables  single edits of a Scatter box, and all of them at once as arrays
    expert                   plays the solver's solutions in an environment
"""

from lilgym_mp.solver.expert import Expert
from lilgym_mp.solver.solution import ActionSet, Solution, Status
from lilgym_mp.solver.solver import Solver
from lilgym_mp.solver.weighted_goals import WeightedGoal, WeightedPlan
from lilgym_mp.submodules import submodule_getter

__all__ = ["ActionSet", "Expert", "Solution", "Solver", "Status", "WeightedGoal", "WeightedPlan"]

__getattr__ = submodule_getter(__name__)
