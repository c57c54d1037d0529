"""Figures of the documents that can be computed in seconds are what the files, recipes and corpora say."""

from __future__ import annotations

import gzip
import importlib.util
import json
import re
import statistics
from collections import Counter
from pathlib import Path

import pytest

from lilgym_mp.cli.experiment_plan import read_plan
from lilgym_mp.corpus import load_tasks
from lilgym_mp.evaluation.comparison import EvaluationPlan, play
from lilgym_mp.evaluation.policies import NamedPolicy, built_in_policy
from lilgym_mp.evaluation.settings import CONFIGURATIONS, Settings
from lilgym_mp.learning.model_file import read_description
from lilgym_mp.learning.parsing.recipe import ParserRecipe
from lilgym_mp.report.learning_curves import MEANS, caption
from lilgym_mp.report.report_data import TrainingCurve

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"


def flat(name: str) -> str:
    """A document's text without line breaks."""
    return " ".join((DOCS / name).read_text(encoding="utf-8").split())


def table_rows(text: str) -> list[list[str]]:
    lines = (line.strip("|").split("|") for line in text.splitlines() if line.startswith("|"))
    return [[" ".join(cell.split()) for cell in line] for line in lines]


def numbers(cell: str) -> list[float]:
    return [float(number) for number in re.findall(r"\d+\.\d+", cell)]


def results_page() -> str:
    return (DOCS / "results.md").read_text(encoding="utf-8")


def accuracies() -> dict[tuple[str, str], list[str]]:
    """Table 2 of the results page: by agent and actions, dev accuracies of the four configurations."""
    rows = table_rows(results_page().split("**Table 2.")[1].split("\n\n")[1])
    return {(agent.split(". ")[-1], basis.split("; ")[-1]): cells for agent, basis, *cells in rows}


def test_agents__recipes_are_those_of_the_code_and_of_the_shipped_file() -> None:
    text, shipped = flat("agents.md"), read_description(ROOT / "data" / "agent-parse-and-plan.safetensors").recipe
    steps, dropout, held_out = re.findall(r"current recipe \(([\d,]+) steps, dropout ([\d.]+), (\d+) train", text)[0]
    now = ParserRecipe()
    assert (int(steps.replace(",", "")), float(dropout), int(held_out)) == (now.steps, now.dropout, now.held_out)
    recipe_a = re.findall(r"\*recipe A\* \(`--steps (\d+) --dropout ([\d.]+) --held-out (\d+)`\)", text)[0]
    assert tuple(map(float, recipe_a)) == (shipped["steps"], shipped["dropout"], shipped["held_out"])
    (generated,) = re.findall(r"and (\d+) % generated pairs at first", text)
    assert int(generated) == round(100 * shipped["generated"])


def test_imitation__shipped_networks_are_described_as_their_files_say() -> None:
    rows = {row[0].strip("`"): row for row in table_rows((DOCS / "imitation.md").read_text(encoding="utf-8"))}
    for appearance in ("tower", "scatter"):
        details = read_description(ROOT / "data" / f"agent-imitation-{appearance}.safetensors").details
        assert (details["corpus"], details["seed"]) == ("builtin", 0)
        assert round(details["cpu_minutes"]) == int(rows[f"imitation-{appearance}"][1])


def test_results__commands_are_those_of_the_experiment(official_data: Path) -> None:
    listed = re.findall(r"^lilgym-mp (train .*) --seed 0", results_page(), re.MULTILINE)
    planned = [planned.train for planned in read_plan(ROOT / "experiments" / "official.toml") if planned.train]
    wanted = {_options(f"{line} --seed {seed}".split()) for line in listed for seed in range(3)}
    assert wanted == {_options(words) for words in planned}


def _options(words: list[str] | tuple[str, ...]) -> frozenset[str]:
    """Options with values, without --evaluate-every, which does not affect training."""
    return frozenset(part for part in " ".join(words).split(" --") if not part.startswith("evaluate-every"))


def test_results__each_row_says_where_it_comes_from() -> None:
    """Trained on, recipe, seeds, CPU minutes and commit; supervision, actions and n are in Table 2."""
    table_2, origins = (
        table_rows(results_page().split(start)[1].split("\n\n")[1])
        for start in ("**Table 2.", "## Where each row comes from")
    )
    own = {int(row[0].split(".")[0]): row for row in table_2[2:] if "†" not in row[0]}
    described = {
        number: cells
        for rows, *cells in origins[2:]
        for first, last in [(re.findall(r"\d+", rows)[0], re.findall(r"\d+", rows)[-1])]
        for number in range(int(first), int(last) + 1)
    }
    assert list(own) == list(range(1, len(own) + 1)) == list(described)
    for number, (_, basis, *cells) in own.items():
        assert "; " in basis, number
        assert all(described[number]), number
        played = [cell for cell in cells if cell != "–"]
        assert played, number
        assert all("[" in cell for cell in played), f"row {number} lacks an interval"
    assert all("n = " in column for column in table_2[0][2:])


def test_results__accuracies_by_target_value_have_intervals() -> None:
    head, _, *rows = table_rows(
        results_page().split("**Figures 3 and 5,")[1].split("| agent | configuration | without")[0]
    )
    columns = [head.index(f"target {value}") for value in ("true", "false")]
    for row in rows:
        for cell in (row[column] for column in columns):
            assert cell == "–" if row[1].endswith("Scratch") else re.search(r" \[[\d.]+, [\d.]+\]$", cell), row


def test_results__have_no_row_of_a_run_too_short_to_mean_anything() -> None:
    steps = re.findall(r"^lilgym-mp train ppo .*--steps (\d+)", results_page(), re.MULTILINE)
    assert steps
    assert min(map(int, steps)) >= 1_000_000


@pytest.mark.parametrize(
    ("page", "picture", "experiment"),
    [
        ("results.md", "results-ppo-curves", "ppo"),
        ("results.md", "results-ppo-sf-curves", "official"),
        ("results.md", "results-figure-4-accuracy-on-dev-while-training", "figure_4"),
        ("training.md", "results-bert-curves", "pretrained"),
    ],
)
def test_captions_of_learning_curves__say_what_the_recipes_of_the_experiment_say(
    official_data: Path, page: str, picture: str, experiment: str
) -> None:
    trained = [planned.train for planned in read_plan(ROOT / "experiments" / f"{experiment}.toml")]
    keys = ("mask", "stop_forcing", "nlvr_reward")
    recipes = [{key: f"--{key.replace('_', '-')}" in words for key in keys} for words in trained if "ppo" in words]
    told = caption([TrainingCurve(Path(), "ppo", "", (), recipe=recipe) for recipe in recipes])
    (shown,) = re.findall(rf"\({re.escape(f'pictures/{picture}.png')}\) \*(.*?)\*(?!\*)", flat(page))
    for sentence in told.removesuffix(MEANS).split(". "):
        assert sentence.strip(". ") in shown
    assert ("forced" in shown) == ("forced" in told)


def test_readme__rows_are_those_of_the_results_page() -> None:
    results = accuracies()
    readme = table_rows((ROOT / "README.md").read_text(encoding="utf-8"))
    rows = [row for row in readme if len(row) == 6 and row[1].startswith(("rewards ¹", "programs", "the builtin"))]
    names = (("ppo+sf", "sampled"), ("ppo+sf", "greedy"), ("imitation", "chosen ²"))
    names = (*names, ("parse-and-plan", "greedy"), ("parse-and-plan-builtin", "greedy"))
    assert len(rows) == len(names)
    for name, row in zip(names, rows, strict=True):
        for shown, exact in zip(row[2:], results[name], strict=True):
            assert numbers(shown) == numbers(exact.split(" [")[0]), name


@pytest.mark.parametrize("page", ["training.md", "agents.md", "reward_model.md"])
def test_figures_of_ppo__are_those_of_the_results_page(page: str) -> None:
    for actions in ("greedy", "sampled"):
        for cell in accuracies()["ppo+sf", actions]:
            assert cell.split(" [")[0] in flat(page), actions


def test_readme__rows_are_those_of_the_pages_they_link_to() -> None:
    rows = table_rows((ROOT / "README.md").read_text(encoding="utf-8"))
    (game,) = (row for row in rows if row[0].startswith("[proposer and verifier]"))
    by_seed = re.findall(r"\| the learned one \| ([\d., ]+) \|", flat("game_experiments.md"))
    for cell, listed in zip(game[2:4], map(numbers, by_seed), strict=True):
        assert numbers(cell) == pytest.approx([statistics.mean(listed), statistics.stdev(listed)], abs=0.051)
    for name in ("[reward model and search]", "imitation of such a search"):
        (row,) = (row for row in rows if row[0].startswith(name))
        for cell in row[2:]:
            assert f"| {cell} (" in flat("reward_model.md"), name


def test_counts_of_official_tasks(official_data: Path) -> None:
    train = {a: load_tasks("lilgym", a, "flipit", "train") for a in ("tower", "scatter")}
    dev = {a: load_tasks("lilgym", a, "flipit", "dev") for a in ("tower", "scatter")}
    assert f"{sum(map(len, train.values())):,}" in flat("fidelity.md")
    assert f"dev | {sum(map(len, dev.values()))} |" in flat("fidelity.md")
    statements = len({task.statement for task in dev["tower"]})
    assert f"{len(dev['tower'])} tasks of {statements} statements" in flat("agents.md")


def test_datasheet__counts_are_those_of_the_file() -> None:
    lines = gzip.decompress((ROOT / "data" / "builtin.jsonl.gz").read_bytes()).decode().splitlines()
    entries = [json.loads(line) for line in lines[1:]]
    hand_written = sum("hand-written" in entry["tags"] for entry in entries)
    text = flat("datasheet.md")
    assert f"{len(entries):,} English statements" in text
    assert f"| {hand_written} | for this project" in text
    assert f"| {len(entries) - hand_written:,} | by a grammar" in text
    splits = Counter(entry["split"] for entry in entries if entry["appearance"] == "tower")
    assert f"({splits['train']:,} train, {splits['dev']} dev, {splits['test']} test)" in text


def test_croissant__describes_the_corpus_file() -> None:
    path = ROOT / "scripts" / "write_croissant.py"
    spec = importlib.util.spec_from_file_location("write_croissant", path)
    assert spec is not None
    assert spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    written = (ROOT / "data" / "croissant.json").read_text(encoding="utf-8")
    assert written == script.text(), "run scripts/write_croissant.py"


def test_croissant__is_valid_and_can_be_read() -> None:
    mlcroissant = pytest.importorskip("mlcroissant", reason='needs mlcroissant: pip install ".[croissant]"')
    dataset = mlcroissant.Dataset(jsonld=str(ROOT / "data" / "croissant.json"))
    assert not dataset.metadata.ctx.issues.errors
    assert not dataset.metadata.ctx.issues.warnings
    _, *entries = dataset.records("entries")  # the first is the header
    assert len(entries) == 2_900
    assert entries[0]["entries/statement"].startswith(b"There should be")


@pytest.mark.parametrize(
    ("name", "row", "passes"),
    [
        ("random-legal", ("random legal", "legal ones, sampled"), 5),
        ("random-type", ("random type", "sampled"), 5),
        ("imitation-tower", ("imitation-tower and imitation-scatter, included", "chosen ²"), 1),
    ],
)
def test_results__cheapest_rows_are_reproduced(
    official_data: Path, name: str, row: tuple[str, str], passes: int
) -> None:
    if name == "imitation-tower":
        agent = pytest.importorskip("lilgym_mp.learning.agents").load_agent(name, "cpu")
        policy = NamedPolicy(name, agent.policy, configurations=agent.description.configurations)
    else:
        policy = built_in_policy(name)
    for configuration, shown in zip(CONFIGURATIONS, accuracies()[row], strict=True):
        if configuration in policy.configurations:
            plan = EvaluationPlan(Settings(configuration, "lilgym"), "dev", passes=passes)
            played = play(policy, plan, set()).summary.accuracy
            tolerance = 0.051 if passes > 1 else 1.0  # another processor may round a network's outputs otherwise
            assert 100 * played == pytest.approx(numbers(shown)[0], abs=tolerance), configuration
