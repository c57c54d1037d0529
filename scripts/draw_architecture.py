"""Draws docs/pictures/architecture.svg: the package's parts in their layers, and which imports which.

The layers are those of the import contract in pyproject.toml, the arrows are the import statements of the sources.
An arrow is left out where others lead the same way, or to the lowest layer, which all parts may use.
Run: python scripts/draw_architecture.py [OUT.svg]
"""

from __future__ import annotations

import argparse
import ast
import re
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from lilgym_mp.plotting import new_figure, save

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = "lilgym_mp"
OUTSIDE = {"wrappers": ROOT / "wrappers", "data": ROOT / "data"}  # parts that lie beside the package
WIDTH, ROW_HEIGHT = 1000, 90  # pixels


def layers() -> list[list[str]]:
    """The parts of each layer that exist, from the highest layer down."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    rows = next(contract["layers"] for contract in contracts if contract["type"] == "layers")
    named = (re.findall(r"\w+", row) for row in rows)
    existing = ([part for part in row if any(True for _ in sources(part))] for row in named)
    return [row for row in existing if row]


def sources(part: str) -> Iterator[Path]:
    """The files of a top-level module or package."""
    directory = OUTSIDE.get(part, ROOT / PACKAGE / part)
    module = ROOT / PACKAGE / f"{part}.py"
    if module.is_file():
        yield module
    yield from sorted(directory.rglob("*.py"))


def imported(part: str) -> set[str]:
    """The other parts that a part imports, lazily or not, but not for type checking alone."""
    found: set[str] = set()
    for path in sources(part):
        for node in ast.walk(ast.parse(path.read_text())):
            names: list[str] = []
            if isinstance(node, ast.ImportFrom) and node.module:
                names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            elif isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            found |= {name.split(".")[1] for name in names if name.startswith(f"{PACKAGE}.")}
    return found - {part}


def reached(part: str, imports: Mapping[str, set[str]]) -> set[str]:
    """The parts that a part needs, by others if not by itself."""
    return imports[part].union(*(reached(other, imports) for other in imports[part]))


def drawn() -> Any:
    """The figure."""
    rows = layers()
    figure = new_figure(WIDTH, ROW_HEIGHT * len(rows))
    axes: Any = figure.subplots()
    axes.set_axis_off()
    places: dict[str, tuple[float, float]] = {}
    for level, row in enumerate(rows):
        places |= {part: ((column + 1) / (len(row) + 1), -level) for column, part in enumerate(row)}
    imports = {part: imported(part) & (places.keys() - set(rows[-1])) for part in places}
    for part, (x, y) in places.items():
        for other in imports[part] - set().union(*(reached(between, imports) for between in imports[part])):
            bend = "arc3,rad=0.2" if places[other][1] == y else "arc3"
            arrow = {"arrowstyle": "->", "color": "#8aa0bf", "shrinkB": 14, "connectionstyle": bend}
            axes.annotate("", xy=places[other], xytext=(x, y), arrowprops=arrow)
        axes.text(x, y, part, ha="center", va="center", bbox={"boxstyle": "round", "facecolor": "#e8eef7"})
    axes.set_xlim(0, 1)
    axes.set_ylim(0.5 - len(rows), 0.5)
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("out", type=Path, nargs="?", default=ROOT / "docs" / "pictures" / "architecture.svg")
    save(drawn(), parser.parse_args().out, "svg")


if __name__ == "__main__":
    main()
