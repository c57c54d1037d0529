"""Expert iteration: a network taught by a reward model's search, from rewards and the rules of editing."""

from dataclasses import replace

import pytest

from lilgym_mp.corpus import load_tasks
from lilgym_mp.envs.rules import State, make_dynamics
from lilgym_mp.learning.common.agents import AgentError, open_agent
from lilgym_mp.learning.imitation import training
from lilgym_mp.learning.imitation.teaching import first_edits
from lilgym_mp.learning.imitation.training import train_imitation
from lilgym_mp.learning.reward_model.training import train_reward_model
from lilgym_mp.scene import Colour, Scene
from lilgym_mp.scene.actions import AddBlock
from lilgym_mp.scene.appearances import make_appearance
from lilgym_mp.solver import Solver
from tests.learning.conftest import accuracy, counted_stops
from tests.learning.imitation.conftest import small_recipe
from tests.learning.reward_model import conftest as reward_model


def teacher_of(updates, settings, out):
    train_reward_model(settings, reward_model.small_recipe(settings), out, updates=updates)
    return out


@pytest.mark.long
def test_taught_network__solves_three_statements_and_reads_truths_only_from_episodes(settings, tmp_path):
    teacher = teacher_of(150, settings, tmp_path / "teacher")
    with counted_stops() as stops:
        recipe = small_recipe(settings, own_states=0.0)
        agent = train_imitation(settings, recipe, tmp_path / "run", updates=120, teacher=teacher)
    assert agent.description.supervision.startswith("rewards; ")
    assert agent.description.details["stops"] == len(stops)
    assert agent.description.details["steps"] == sum(stops)
    for name in ("TowerFlipIt", "TowerScratch"):
        assert accuracy(open_agent(tmp_path / "run"), replace(settings, configuration=name)) == 1


@pytest.mark.long
def test_taught_network__learns_legal_edits_first_and_once(settings, tmp_path, monkeypatch):
    updates = []
    settings = replace(settings, configuration="ScatterFlipIt")
    teacher = teacher_of(2, settings, tmp_path / "teacher")
    monkeypatch.setattr(training, "pretrain_geometry", lambda *arguments: updates.append(arguments[2]))
    recipe = small_recipe(settings, pretraining=0.25)
    for budget, resume in ((4, False), (6, True)):
        train_imitation(settings, recipe, tmp_path / "run", updates=budget, teacher=teacher, resume=resume)
    assert updates == [4]


def test_first_edits__are_among_the_experts_and_hold_every_order_and_equal_box(appearance):
    dynamics = make_dynamics(make_appearance(appearance))
    solver = Solver(dynamics)
    for task in load_tasks("builtin", appearance, "flipit", "dev")[:40:4]:
        solution = solver.solve(task)
        edits = solution.actions[:-1]
        optimal = solver.optimal_actions(State(task, task.start, 0))
        assert dynamics.appearance.encode(edits[0]) in first_edits(dynamics, task.start, edits)
        assert first_edits(dynamics, task.start, edits) <= {*optimal.actions}


def test_first_edits__leave_out_what_must_come_later():
    dynamics = make_dynamics(make_appearance("tower"))
    blue, black = AddBlock(0, Colour.BLUE), AddBlock(0, Colour.BLACK)
    encode = dynamics.appearance.encode
    in_any_box = {encode(blue._replace(box=box)) for box in range(3)}
    assert first_edits(dynamics, Scene.empty(), [blue, black]) == in_any_box
    other = black._replace(box=1)
    assert len(first_edits(dynamics, Scene.empty(), [blue, other])) == 6


def test_teacher__must_be_a_reward_model_that_plays_the_configuration(settings, tmp_path):
    teacher = teacher_of(2, settings, tmp_path / "teacher")
    train_imitation(settings, small_recipe(settings), tmp_path / "other", updates=1)
    with pytest.raises(AgentError, match="other: a teacher must be a run of reward-model, not of imitation"):
        train_imitation(settings, small_recipe(settings), tmp_path / "run", updates=1, teacher=tmp_path / "other")
    settings = replace(settings, configuration="ScatterFlipIt")
    with pytest.raises(AgentError, match="does not play ScatterFlipIt"):
        train_imitation(settings, small_recipe(settings), tmp_path / "run", updates=1, teacher=teacher)
