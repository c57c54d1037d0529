"""Writes the builtin corpus for a hub of data sets: Parquet files, a dataset card, and nothing that must be executed.

    python scripts/write_hub_dataset.py build/hub

Needs pyarrow. `datasets.load_dataset("parquet", data_files=...)` reads the files without further code.
"""

from __future__ import annotations

import argparse
import json
import re
from pathlib import Path
from typing import Any

from lilgym_mp.corpus import load_all_tasks
from lilgym_mp.corpus.records import SPLITS
from lilgym_mp.corpus.writing import task_rows

ROOT = Path(__file__).resolve().parents[1]
DATASHEET = ROOT / "docs" / "datasheet.md"
_LINK_TO_PAGE = re.compile(r"\[([^\]]+)\]\((?!https?:)[^)]*\)")
JSON_COLUMNS = ("scene",)  # nested and of several lengths: kept as JSON text
HEAD = """---
license: mit
language: [en]
pretty_name: lilgym-mp builtin corpus
size_categories: [10K<n<100K]
task_categories: [visual-question-answering, reinforcement-learning]
configs:
- config_name: default
  data_files:
"""
COLUMNS = """
**Columns.** A row is a task: `id`, `appearance` (tower, scatter), `start` (scratch, flipit), `split`, `statement`,
`program` (its executable meaning), `target` (the truth value to reach) and the start `scene` as JSON.
"""


def card() -> str:
    """README.md of the data set: metadata for the hub, then the datasheet without links to other pages."""
    files = "".join(f"  - {{split: {split}, path: {split}.parquet}}\n" for split in SPLITS)
    text = _LINK_TO_PAGE.sub(r"\1", DATASHEET.read_text(encoding="utf-8"))
    return f"{HEAD}{files}---\n\n{text}{COLUMNS}"


def rows_by_split() -> dict[str, list[dict[str, Any]]]:
    """The tasks, with nested columns as JSON text."""
    found: dict[str, list[dict[str, Any]]] = {split: [] for split in SPLITS}
    for row in task_rows(load_all_tasks("builtin")):
        flat = {name: json.dumps(value) if name in JSON_COLUMNS else value for name, value in row.items()}
        found[str(row["split"])].append(flat)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("out", type=Path, metavar="DIRECTORY")
    out = parser.parse_args().out
    import pyarrow  # pyright: ignore[reportMissingImports]
    import pyarrow.parquet  # pyright: ignore[reportMissingImports]

    out.mkdir(parents=True, exist_ok=True)
    for split, rows in rows_by_split().items():
        pyarrow.parquet.write_table(pyarrow.Table.from_pylist(rows), out / f"{split}.parquet")
        print(f"{out / split}.parquet: {len(rows):,} tasks")
    (out / "README.md").write_text(card(), encoding="utf-8")


if __name__ == "__main__":
    main()
