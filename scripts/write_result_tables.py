"""Write the tables of docs/results.md from the CSV files in docs/results.

A table follows a line `<!-- NAME.csv: N -->`, where N columns hold text. Run after a change of the files.
"""

from __future__ import annotations

import csv
import re
from pathlib import Path

PAGE = Path(__file__).resolve().parents[1] / "docs" / "results.md"
TABLE = re.compile(r"<!-- (?P<name>\w+)\.csv: (?P<texts>\d) -->\n\n(?:\|.*\n)*")  # how many columns hold text


def text(page: str) -> str:
    """The page with its tables made anew."""
    return TABLE.sub(_table, page)


def _table(match: re.Match[str]) -> str:
    with (PAGE.parent / "results" / f"{match['name']}.csv").open(encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    texts = int(match["texts"])
    rule = ["---"] * texts + ["---:"] * (len(head) - texts)
    lines = [f"| {' | '.join(row)} |\n" for row in (head, rule, *rows)]
    return match[0].split("\n", 1)[0] + "\n\n" + "".join(lines)


if __name__ == "__main__":
    PAGE.write_text(text(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
