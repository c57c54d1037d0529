"""A learner that the package does not have: one module and one line make it known everywhere."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from statistics import fmean
from typing import Any

import pytest

from lilgym_mp import cli
from lilgym_mp.cli.experiment_plan import read_plan
from lilgym_mp.corpus import load_tasks
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.evaluation import evaluate
from lilgym_mp.learning.common.agents import AgentError, open_agent
from lilgym_mp.learning.common.learners import LEARNERS, Learner, find_learner, shipped_agents
from lilgym_mp.learning.common.model_file import ModelDescription, save_model
from lilgym_mp.learning.common.recipes import Recipe, RunOptions, setting


@dataclass(frozen=True)
class Guesses(Recipe):
    """A recipe."""

    seed: int = setting(0, "seed")
    boldness: float = setting(0.5, "how bold the guesses are", 0, 1)


@dataclass(frozen=True)
class Options(RunOptions):
    updates: int = setting(9, "guesses", 1)


@pytest.fixture(autouse=True)
def guessing(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[dict[str, Any]]]:
    """The arguments that its function was given."""
    given: list[dict[str, Any]] = []
    learner = Learner(
        Guesses,
        Options,
        train=lambda settings, **arguments: given.append({"settings": settings, **arguments}),
        load_agent=lambda path, device: f"agent of {path.name} on {device}",
        text="Guesses.\n\nGuesses boldly.",
    )
    monkeypatch.setitem(LEARNERS, "guessing", lambda: learner)
    cli.make_parser.cache_clear()
    yield given
    cli.make_parser.cache_clear()


def test_new_learner__has_a_train_command(guessing: list[dict[str, Any]], tmp_path: Path) -> None:
    words = ["train", "guessing", "TowerFlipIt", "--boldness", "0.25", "--updates", "1e1", "--out", str(tmp_path)]
    assert cli.main(words) == 0
    (given,) = guessing
    assert (given["settings"], given["recipe"]) == (EnvConfig("TowerFlipIt"), Guesses(boldness=0.25))
    assert (given["updates"], given["out"], given["threads"]) == (10, tmp_path, 1)


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
    assert run.budget == ("updates", 9)


def test_new_learner__has_agents_that_can_be_opened(tmp_path: Path) -> None:
    save_model(tmp_path / "agent.safetensors", ModelDescription("guessing", 1, ("TowerScratch",), "none", {}, {}), {})
    assert open_agent(tmp_path, "cpu") == "agent of agent.safetensors on cpu"


@pytest.mark.parametrize(
    ("name", "kind", "configuration"),
    [
        ("parse-and-plan", "parse-and-plan", "TowerFlipIt"),
        ("imitation-tower", "imitation", "TowerFlipIt"),
        ("imitation-scatter", "imitation", "ScatterFlipIt"),
        ("ppo-tower", "ppo", "TowerFlipIt"),
        ("reward-model-tower", "reward-model", "TowerFlipIt"),
    ],
)
def test_shipped_agents__are_opened_by_name_and_play(name: str, kind: str, configuration: str) -> None:
    agent, settings = open_agent(Path(name), "cpu"), EnvConfig(configuration)
    assert agent.description.kind == kind
    tasks = load_tasks("builtin", settings.appearance, settings.start, "dev").ids[:24]
    policy = agent.policy(settings)
    episodes = evaluate(policy, settings, "dev", task_ids=tasks)
    assert fmean(episode.is_success for episode in episodes) > 0.5  # random legal actions: at most 0.21
    copy = pickle.loads(pickle.dumps(policy))  # as for another process
    assert evaluate(copy, settings, "dev", task_ids=tasks) == episodes


def test_shipped_agents__are_small_and_listed_for_an_unknown_one() -> None:
    sizes = [path.stat().st_size for path in files("lilgym_mp.data").iterdir() if path.name.startswith("agent-")]
    assert len(sizes) == len(shipped_agents()) == 5
    assert sum(sizes) <= 6_000_000
    with pytest.raises(AgentError, match=r"at imitation-towers: .*imitation-tower, parse-and-plan, ppo-tower, reward-"):
        open_agent(Path("imitation-towers"), "cpu")


@pytest.mark.parametrize("name", [name for name in LEARNERS if name != "guessing"])
def test_learners__have_a_recipe_and_a_budget(name: str) -> None:
    learner = find_learner(name)
    assert learner.budget(learner.recipe.of("TowerScratch"), learner.options())[1] > 0
