"""Each cell of the table of other libraries is a script that trains, evaluates, saves and loads."""

import re
import runpy
import sys

import pytest

from tests.scripts import load_script, needs

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
CELLS = [  # each kind with one of the switches
    f"{snippet.file.stem} {kind} {snippet.switches[index % len(snippet.switches)]}".strip()
    for snippet in SNIPPETS.snippets()
    for index, kind in enumerate(snippet.cells)
]


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")  # of the libraries
@pytest.mark.parametrize("cell", CELLS)
def test_cell__trains_evaluates_saves_and_loads(cell, tmp_path, monkeypatch, capsys):
    name, *words = cell.split()
    needs(*NEEDS[name.partition("_")[0]])
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(SNIPPETS.SNIPPETS)
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    monkeypatch.setattr(sys, "argv", [name, *words])
    runpy.run_path(str(SNIPPETS.SNIPPETS / f"{name}.py"), run_name="__main__")
    assert re.search(rf"^{words[0]}: .*saved and loaded$", capsys.readouterr().out, re.MULTILINE)


def test_table__is_that_of_the_snippets():
    page = SNIPPETS.PAGE.read_text()
    shown = page.partition(SNIPPETS.BEGIN)[2].partition(SNIPPETS.END)[0].strip()
    assert shown == SNIPPETS.table().strip(), "run scripts/write_integration_table.py"
    assert shown.count("\n") > 8
    assert "|  |" not in shown, "an empty cell"
