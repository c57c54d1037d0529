"""Each cell of the table of other libraries is a script that trains, evaluates, saves and loads."""

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.scripts import load_script

ROOT = Path(__file__).parents[1]
SNIPPETS = load_script("write_integration_table")
NEEDS = {  # modules, by the beginning of a script's name
    "agilerl": ("agilerl",),
    "gymnasium": ("torch",),
    "rllib": ("ray", "pettingzoo"),
    "sb3": ("sb3_contrib",),
    "skrl": ("skrl",),
    "supersuit": ("supersuit", "stable_baselines3"),
    "tianshou": ("tianshou",),
    "torchrl": ("torchrl", "pettingzoo"),
}
TIMEOUT_SECONDS = 600
QUICK = ("gymnasium_pytorch single", "sb3_models batched --masks")  # the others are long
CELLS = [
    f"{snippet.file.stem} {kind} {switch}".strip()
    for snippet in SNIPPETS.snippets()
    for kind in snippet.cells
    for switch in snippet.switches
]


@pytest.mark.parametrize(
    "cell", [cell if cell in QUICK else pytest.param(cell, marks=pytest.mark.long) for cell in CELLS]
)
def test_cell__trains_evaluates_saves_and_loads(cell, tmp_path):
    name, *words = cell.split()
    for module in NEEDS[name.partition("_")[0]]:
        if importlib.util.find_spec(module) is None:
            pytest.skip(f"{module} is not installed")
    done = subprocess.run(
        [sys.executable, ROOT / "examples" / "integrations" / f"{name}.py", *words],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT), "RAY_USAGE_STATS_ENABLED": "0"},
        capture_output=True,
        text=True,
        timeout=TIMEOUT_SECONDS,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr[-3000:]
    assert re.search(rf"^{words[0]}: .*saved and loaded$", done.stdout, re.MULTILINE), done.stdout


def test_table__is_that_of_the_snippets():
    page = SNIPPETS.PAGE.read_text()
    shown = page.partition(SNIPPETS.BEGIN)[2].partition(SNIPPETS.END)[0].strip()
    assert shown == SNIPPETS.table().strip(), "run scripts/write_integration_table.py"
    rows = re.findall(r"^\| (.*) \| `(\S+)` \|$", shown, re.MULTILINE)
    assert len(rows) >= 8
    assert [name for _, name in rows if not (SNIPPETS.SNIPPETS / name).exists()] == []
    assert [row for row, _ in rows if "" in map(str.strip, row.split(" | "))] == []
