"""The core plays without numba and without generated code, which load only where they are of use."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.scripts import load_script

BLOCKED = """
import sys
for name in ("numba", "lilgym_mp.envs.fast"):
    sys.modules[name] = None  # importing it fails
"""
PLAY = """
import gymnasium, lilgym_mp
for configuration in ("TowerFlipIt", "ScatterFlipIt"):
    env = gymnasium.make(f"lilgym_mp/{configuration}-v0", split="dev")
    env.reset(seed=0)
    for episode in range(12):
        env.reset(options=dict(task=env.unwrapped.tasks.ids[0]))
        env.step(int(env.unwrapped.action_masks().nonzero()[0][-1]))
        goal = env.unwrapped.goal_reached()
        _, reward, terminated, *_ = env.step(0)
        assert terminated and reward == (1 if goal else -1)
"""
EVALUATE = """
import sys
from lilgym_mp.programs import Program
from lilgym_mp.scene import Scene
program = Program("exist(all_items)")
for is_loaded in (False, False, True, True):
    assert not program(Scene.of((), (), ()))
    assert ("lilgym_mp.envs.fast.code_generation" in sys.modules) == is_loaded
"""


def run(code: str) -> str:
    """What it prints on stderr."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stderr


def test_core__plays_without_numba_and_without_generated_code():
    assert run(BLOCKED + PLAY).count("RuntimeWarning: programs are evaluated slowly") == 1


def test_program__has_code_generated_only_once_it_is_evaluated_often():
    run(EVALUATE)


@pytest.mark.parametrize(("use", "limit"), [("scatter", 6_000), pytest.param("ppo", 16_000, marks=pytest.mark.long)])
def test_package__loads_few_lines_for_a_use(use: str, limit: int):
    lines, _ = load_script("print_closures").closure(use)
    assert lines <= limit
