"""Recorded decisions of all kinds of agents."""

from dataclasses import replace

import pytest

from lilgym_mp.evaluation import Settings, evaluate
from lilgym_mp.evaluation.episode_files import read_episodes
from lilgym_mp.learning.common.agents import load_agent, open_agent
from lilgym_mp.learning.ppo.training import train_ppo
from tests.command_line import lilgym, succeeds
from tests.json_files import read_json
from tests.learning.conftest import SMALL_PPO as SMALL

TOWER = Settings("TowerFlipIt")


def played(policy, settings=TOWER):
    task_ids = settings.make("dev").evaluation_tasks()[:12]
    return evaluate(policy, settings, "dev", task_ids=task_ids, record_decisions=True)


def steps(episodes):
    """Each decision, the type of the action taken, and the recorded probability of STOP."""
    found = []
    for episode in episodes:
        stops = episode.stop_probabilities or (None,) * len(episode.actions)
        for decision, action, stop in zip(episode.decisions, episode.actions, stops, strict=True):
            assert sum(decision.types) == pytest.approx(1, abs=1e-3)
            found.append((decision, type(action).__name__, stop))
    return found


@pytest.mark.parametrize("mask", [True, False])
@pytest.mark.long
def test_ppo__records_probabilities_and_the_value(tmp_path, mask):
    settings = Settings("TowerScratch")
    train_ppo(settings, replace(SMALL, mask=mask), tmp_path, steps=32, device="cpu")
    episodes = played(open_agent(tmp_path, "cpu").policy(settings), settings)
    found = steps(episodes)
    for decision, _, stop in found:
        assert decision.types[0] == pytest.approx(stop, abs=1e-3)
        assert decision.value is not None
        assert -1 <= decision.value <= 1
    assert (min(decision.legal_probability for decision, _, _ in found) > 0.999) or not mask


def test_imitation__records_the_networks_probabilities():
    found = steps(played(load_agent("imitation-tower", "cpu").policy(TOWER)))
    for decision, _, stop in found:
        assert decision.types[0] == pytest.approx(stop, abs=1e-3)
        assert decision.value is None
    assert any(decision.types[0] < 0.5 for decision, _, _ in found)


def test_parse_and_plan__records_the_programs_it_planned_for():
    for decision, done, _ in steps(played(load_agent("parse-and-plan", "cpu").policy(TOWER))):
        assert decision.likeliest[0][1] == 1
        assert (done == "Stop") == (decision.types[0] == 1)
        assert decision.programs
        assert max(decision.programs.values()) <= 1
        assert decision.success_probability is not None


@pytest.mark.long
def test_evaluate_command__records_decisions_on_request(tmp_path, capsys):
    command = f"evaluate --policy expert --configuration TowerScratch --record {tmp_path}"
    succeeds(f"{command} --record-decisions --judge-decisions")
    (file,) = tmp_path.glob("*.episodes.jsonl.gz")
    decisions = [decision for episode in read_episodes(file).episodes for decision in episode.decisions or ()]
    assert decisions
    assert all(decision.optimal for decision in decisions)
    assert "--record-decisions" in read_json(next(tmp_path.glob("*.metadata.json")))["command"]
    succeeds(f"{command} --force")
    assert all(episode.decisions is None for episode in read_episodes(file).episodes)
    capsys.readouterr()


@pytest.mark.parametrize(
    ("option", "error"),
    {
        "--record-decisions": "--record-decisions needs --record DIR",
        "--judge-decisions": "--judge-decisions needs --record-decisions",
    }.items(),
)
def test_evaluate_command__decisions_need_a_directory(option, error, capsys):
    assert lilgym(f"evaluate --policy expert {option}") != 0
    assert error in capsys.readouterr().err
