"""How fast each form of a program computes truth values: the reference, generated Python, and instructions for batches.

Run: python benchmarks/program_forms.py [--corpus builtin]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from statistics import median
from typing import Any

import gymnasium as gym
import numpy as np

import lilgym_mp
from lilgym_mp.envs.cores.base import Core
from lilgym_mp.evaluation.terminal import table
from lilgym_mp.programs import Program
from lilgym_mp.scene import Scene

ENVS = 256
PASSES = 9


def fresh(scenes: Sequence[Scene]) -> list[Scene]:
    """The same scenes without anything memoised."""
    return [Scene.from_json(scene.to_json()) for scene in scenes]


def rate(use: Callable[[Any], object], count: int, arguments: Iterable[Any]) -> int:
    """Truth values per CPU second: the median over the arguments, with each of which `use` computes `count` of them."""
    rates: list[float] = []
    for argument in arguments:
        begun = time.process_time()
        use(argument)
        rates.append(count / (time.process_time() - begun))
    return round(median(rates))


def after_edits(envs: Any, rng: np.random.Generator) -> Iterator[None]:
    """Makes a random legal edit in every environment, PASSES times."""
    for _ in range(PASSES):
        masks = envs.action_masks()
        masks[:, 0] = ~masks[:, 1:].any(1)
        envs.step((rng.random(masks.shape) * masks).argmax(1))
        yield


def measure(configuration: str, corpus: str) -> tuple[object, ...]:
    envs: Any = gym.make_vec(f"lilgym_mp/{configuration}-v0", num_envs=ENVS, corpus=corpus).unwrapped
    envs.reset(seed=0)
    rng = np.random.default_rng(0)
    core: Core = envs._engine.core
    ids = np.arange(ENVS)
    core._solved(ids)  # compiles the programs to instructions
    instructions = rate(lambda _: core._solved(ids), ENVS, after_edits(envs, rng))
    in_batch = rate(lambda _: Core._solved(core, ids), ENVS, after_edits(envs, rng))
    states = envs.states()
    programs = [Program(state.task.program) for state in states]
    scenes = [state.scene for state in states]
    for program, scene in zip(programs, scenes, strict=True):
        program.evaluate(scene)  # generates code

    def evaluate(method: Callable[[Program, Scene], bool], copies: Sequence[Scene]) -> None:
        for program, scene in zip(programs, copies, strict=True):
            method(program, scene)

    copies = [fresh(scenes) for _ in range(2 * PASSES)]
    reference = rate(partial(evaluate, Program.evaluate_reference), ENVS, copies[:PASSES])
    generated = rate(partial(evaluate, Program.evaluate), ENVS, copies[PASSES:])
    return configuration, reference, generated, instructions, in_batch


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--corpus", default="builtin")
    args = parser.parse_args()
    header = ("truth values/s", "reference", "generated Python", "instructions, batch", "generated Python, batch")
    lines = [measure(name, args.corpus) for name in ("TowerFlipIt", "ScatterFlipIt")]
    print(
        f"lilgym_mp {lilgym_mp.__version__}, {ENVS} environments in the batch; an edit in each between two measurements"
    )
    print(table(header, lines))


if __name__ == "__main__":
    main()
