"""How fast each form of a program is: the reference, generated Python, and instructions in compiled code.

Each form serves, in a process of its own, everything: single truth values, single environments, batches, the expert and
the planning of parse-and-plan. Where a form does not support a program, the reference evaluator is used.

Run: python benchmarks/program_forms.py [--corpus builtin] [--tasks 40]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import product
from multiprocessing import get_context
from statistics import median
from typing import Any

import gymnasium as gym
import numpy as np

import lilgym_mp
from lilgym_mp.corpus import load_tasks
from lilgym_mp.envs.cores.base import Core
from lilgym_mp.envs.cores.compiled import item_code
from lilgym_mp.envs.cores.kernels import NO_ITEM, Programs, Scenes, evaluate_programs
from lilgym_mp.envs.cores.program_evaluator import ItemBoxLowering, StackBoxLowering
from lilgym_mp.envs.fast.box_functions import MAX_BOX_ITEMS
from lilgym_mp.envs.fast.code_generation import generate_function
from lilgym_mp.envs.fast.instructions import MAX_INSTRUCTIONS, instructions
from lilgym_mp.evaluation import Settings
from lilgym_mp.evaluation.terminal import table
from lilgym_mp.programs import Program
from lilgym_mp.programs.compiler import Truth, register_generator
from lilgym_mp.programs.errors import FallbackError
from lilgym_mp.programs.syntax import Node
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import BOX_COUNT, Box, Scene
from lilgym_mp.scene.appearances.tower.geometry import tower_tables
from lilgym_mp.solver import Solver

ENVS = 256
PASSES = 9
EPISODES = 60  # in a single environment
EDITS = 10  # in an episode
BUDGET = 3_000  # scenes that the expert may examine for a task
CONFIGURATIONS = ("TowerFlipIt", "ScatterFlipIt")
HEADER = ("form", "configuration", "truths/s", "steps/s, single", "steps/s, batch", "expert, tasks/s", "plans/s")


class SceneInstructions:
    """Generates functions of one scene that evaluate a program's instructions in compiled code."""

    def __init__(self, appearance: str) -> None:
        self._stacks: dict[Any, int] = {}
        if appearance == "tower":
            boxes = tower_tables().boxes
            self._boxes = StackBoxLowering(boxes)
            self._stacks = {box.items: stack for stack, box in enumerate(boxes)}
        else:
            self._boxes = ItemBoxLowering()
        self._scenes = Scenes(
            items=np.full((BOX_COUNT, MAX_BOX_ITEMS), NO_ITEM, np.int64),
            counts=np.zeros(BOX_COUNT, np.int64),
            versions=np.zeros(BOX_COUNT, np.int64),
            weighted=np.zeros((BOX_COUNT, 1, 1), np.uint8),
            images=np.zeros((1, 1), np.uint8),
            is_unfit=np.zeros(1, np.bool_),
        )
        self._stack_of_box = np.zeros(BOX_COUNT, np.int64)

    def __call__(self, tree: Node) -> Truth | None:
        written = instructions(tree, self._boxes.lower_box_function)
        if written is None:
            return None
        programs = Programs(
            np.array(written, np.int64), np.array([0, len(written)]), self._boxes.places, self._boxes.tables
        )
        first = np.zeros(1, np.int64)
        values = np.empty(MAX_INSTRUCTIONS, np.int64)
        found = np.empty(1, np.int64)

        def truth(scene: Scene) -> bool:
            for index, box in enumerate(scene.boxes):
                self._set_box(index, box)
            if evaluate_programs(programs, self._scenes, self._stack_of_box, first, first, values, found):
                raise FallbackError
            return bool(found[0])

        return truth

    def _set_box(self, index: int, box: Box) -> None:
        known = box.memo.get("row")
        if known is None:
            stack = self._stacks.get(box.items, -1)
            if len(box.items) > MAX_BOX_ITEMS or (self._stacks and stack < 0):
                raise FallbackError
            row = np.full(MAX_BOX_ITEMS, NO_ITEM, np.int64)
            row[: len(box.items)] = [item_code(item) for item in box.items]
            known = box.memo["row"] = row, len(box.items), stack
        self._scenes.items[index], self._scenes.counts[index], self._stack_of_box[index] = known


FORMS: dict[str, Callable[[str], Callable[[Node], Truth | None]]] = {
    "reference": lambda appearance: lambda tree: None,
    "generated Python": lambda appearance: generate_function,
    "instructions": SceneInstructions,
}


def rate(use: Callable[[Any], object], count: int, arguments: Iterable[Any]) -> float:
    """Results per CPU second: the median over the arguments, with each of which `use` computes `count` of them."""
    rates: list[float] = []
    for argument in arguments:
        begun = time.process_time()
        use(argument)
        rates.append(count / (time.process_time() - begun))
    return median(rates)


def truth_rate(tasks: Sequence[Task]) -> float:
    """Truth values of scenes that were not seen before."""
    programs = [Program(task.program) for task in tasks]
    for program, task in zip(programs, tasks, strict=True):
        program.evaluate(task.start)  # generates code

    def evaluate(scenes: Sequence[Scene]) -> None:
        for program, scene in zip(programs, scenes, strict=True):
            program.evaluate(scene)

    copies = ([Scene.from_json(task.start.to_json()) for task in tasks] for _ in range(PASSES))
    return rate(evaluate, len(tasks), copies)


def actions_of(envs: Any) -> list[Any]:
    """Random legal edits and a STOP, in each environment, from a reset with seed 0."""
    rng = np.random.default_rng(0)
    actions: list[Any] = []
    envs.reset(seed=0)
    for step in range(EDITS + 1):
        masks = np.atleast_2d(envs.action_masks())
        chances = rng.random(masks.shape) * masks
        chances[:, 0] = 2.0 if step == EDITS else 1e-9
        chosen = chances.argmax(1)
        actions.append(chosen if hasattr(envs, "num_envs") else int(chosen[0]))
        envs.step(actions[-1])
    return actions


def play(envs: Any, actions: Sequence[Any], goals: Callable[[], object]) -> None:
    """Takes the actions; at each step asks for the masks, and whether STOP would succeed, as stop forcing does."""
    envs.reset(seed=0)
    for action in actions:
        envs.action_masks()
        goals()
        envs.step(action)


def single_rate(configuration: str, corpus: str) -> float:
    """Steps in a single environment."""
    env: Any = gym.make(f"lilgym_mp/{configuration}-v0", corpus=corpus, disable_env_checker=True).unwrapped
    actions = actions_of(env)

    def episodes(_: object) -> None:
        for _ in range(EPISODES):
            play(env, actions, env.goal_reached)

    return rate(episodes, EPISODES * len(actions), range(PASSES))


def batch_rate(configuration: str, corpus: str, *, of_scenes: bool) -> float:
    """Steps in a batch; programs are given its arrays, or each a scene."""
    envs: Any = gym.make_vec(f"lilgym_mp/{configuration}-v0", num_envs=ENVS, corpus=corpus).unwrapped
    core: Any = envs._engine.core
    if of_scenes:
        core._solved = partial(Core._solved, core)
    actions = actions_of(envs)
    return rate(lambda _: play(envs, actions, core.write_goals), ENVS * len(actions), range(PASSES))


def expert_rate(configuration: str, tasks: Sequence[Task]) -> float:
    """Tasks for which the expert looks for a solution."""
    solver = Solver(Settings(configuration).dynamics(), BUDGET)
    return rate(lambda _: [solver.solve(task) for task in tasks], len(tasks), [None])


def plan_rate(configuration: str, corpus: str, tasks: Sequence[Task]) -> float:
    """Plans of the shipped parse-and-plan, of statements parsed before."""
    agent: Any = lilgym_mp.load_agent("parse-and-plan", "cpu")
    settings = Settings(configuration, corpus=corpus)
    planner = agent.planner(settings)
    for task in tasks:
        agent.parser.parse(task.statement, settings.dynamics().appearance.name)

    def plan(_: object) -> None:
        for task in tasks:
            planner.plan(task.start, task.statement, task.target)

    return rate(plan, len(tasks), [None])


def measure(form: str, configuration: str, corpus: str, count: int) -> tuple[str, ...]:
    appearance = Settings(configuration).dynamics().appearance.name
    register_generator(FORMS[form](appearance))
    tasks = load_tasks(corpus, appearance, "flipit", "train")
    tasks = tasks[:: len(tasks) // ENVS]
    few = tasks[:: len(tasks) // count]
    rates = (
        truth_rate(tasks),
        single_rate(configuration, corpus),
        batch_rate(configuration, corpus, of_scenes=form != "instructions"),
        expert_rate(configuration, few),
        plan_rate(configuration, corpus, few),
    )
    return form, configuration, *(f"{found:,.3g}" if found < 100 else f"{found:,.0f}" for found in rates)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--corpus", default="builtin")
    parser.add_argument("--tasks", type=int, default=40, help="for the expert and for planning")
    args = parser.parse_args()
    with ProcessPoolExecutor(1, get_context("spawn"), max_tasks_per_child=1) as pool:
        wanted = [
            pool.submit(measure, form, configuration, args.corpus, args.tasks)
            for configuration, form in product(CONFIGURATIONS, FORMS)
        ]
        lines = [each.result() for each in wanted]
    print(f"lilgym_mp {lilgym_mp.__version__}, {ENVS} environments in the batch, per CPU second")
    print(table(HEADER, lines))


if __name__ == "__main__":
    main()
