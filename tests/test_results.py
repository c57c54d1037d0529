"""README's accuracies are those of the pages that have them with their commands."""

import re
from statistics import fmean

import pytest

from tests.scripts import ROOT

RESULTS = ("docs/results.md", "**Table 2.")
SUMMARISED = {  # a row of README's table; the place, and the row, of the same agent on dev and on test
    "the paper's best, sampled": (None, "the paper's best of each configuration"),
    "PPO with stop forcing ³": ((*RESULTS, "4. ppo+sf"), "PPO with stop forcing, 1.5 million steps"),
    "the same in Stable-Baselines3 ³": (None, "MaskablePPO of SB3, 1.5 million steps"),
    "proposer and verifier ⁶": ((*RESULTS, "17. proposer and verifier ⁴"), None),
    "reward model, search ⁷": (None, "[reward model](reward_model.md), 25,000 updates"),
    "imitation ⁷": ((*RESULTS, "3. imitation"), "imitation"),
    "parse and plan ⁷": (
        ("docs/agents.md", "| learns from |", "programs of official train statements, generated statements"),
        "parse and plan, 6,000 updates",
    ),
    "parse and plan, included ⁷": ((*RESULTS, "6. parse-and-plan, included"), "parse and plan, included"),
}


def row(page, after, name):
    """The figures of a row of the first table after this text, without their deviations and intervals."""
    text = (ROOT / page).read_text()
    line = next(line for line in text[text.index(after) :].splitlines() if line.startswith(f"| {name} |"))
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    return [re.sub(r" [±(\[].*", "", cell).replace("–", "") for cell in cells[-4:]]


@pytest.mark.parametrize("name", SUMMARISED)
def test_readme__has_the_accuracies_of_the_pages(name):
    dev, on_test = SUMMARISED[name]
    shown = [cell.partition("/") for cell in row("README.md", "## Results", name)]
    if dev is not None:
        assert [cell[0].strip(" ⁵") for cell in shown] == row(*dev)
    if on_test is not None:
        tested = row("docs/test_split.md", "Start scenes:", on_test)
        assert [cell[2].strip() for cell in shown] == tested


def test_readme__has_the_reward_models_accuracies_on_dev():
    page = (ROOT / "docs/reward_model.md").read_text()
    for cell in row("README.md", "## Results", "reward model, search ⁷"):
        assert f"| {cell.partition(' ')[0]} ± " in page


def test_readme__has_the_mean_of_the_greedy_accuracies_in_sb3():
    seeds = row("docs/stable_baselines3.md", "| recipe, TowerScratch |", "recipe, TowerScratch")
    greedy = [float(cell.partition(" ")[0]) for cell in seeds[-3:]]
    shown = row("README.md", "## Results", "the same in Stable-Baselines3 ³")
    assert shown[0].startswith(f"{fmean(greedy):.1f} / ")
