"""Mutation testing: breaks the functions that hold rules in a copy of the project, and checks that tests fail.

RULES names functions and the tests that should fail when one of them breaks. An operator, comparison or number in the
function's body is changed at a time. With LILGYM_DATA and LILGYM_GOLDEN, the tests include recorded behaviour.
Run from the root of a checkout: python -m tests.stress.broken_rules [--only rules.py:Dynamics.step] [--most 8]
"""

import argparse
import ast
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent
IGNORED = shutil.ignore_patterns(".*", "build", "dist", "*.egg-info")

PAIRS = (
    *((ast.Lt, ast.LtE), (ast.Gt, ast.GtE), (ast.Eq, ast.NotEq), (ast.Is, ast.IsNot), (ast.In, ast.NotIn)),
    *((ast.And, ast.Or), (ast.Add, ast.Sub), (ast.BitAnd, ast.BitOr)),
)
OPPOSITES = {**dict(PAIRS), **{second: first for first, second in PAIRS}}

# By file and function: the tests of which one must fail.
RULES = {
    "lilgym_mp/envs/rules.py:Dynamics.step": ("tests/test_rules.py",),
    "lilgym_mp/envs/rules.py:_step_result": ("tests/test_rules.py",),
    "lilgym_mp/scene/appearances/scatter/geometry.py:PlacementTables.closest": ("tests/appearances/test_scatter.py",),
    "lilgym_mp/scene/appearances/scatter/geometry.py:is_free": ("tests/appearances/test_scatter.py",),
    "lilgym_mp/scene/appearances/scatter/geometry.py:snapped": ("tests/appearances", "tests/fidelity"),
    "lilgym_mp/scene/appearances/scatter/cell_places.py:searched": ("tests/appearances",),
    "lilgym_mp/scene/appearances/scatter/cell_places.py:legal_edits": ("tests/appearances/test_masks.py",),
    "lilgym_mp/scene/appearances/tower/geometry.py:legal_by_heights": ("tests/appearances",),
    "lilgym_mp/envs/cores/scatter_kernels.py:_closest": ("tests/envs/test_cores.py",),
    "lilgym_mp/envs/cores/kernels.py:edit_tower_scenes": ("tests/envs/test_cores.py",),
    "lilgym_mp/envs/engine.py:Engine.step": ("tests/envs/test_batched.py",),
    "lilgym_mp/envs/engine.py:Engine._next_task": ("tests/envs/test_workers.py", "tests/envs/test_batched.py"),
    "lilgym_mp/programs/functions/items.py:_near_corner": ("tests/programs",),
    "lilgym_mp/programs/canonical.py:_compare_with_constant": ("tests/programs/test_canonical.py",),
    "lilgym_mp/envs/proposer_verifier/rewards.py:_correctness": ("tests/envs/proposer_verifier",),
    "lilgym_mp/learning/common/augmentation.py:recolourable": ("tests/test_augmentation.py",),
    "lilgym_mp/perception.py:_fewest": ("tests/test_perception.py",),
    "lilgym_mp/solver/tower_search.py:TowerSearch.solve": ("tests/solver",),
    "lilgym_mp/learning/common/update.py:policy_loss": ("tests/learning/ppo/test_update.py",),
    "lilgym_mp/learning/common/update.py:generalised_advantages": ("tests/learning/ppo/test_update.py",),
    "lilgym_mp/learning/game/rollout.py:own_turn_advantages": ("tests/learning/game/test_rollout.py",),
    "lilgym_mp/evaluation/results.py:summarise": ("tests/evaluation",),
    "lilgym_mp/contrib/report/aggregation.py:paired_difference": ("tests/report",),
    "wrappers/actions.py:Forcing.action_masks": ("tests/wrappers/test_stop_forcing.py",),
}


def function(tree, name):
    """The function or method of that name. Raises KeyError."""
    found = tree
    for part in name.split("."):
        defined = {each.name: each for each in found.body if isinstance(each, ast.ClassDef | ast.FunctionDef)}
        found = defined[part]
    return found


def mutants(source, name):
    """Describes each possible change of the function's body, and gives the source with it."""
    tree = ast.parse(source)
    body = function(tree, name).body
    changes = [change for statement in body for part in ast.walk(statement) for change in _changes(part)]
    for node, field, changed in changes:
        before, kept = ast.unparse(node), getattr(node, field)
        setattr(node, field, changed)
        yield f"line {node.lineno}: {before} -> {ast.unparse(node)}", ast.unparse(tree)
        setattr(node, field, kept)


def _changes(node):
    """The node, a field of it and another value of that, if it is one to change."""
    match node:
        case ast.Compare(ops=[operator, *others]) if type(operator) in OPPOSITES:
            yield node, "ops", [OPPOSITES[type(operator)](), *others]
        case ast.BoolOp() | ast.BinOp() if type(node.op) in OPPOSITES:
            yield node, "op", OPPOSITES[type(node.op)]()
        case ast.UnaryOp(op=ast.Not() | ast.Invert()):
            yield node, "op", ast.UAdd()
        case ast.Constant(value=bool(value)):
            yield node, "value", not value
        case ast.Constant(value=int(value)):
            yield node, "value", value + 1


def passes(copy, tests):
    """Whether all these tests pass in the copy."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-m", "not long", *tests]
    environment = {**os.environ, "PYTHONPATH": str(copy)}
    return subprocess.run(command, cwd=copy, env=environment, capture_output=True, check=False).returncode == 0


def main():
    """Prints each change and whether a test failed; the exit code is 1 if all passed in spite of one."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--only", default="", metavar="FILE:FUNCTION", help="part of the name of a rule")
    parser.add_argument("--most", type=int, default=3, metavar="N", help="changes of a function (default: 3)")
    args = parser.parse_args()
    missed = 0
    with tempfile.TemporaryDirectory() as directory:
        copy = shutil.copytree(ROOT, Path(directory) / "project", ignore=IGNORED, symlinks=True)
        for rule, tests in RULES.items():
            path, name = copy / rule.partition(":")[0], rule.partition(":")[2]
            original = path.read_text()
            made = list(mutants(original, name)) if args.only in rule else []
            for change, source in made[:: -(-len(made) // args.most) or 1]:
                path.write_text(source)
                is_missed = passes(copy, tests)
                missed += is_missed
                print(f"{rule}, {change}: {'NOT DETECTED' if is_missed else 'detected'}", flush=True)
            path.write_text(original)
    return int(missed > 0)


if __name__ == "__main__":
    raise SystemExit(main())
