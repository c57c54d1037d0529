"""The expert: shortest solutions of tasks.

`Solver(dynamics).solve(task)` solves a task from its start, `solve_from(state)` from any state, and
`optimal_actions(state)` gives the first actions of shortest solutions. `Expert(env).act()` plays an environment.
docs/solver.md describes the algorithm and its results. The modules:

    solver             entry point: `Solver`                solution          its results
    tower_search       search for one appearance            scatter_search
    layered_search     breadth-first search over scenes by the layers of each box
    box_classes        boxes that are interchangeable       class_search      search over such classes
    program_features   what a program depends on            canonical_items   one item for each that tests tell apart
    abstraction        Scatter boxes without geometry       refinement        from abstract edits to actions
    box_editor         single edits of a Scatter box        edit_tables       all edits of a box at once
    pruned_layers      heuristic search in Scatter          first_actions     all optimal first actions in Scatter
    goals              goals as programs with targets       weighted_goals    plans for several uncertain goals
    expert, value, curriculum, demonstrations, minari_dataset, action_sets, reports, tower_boxes   applications
"""

from lilgym_mp.solver.expert import Expert
from lilgym_mp.solver.solution import ActionSet, Solution, Status
from lilgym_mp.solver.solver import Solver
from lilgym_mp.solver.weighted_goals import WeightedGoal, WeightedPlan

__all__ = ["ActionSet", "Expert", "Solution", "Solver", "Status", "WeightedGoal", "WeightedPlan"]
