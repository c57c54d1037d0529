"""Prints the size of the code, by package, and how much of it a few uses load.

`python scripts/print_closures.py [NAME ...]`: with names of USES, prints these alone. Sizes are in syntax nodes, which,
unlike lines, do not depend on the layout of the code.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGES = ("*.js", "*.css", "*.html")
ENV = "import gymnasium, lilgym_mp; env = gymnasium.make('lilgym_mp/{}-v0'); env.reset(seed=0); env.step(1)"
TRAINING = "import tempfile; from pathlib import Path; folder = tempfile.TemporaryDirectory(); {}"
USES = {
    "tower": ENV.format("TowerFlipIt"),
    "scatter": ENV.format("ScatterFlipIt"),
    "ppo": TRAINING.format(
        "from lilgym_mp.evaluation import Settings; from lilgym_mp.learning.ppo.learner import PPORecipe;"
        " from lilgym_mp.learning.ppo.training import train_ppo;"
        " recipe = PPORecipe.of('TowerFlipIt', envs=8, same_statement=8, rollout=64, batch_size=64);"
        " train_ppo(Settings('TowerFlipIt'), recipe, Path(folder.name) / 'run', steps=64)"
    ),
    "train ppo": TRAINING.format(
        "from lilgym_mp.cli import main;"
        " main('train ppo TowerFlipIt --steps 64 --envs 8 --same-statement 8 --rollout 64 --batch-size 64'.split()"
        " + ['--out', folder.name])"
    ),
}
SHOW = """
import sys
files = {getattr(module, "__file__", None) for name, module in sys.modules.items() if name.split(".")[0] == "lilgym_mp"}
print(*filter(None, files), sep=chr(10))
"""


def closure(use: str) -> set[Path]:
    """The package's modules that a fresh process has imported after one of USES."""
    done = subprocess.run(
        [sys.executable, "-c", f"{USES[use]}\nprint()\n{SHOW}"], check=True, stdout=subprocess.PIPE, text=True
    )
    return {Path(line).resolve() for line in done.stdout.rpartition("\n\n")[2].splitlines() if line.endswith(".py")}


def python_files(*folders: str) -> Iterator[Path]:
    """The Python files below folders of the checkout, without those behind the links of an editable install."""
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*.py")):
            if path.resolve() == path:
                yield path


def nodes(paths: Iterable[Path]) -> int:
    """The number of syntax nodes in Python files."""
    return sum(sum(1 for _ in ast.walk(ast.parse(path.read_bytes()))) for path in paths)


def lines(paths: Iterable[Path]) -> int:
    return sum(len(path.read_bytes().splitlines()) for path in paths)


def functions(paths: Iterable[Path]) -> int:
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef)
    return sum(sum(isinstance(each, kinds) for each in ast.walk(ast.parse(path.read_bytes()))) for path in paths)


def page_lines() -> int:
    """Lines of JavaScript, CSS and HTML of the browser and of the report."""
    return lines(path for pattern in PAGES for path in (ROOT / "lilgym_mp" / "contrib").rglob(pattern))


def data_lines() -> int:
    """Lines of TOML below `data`."""
    return lines((ROOT / "data").rglob("*.toml"))


def _packages() -> Iterator[tuple[str, list[Path]]]:
    yield "lilgym_mp", [path for path in python_files("lilgym_mp") if path.parent == ROOT / "lilgym_mp"]
    for folder in sorted({path.relative_to(ROOT).parts[1] for path in python_files("lilgym_mp")}):
        if (ROOT / "lilgym_mp" / folder).is_dir():
            yield f"lilgym_mp/{folder}", list(python_files(f"lilgym_mp/{folder}"))
    yield "wrappers", list(python_files("wrappers"))
    yield "package, in all", list(python_files("lilgym_mp", "wrappers"))
    yield "tests", list(python_files("tests"))


if __name__ == "__main__":
    if not sys.argv[1:]:
        print(f"{'':20} {'nodes':>8} {'lines':>8} {'functions':>10}")
        for name, paths in _packages():
            print(f"{name:20} {nodes(paths):8,} {lines(paths):8,} {functions(paths):10,}")
        print(f"JavaScript, CSS and HTML: {page_lines():,} lines; TOML in data: {data_lines():,} lines")
    for name in sys.argv[1:] or USES:
        modules = closure(name)
        print(f"{name}: {nodes(modules):,} nodes, {lines(modules):,} lines in {len(modules)} modules")
