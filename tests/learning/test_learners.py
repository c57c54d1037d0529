"""A learner that the package does not have: one module and one line make it known everywhere."""

import pickle
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from statistics import fmean

import pytest

from lilgym_mp import cli
from lilgym_mp.cli.experiment_plan import read_plan
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.evaluation import CONFIGURATIONS, evaluate
from lilgym_mp.learning.common.agents import AgentError, open_agent
from lilgym_mp.learning.common.learners import LEARNERS, Learner, find_learner, shipped_agents
from lilgym_mp.learning.common.model_file import ModelDescription, save_model
from lilgym_mp.learning.common.recipes import Recipe, RunOptions, setting
from tests.command_line import succeeds


@dataclass(frozen=True)
class Guesses(Recipe):
    """A recipe."""

    seed: int = setting(0, "seed")
    boldness: float = setting(0.5, "how bold the guesses are", 0, 1)


@dataclass(frozen=True)
class Options(RunOptions):
    updates: int = setting(9, "guesses", 1)


@pytest.fixture(autouse=True)
def guessing(monkeypatch):
    """The arguments that its function was given."""
    given = []
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


def test_new_learner__has_a_train_command(guessing, tmp_path):
    succeeds("train guessing TowerFlipIt --boldness 0.25 --updates 1e1 --out", tmp_path)
    (given,) = guessing
    assert (given["settings"], given["recipe"]) == (EnvConfig("TowerFlipIt"), Guesses(boldness=0.25))
    assert (given["updates"], given["out"], given["threads"]) == (10, tmp_path, 1)


def test_new_learner__can_be_part_of_an_experiment(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text('configurations = ["TowerScratch"]\n[[learners]]\nlearner = "guessing"\nboldness = 0.75\n')
    (run,) = read_plan(path)
    assert " ".join(run.train) == "train guessing TowerScratch --seed 0 --corpus builtin --boldness 0.75"
    assert run.budget == ("updates", 9)


def test_new_learner__has_agents_that_can_be_opened(tmp_path):
    save_model(tmp_path / "agent.safetensors", ModelDescription("guessing", 1, ("TowerScratch",), "none", {}, {}), {})
    assert open_agent(tmp_path, "cpu") == "agent of agent.safetensors on cpu"


SHIPPED = [
    *(("parse-and-plan", configuration) for configuration in CONFIGURATIONS),
    *(("imitation-tower", "TowerScratch"), ("imitation-tower", "TowerFlipIt")),
    *(("imitation-scatter", "ScatterScratch"), ("imitation-scatter", "ScatterFlipIt")),
    *(("ppo-tower", "TowerFlipIt"), ("reward-model-tower", "TowerFlipIt")),
]


@pytest.mark.parametrize(("name", "configuration"), SHIPPED)
@pytest.mark.long
def test_shipped_agents__solve_most_tasks_from_pixels(name, configuration):
    agent, settings = open_agent(Path(name), "cpu"), EnvConfig(configuration)
    assert agent.description.kind in name
    assert configuration in agent.description.configurations
    assert "builtin" in agent.description.supervision
    tasks = settings.make("dev").evaluation_tasks()
    episodes = evaluate(agent.policy(settings), settings, "dev", task_ids=tasks[:: len(tasks) // 5])
    least = 0.3 if name == "ppo-tower" else 0.5  # random legal actions: at most 0.21
    assert fmean(episode.is_success for episode in episodes) > least


@pytest.mark.parametrize("name", ["parse-and-plan", "imitation-tower", "ppo-tower", "reward-model-tower"])
@pytest.mark.long
def test_shipped_agents__play_alike_in_another_process(name):
    settings = EnvConfig("TowerFlipIt")
    policy = open_agent(Path(name), "cpu").policy(settings)
    copy = pickle.loads(pickle.dumps(policy))
    tasks = settings.make("dev").evaluation_tasks()[:6]
    one, other = (evaluate(each, settings, "dev", task_ids=tasks) for each in (policy, copy))
    assert one == other


def test_shipped_agents__are_small_and_listed_for_an_unknown_one():
    sizes = [path.stat().st_size for path in files("lilgym_mp.data").iterdir() if path.name.startswith("agent-")]
    assert len(sizes) == len(shipped_agents()) == 5
    assert sum(sizes) <= 6_000_000
    with pytest.raises(AgentError, match=r"at imitation-towers: .*imitation-tower, parse-and-plan, ppo-tower, reward-"):
        open_agent(Path("imitation-towers"), "cpu")


@pytest.mark.parametrize("name", [name for name in LEARNERS if name != "guessing"])
def test_learners__have_a_recipe_and_a_budget(name):
    learner = find_learner(name)
    assert learner.budget(learner.recipe.of("TowerScratch"), learner.options())[1] > 0
