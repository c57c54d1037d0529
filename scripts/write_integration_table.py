"""Writes the table of snippets in docs/integrations.md from examples/integrations, whose scripts say what they show.

Run: python scripts/write_integration_table.py
"""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[1]
SNIPPETS = ROOT / "examples" / "integrations"
PAGE = ROOT / "docs" / "integrations.md"
BEGIN, END = "<!-- snippets -->\n", "<!-- end of snippets -->\n"


class Snippet(NamedTuple):
    """A script that trains, evaluates, saves and loads with one library."""

    file: Path
    library: str
    cells: dict[str, tuple[str, str, str]]  # by kind of environment: masks, evaluation, normalisation
    switches: tuple[str, ...]  # ways to call it


def snippets() -> list[Snippet]:
    """The scripts of the folder that name a library, in order of their names. Imports none of them."""
    found: list[Snippet] = []
    for file in sorted(SNIPPETS.glob("*.py")):
        names: dict[str, Any] = {}
        for statement in ast.parse(file.read_text(encoding="utf-8")).body:
            if isinstance(statement, ast.Assign) and isinstance(target := statement.targets[0], ast.Name):
                names[target.id] = _value(statement.value, names)
        if "LIBRARY" in names:
            found.append(Snippet(file, names["LIBRARY"], names["CELLS"], names.get("SWITCHES", ("",))))
    return found


def _value(node: ast.expr, names: dict[str, Any]) -> Any:
    """The value of a literal, in which names stand for values assigned before; None if it is something else."""
    if isinstance(node, ast.Name):
        return names.get(node.id)
    if isinstance(node, ast.Dict):
        return {
            _value(key, names): _value(value, names) for key, value in zip(node.keys, node.values, strict=True) if key
        }
    if isinstance(node, ast.Tuple):
        return tuple(_value(part, names) for part in node.elts)
    return node.value if isinstance(node, ast.Constant) else None


def table() -> str:
    """The table: a row for each library and the kinds of environment that it treats alike."""
    rows = [
        "| library | environment | masks | evaluation | normalisation | snippet |",
        "|---|---|---|---|---|---|",
    ]
    for snippet in snippets():
        alike: dict[tuple[str, str, str], list[str]] = {}
        for kind, cell in snippet.cells.items():
            alike.setdefault(cell, []).append(kind)
        for cell, kinds in alike.items():
            rows.append(f"| {' | '.join((snippet.library, ', '.join(kinds), *cell, f'`{snippet.file.name}`'))} |")
    return "\n".join(rows) + "\n"


def main() -> None:
    head, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    _, _, tail = rest.partition(END)
    PAGE.write_text(f"{head}{BEGIN}\n{table()}\n{END}{tail}", encoding="utf-8")


if __name__ == "__main__":
    main()
