"""README's accuracies are those of the pages that have them with their commands."""

import csv
import re
from collections import defaultdict
from statistics import fmean

import pytest

from lilgym_mp.envs.registration import BUILTIN_CONFIGURATIONS
from tests.scripts import ROOT

TESTED = {  # runs with seed 0; rows of docs/test_split.md
    "ppo": "PPO with stop forcing, 1.5 million steps",
    "sb3": "MaskablePPO of SB3, 1.5 million steps",
    "imitation": "imitation",
    "reward-model": "[reward model](reward_model.md), 25,000 updates",
    "parse-and-plan-0": "parse and plan, 6,000 updates",
    "parse-and-plan": "parse and plan, included",
}

TABLE_2 = ("docs/results.md", "**Table 2.")  # a page, and a text before the table
TEST_SPLIT = ("docs/test_split.md", "Start scenes of test:")
SUMMARISED = {  # a row of README's table; the tested agent, or the row of Table 2, whose figures it has
    "PPO with stop forcing ²": "ppo",
    "... in Stable-Baselines3 ²": "sb3",
    "... three seeds": "4. ppo+sf",
    "proposer and verifier, three seeds ⁵": "17. proposer and verifier ⁴",
    "reward model, search ⁶": "reward-model",
    "imitation ⁶": "imitation",
    "parse and plan ⁶": "parse-and-plan-0",
    "parse and plan, included ⁶": "parse-and-plan",
}


def row(page, after, name):
    """The figures of a row of the first table after this text, without their deviations and intervals."""
    text = (ROOT / page).read_text()
    line = next(line for line in text[text.index(after) :].splitlines() if line.startswith(f"| {name} |"))
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    return [re.sub(r" [±(\[].*", "", cell).replace("–", "") for cell in cells[-4:]]


@pytest.mark.parametrize("name", SUMMARISED)
def test_readme__has_the_accuracies_of_the_pages(name):
    source = SUMMARISED[name]
    expected = row(*TEST_SPLIT, TESTED[source]) if source in TESTED else row(*TABLE_2, source)
    assert [cell.removesuffix(" ⁴") for cell in row("README.md", "## Results", name)] == expected


def test_readme__has_the_paper_s_best():
    networks = ("C3+BERT", "C10+BERT", "ViLT", "FLAVA")
    on_dev = (row(*TABLE_2, f"{learner} {network} †") for learner in ("PPO", "PPO+SF") for network in networks)
    tested = row(*TEST_SPLIT, "the paper's best of each configuration")
    best = [f"{max(cells, key=float)} / {on_test}" for *cells, on_test in zip(*on_dev, tested, strict=True)]
    assert row("README.md", "## Results", "the paper's best, sampled") == best


def outcomes(*rows):
    """The agent, actions, index of the configuration, and accuracy of these rows of outcomes.csv."""
    with (ROOT / "docs/results/outcomes.csv").open() as file:
        found = [each for each in csv.DictReader(file) if each["row"] in rows]
    assert {each["row"] for each in found} == {*rows}
    for each in found:
        share = fmean(map(int, each["successes"])) / int(each["episodes"])
        column = BUILTIN_CONFIGURATIONS.index(each["configuration"])
        yield each["run"], each["actions"], column, f"{100 * share:.1f}"


def test_test_split__dev_is_of_the_outcomes_of_the_tested_agents():
    for run, actions, column, accuracy in outcomes("tested"):
        name = next(name for start, name in TESTED.items() if run.startswith(start))
        cell = row(*TEST_SPLIT, name)[column]
        assert actions == "sampled" or cell.partition(" / ")[0] == accuracy, run


def test_stable_baselines3__accuracies_of_the_recipe_are_of_their_outcomes():
    cells = defaultdict(lambda: defaultdict(dict))
    for run, actions, column, accuracy in outcomes("sb3"):
        cells[column][run][actions] = accuracy
    page = (ROOT / "docs/stable_baselines3.md").read_text()
    for runs in cells.values():
        seeds = [f"{runs[run]['greedy']} / {runs[run]['sampled']}" for run in sorted(runs)]
        assert f"| {' | '.join(seeds)} |" in page


def test_agents__accuracies_of_the_included_agents_are_of_their_outcomes():
    cells = defaultdict(dict)
    for run, _, column, accuracy in outcomes("6", "7", "included"):
        appearance, is_flipit = divmod(column, 2)
        cells[run, appearance][is_flipit] = accuracy
    assert len(cells) == 6
    page = (ROOT / "docs/agents.md").read_text()
    for (run, _), pair in cells.items():
        assert f"| {pair[0]} / {pair[1]} |\n" in page, run
