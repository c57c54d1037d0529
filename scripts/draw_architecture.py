"""Draws docs/pictures/architecture.svg, the import graph of the package's top-level parts.

The layers come from the import contract in pyproject.toml, the arrows from the import statements. Arrows implied by
others are left out, and so are arrows to the lowest layer, which every part may use, and upward, which the contract
names as exceptions. Numbers are thousands of lines.
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

from lilgym_mp.contrib.report.charts import new_figure, save

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = "lilgym_mp"
OUTSIDE = {"wrappers": ROOT / "wrappers", "data": ROOT / "data"}  # parts outside the package directory
WIDTH, ROW_HEIGHT = 1000, 75  # pixels
ASIDE = -0.12  # of the width: layers of one part stand left of the middle, where arrows between other layers pass


def layers() -> list[list[str]]:
    """The existing parts of each layer, highest layer first."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    rows = next(contract["layers"] for contract in contracts if contract["type"] == "layers")
    parts = (re.findall(r"\w+", row) for row in rows)
    existing = ([part for part in row if any(sources(part))] for row in parts)
    return [row for row in existing if row]


def sources(part: str) -> Iterator[Path]:
    """The files of a top-level module or package."""
    directory = OUTSIDE.get(part, ROOT / PACKAGE / part)
    module = ROOT / PACKAGE / f"{part}.py"
    if module.is_file():
        yield module
    yield from sorted(directory.rglob("*.py"))


def imported(part: str) -> set[str]:
    """The other parts that a part imports, at module level or inside functions."""
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


def dependencies(part: str, imports: Mapping[str, set[str]]) -> set[str]:
    """The parts that a part imports, directly or indirectly."""
    return imports[part].union(*(dependencies(other, imports) for other in imports[part]))


def draw() -> Any:
    """The figure of all layers."""
    rows = layers()
    figure = new_figure(WIDTH, ROW_HEIGHT * len(rows))
    axes: Any = figure.subplots()
    axes.set_axis_off()
    axes.set_xlim(0, 1)
    axes.set_ylim(0.5 - len(rows), 0.5)
    positions: dict[str, tuple[float, float]] = {}
    for level, row in enumerate(rows):
        aside = ASIDE if len(row) == 1 else 0.0
        positions |= {part: ((column + 1) / (len(row) + 1) + aside, -level) for column, part in enumerate(row)}
    boxes: dict[str, Any] = {}
    for part, (x, y) in positions.items():
        lines = sum(len(path.read_text().splitlines()) for path in sources(part))
        label = f"{part} {round(lines / 1000) or '<1'}"
        box = {"boxstyle": "round", "facecolor": "#e8eef7"}
        boxes[part] = axes.text(x, y, label, ha="center", va="center", bbox=box).get_bbox_patch()
    figure.draw_without_rendering()  # places the boxes, at which arrows end
    below = {part: {other for other, (_, y) in positions.items() if y <= positions[part][1]} for part in positions}
    imports = {part: imported(part) & (below[part] - set(rows[-1])) for part in positions}
    for part, place in positions.items():
        implied = set().union(*(dependencies(between, imports) for between in imports[part]))
        for other in sorted(imports[part] - implied):
            bend = "arc3,rad=0.2" if positions[other][1] == place[1] else "arc3"
            arrow = {"arrowstyle": "->", "color": "#8aa0bf", "connectionstyle": bend}
            ends = {"patchA": boxes[part], "patchB": boxes[other], "shrinkA": 0, "shrinkB": 2}
            axes.annotate("", xy=positions[other], xytext=place, arrowprops={**arrow, **ends})
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("out", type=Path, nargs="?", default=ROOT / "docs" / "pictures" / "architecture.svg")
    save(draw(), parser.parse_args().out, "svg")


if __name__ == "__main__":
    main()
