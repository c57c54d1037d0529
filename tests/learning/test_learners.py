"""A learner that the package does not have: one module and one line make it known everywhere."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from lilgym_mp import cli
from lilgym_mp.cli.experiment_plan import read_plan
from lilgym_mp.contrib.report.learning_curves import progress_curves
from lilgym_mp.contrib.report.report_data import ReportData, TrainingCurve
from lilgym_mp.learning.common.agents import AgentError, open_agent
from lilgym_mp.learning.common.learners import PACKAGES, Learner, find_learner
from lilgym_mp.learning.common.model_file import ModelDescription, save_model
from lilgym_mp.learning.common.recipes import setting

PACKAGE = "guessing_package"


@dataclass
class Guesses:
    """A recipe."""

    seed: int = setting(0, "seed")
    boldness: float = setting(0.5, "how bold the guesses are", 0, 1)


@pytest.fixture(autouse=True)
def guessing(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[argparse.Namespace]]:
    """The commands that the learner was given."""
    given: list[argparse.Namespace] = []
    module: Any = ModuleType(f"{PACKAGE}.learner", "Guesses.\n\nGuesses boldly.")
    agent: Any = ModuleType(f"{PACKAGE}.agent")
    agent.load_agent = lambda path, device: f"agent of {path.name} on {device}"
    module.LEARNER = Learner(
        add_options=lambda parser: parser.add_argument("--boldness", type=float),
        train=lambda args: given.append(args) or 0,
        recipe=Guesses,
        make_recipe=lambda configuration, options: Guesses(**options),
        budget=lambda options: ("guesses", options["guesses"]),
        progress=("luck", "mean luck"),
        numbers={"guesses": 9},
    )
    monkeypatch.setitem(sys.modules, f"{PACKAGE}.learner", module)
    monkeypatch.setitem(sys.modules, f"{PACKAGE}.agent", agent)
    monkeypatch.setitem(PACKAGES, "guessing", PACKAGE)
    cli.make_parser.cache_clear()
    yield given
    cli.make_parser.cache_clear()


def test_new_learner__has_a_train_command(guessing: list[argparse.Namespace]) -> None:
    assert cli.main(["train", "guessing", "--boldness", "0.25"]) == 0
    assert guessing[0].boldness == 0.25


def test_new_learner__can_be_part_of_an_experiment(tmp_path: Path) -> None:
    path = tmp_path / "plan.toml"
    path.write_text('configurations = ["TowerScratch"]\n[[learners]]\nlearner = "guessing"\nboldness = 0.75\n')
    (run,) = read_plan(path)
    assert run.train == (
        "train",
        "guessing",
        "TowerScratch",
        "--seed",
        "0",
        "--corpus",
        "builtin",
        "--boldness",
        "0.75",
    )
    assert run.budget == ("guesses", 9)


def test_new_learner__has_agents_that_can_be_opened(tmp_path: Path) -> None:
    save_model(tmp_path / "agent.safetensors", ModelDescription("guessing", 1, ("TowerScratch",), "none", {}, {}), {})
    assert open_agent(tmp_path, "cpu") == "agent of agent.safetensors on cpu"


def test_shipped_agents__are_opened_by_name_and_listed_for_an_unknown_one() -> None:
    assert open_agent(Path("imitation-tower"), "cpu").description.kind == "imitation"
    with pytest.raises(AgentError, match=r"no trained agent at imitation-towers: .*imitation-tower, parse-and-plan"):
        open_agent(Path("imitation-towers"), "cpu")


def test_new_learner__has_a_training_curve() -> None:
    curve = TrainingCurve(Path("run"), "guessing", "TowerScratch", ({"steps": 1, "luck": 0.5},))
    chart: Any = progress_curves(ReportData((), (curve,)))
    (axes,) = chart.figure.axes
    assert (axes.get_title("left"), axes.get_ylabel()) == ("guessing TowerScratch", "mean luck")


@pytest.mark.parametrize("name", [name for name in PACKAGES if name != "guessing"])
def test_learners__have_a_recipe_and_a_budget(name: str) -> None:
    learner = find_learner(name)
    assert isinstance(learner.make_recipe("TowerScratch", {}), learner.recipe)
    _, end = learner.budget(learner.numbers)
    assert end > 0
