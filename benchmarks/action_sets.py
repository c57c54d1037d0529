"""CPU time on one core of sets of optimal first actions, and of plans for weighted goals.

States are like those a learner visits: train starts, and the results of up to six random legal edits. Each statement
is queried in many states, as in learning. Programs are compiled beforehand; everything else starts cold. The goals of
a plan are a dev program and eleven variants that differ in a word or a number.
Run: python benchmarks/action_sets.py --corpus lilgym
"""

from __future__ import annotations

import argparse
import random
import re
from collections.abc import Sequence
from time import process_time

import numpy as np

from lilgym_mp.appearances import make_appearance
from lilgym_mp.corpus import load_tasks
from lilgym_mp.programs import ProgramError, compile_program
from lilgym_mp.rules import Dynamics, State, make_dynamics
from lilgym_mp.solver import Solver, WeightedGoal

GOALS = 12
MOST_RANDOM_EDITS = 6
SWAPS = (
    ("==", ">="), (">=", "=="), ("is_blue", "is_black"), ("is_yellow", "is_blue"), ("is_black", "is_yellow"),
    ("Color.BLUE", "Color.BLACK"), ("Color.YELLOW", "Color.BLUE"), ("Color.BLACK", "Color.YELLOW"),
    ("is_circle", "is_square"), ("is_square", "is_triangle"), ("is_triangle", "is_circle"), ("is_top", "is_bottom"),
    ("is_bottom", "is_top"), ("is_touching_wall", "is_closely_touching_wall"), ("Side.LEFT", "Side.RIGHT"),
    ("is_closely_touching_wall", "is_touching_wall"), ("all_boxes", "filter_obj(all_boxes, lambda b: count(b) >= 1)"),
)  # fmt: skip


def states_of(dynamics: Dynamics, corpus: str, starts: Sequence[str], programs: int, count: int) -> list[State]:
    rng = random.Random(0)
    tasks = [task for start in starts for task in load_tasks(corpus, dynamics.appearance.name, start, "train")]
    every = list(dict.fromkeys(task.program for task in tasks))
    kept = set(rng.sample(every, min(programs, len(every))))
    tasks = [task for task in tasks if task.program in kept]
    found: list[State] = []
    for _ in range(count):
        state = dynamics.start(rng.choice(tasks))
        for _ in range(rng.randrange(MOST_RANDOM_EDITS + 1)):
            legal = dynamics.legal_mask(state).nonzero()[0][1:].tolist()
            state = dynamics.step(state, dynamics.appearance.decode(rng.choice(legal))).state
        found.append(state)
    return found


def time_sets(dynamics: Dynamics, states: Sequence[State]) -> str:
    for state in states:
        compile_program(state.task.program)
    begin = process_time()
    found = Solver(dynamics).optimal_sets(states)
    seconds = process_time() - begin
    complete = 100 * sum(one.complete for one in found) / len(found)
    size = sum(len(one.actions) for one in found) / len(found)
    return f"| {len(found):,} | {len(found) / seconds:,.0f} | {size:.1f} | {complete:.1f} % |"


def variant(program: str, rng: random.Random) -> str:
    numbers = list(re.finditer(r"(?<=[=<>] )\d+", program))
    found = [program.replace(old, new, 1) for old, new in SWAPS if old in program]
    for number, step in ((rng.choice(numbers), step) for step in (-1, 1) if numbers):
        found.append(program[: number.start()] + str(max(0, int(number[0]) + step)) + program[number.end() :])
    found += [f"({program}) and exist(all_items)", f"({program}) or False", f"not not ({program})"]
    chosen = rng.choice(found)
    try:
        compile_program(chosen)
    except ProgramError:
        return program
    return chosen


def goals_about(program: str, target: bool, rng: random.Random) -> list[WeightedGoal]:
    programs = [program]
    for _ in range(100):
        programs = list(dict.fromkeys([*programs, variant(rng.choice(programs[:4]), rng)]))[:GOALS]
    rng.shuffle(programs)
    weights = [0.5**place + 0.01 for place in range(len(programs))]
    return [WeightedGoal(one, target, weight / sum(weights)) for one, weight in zip(programs, weights, strict=True)]


def time_plans(dynamics: Dynamics, corpus: str, start: str, count: int) -> str:
    rng = random.Random(0)
    tasks = list(load_tasks(corpus, dynamics.appearance.name, start, "dev"))
    solver = Solver(dynamics)
    milliseconds: list[float] = []
    masses: list[float] = []
    for task in rng.sample(tasks, min(count, len(tasks))):
        goals = goals_about(task.program, task.target, rng)
        begin = process_time()
        plan = solver.plan_for(goals, task.start, dynamics.horizon - 1)
        milliseconds.append(1000 * (process_time() - begin))
        masses.append(plan.mass)
    median, most = np.percentile(milliseconds, (50, 90))
    return f"| {np.mean(milliseconds):.1f} | {median:.1f} | {most:.1f} | {np.mean(masses):.3f} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--corpus", default="builtin")
    parser.add_argument("--appearance", nargs="+", default=["tower", "scatter"])
    parser.add_argument("--states", type=int, default=3_000)
    parser.add_argument("--programs", type=int, default=150)
    parser.add_argument("--plans", type=int, default=100)
    given = parser.parse_args()
    for appearance in given.appearance:
        dynamics = make_dynamics(make_appearance(appearance, (19, 5)), "paper", 12)
        states = states_of(dynamics, given.corpus, ("scratch", "flipit"), given.programs, given.states)
        print(f"sets {appearance}: states, sets/s, actions per set, complete", time_sets(dynamics, states), flush=True)
        for start in ("scratch", "flipit"):
            row = time_plans(dynamics, given.corpus, start, given.plans)
            print(f"plans {appearance} {start}: mean ms, median, 90th percentile, mean mass", row, flush=True)


if __name__ == "__main__":
    main()
