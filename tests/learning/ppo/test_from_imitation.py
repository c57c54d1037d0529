"""PPO initialised from an imitation run."""

from __future__ import annotations

import re
import shutil
from importlib.resources import as_file, files
from pathlib import Path

import numpy as np
import pytest
import torch

from lilgym_mp.appearances import Scatter, Tower, make_appearance
from lilgym_mp.evaluation import Observations, Settings
from lilgym_mp.learning.agents import load_agent, open_agent
from lilgym_mp.learning.imitation.agent import ImitationAgent
from lilgym_mp.learning.ppo.models.factory import make_model
from lilgym_mp.learning.ppo.models.from_imitation import ImitationModel
from lilgym_mp.learning.ppo.models.weights import WeightsError
from lilgym_mp.learning.ppo.recipe import make_recipe
from lilgym_mp.learning.ppo.rollout import policy_and_values
from lilgym_mp.learning.ppo.states import BoxImageTable
from lilgym_mp.learning.ppo.training import train_ppo
from tests.learning.ppo.test_models import SHORT, STATEMENTS, seen


@pytest.fixture(scope="module", params=["imitation-tower", "imitation-scatter"])
def imitation_run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run directory with a shipped agent, as written by `lilgym-mp train imitation`."""
    place = tmp_path_factory.mktemp("run")
    agent = load_agent(request.param)
    assert isinstance(agent, ImitationAgent)
    agent.save(place / "agent.safetensors")
    return place


def initialised_from(run: Path) -> tuple[str, ImitationModel]:
    """The FlipIt configuration that the run plays, and a model initialised from it."""
    name = next(name for name in open_agent(run).description.configurations if name.endswith("FlipIt"))
    recipe = make_recipe("ours", name, model="imitation")
    model = make_model(recipe, make_appearance(name.removesuffix("FlipIt").lower()), weights=run)
    assert isinstance(model, ImitationModel)
    return name, model.eval()


def test_imitation__starts_with_the_policy_of_the_run(imitation_run: Path):
    name, model = initialised_from(imitation_run)
    states, images = seen(name, 40)
    with torch.no_grad():
        policy, values = policy_and_values(model, states, None)
    agent = open_agent(imitation_run)
    assert isinstance(agent, ImitationAgent)
    observations = Observations(
        images, tuple(states.statements[place] for place in states.statement_of), states.targets,
        np.arange(40), np.ones(40, np.int64),
    )  # fmt: skip
    played = agent.policy(Settings(name))
    legal = np.ones((40, model.factorisation.action_count), np.bool_)
    chosen = played(observations, legal, np.random.default_rng(0))
    output = played.output(legal, chosen)
    np.testing.assert_allclose(policy.probabilities().numpy(), output.probabilities, atol=2e-5)
    assert values.shape == (40,)
    assert (values.abs() < 1).all()


def test_imitation__prediction_is_independent_of_the_rest_of_the_batch(imitation_run: Path):
    name, model = initialised_from(imitation_run)
    states, images = seen(name, 12)
    table = BoxImageTable()
    alone = table.states(STATEMENTS, np.array([0]), table.indices(images[3:4]), states.targets[3:4])
    assert states.statements[states.statement_of[3]] == STATEMENTS[0]
    with torch.no_grad():
        together, single = model(states), model(alone)
    for many, one in zip((together.types, *together.heads), (single.types, *single.heads), strict=True):
        np.testing.assert_allclose(many[3].numpy(), one[0].numpy(), atol=1e-4)


def test_imitation__description_states_the_earlier_supervision(imitation_run: Path, tmp_path: Path, own: str):
    name, _ = initialised_from(imitation_run)
    recipe = make_recipe("ours", name, model="imitation", **SHORT)
    settings = Settings(name, corpus=own)
    agent = train_ppo(settings, recipe, tmp_path / "run", steps=2 * recipe.rollout, weights=imitation_run)
    assert "rewards alone" in agent.description.supervision
    assert "initialised from imitation: programs of train statements" in agent.description.supervision
    again = open_agent(tmp_path / "run")
    states, _ = seen(name)
    with torch.no_grad():
        np.testing.assert_allclose(again.model(states).values, agent.model.eval()(states).values, atol=1e-5)  # pyright: ignore[reportAttributeAccessIssue]
    before = initialised_from(imitation_run)[1].network.state_dict()
    assert any((before[key] != tensor).any() for key, tensor in agent.model.network.state_dict().items())  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.parametrize(
    ("weights", "said"),
    [
        (None, "starts from a trained network: name its run directory"),
        ("nowhere", "there is no such file or directory"),
        ("empty", "it has no agent.safetensors"),
        ("other", "must be 'imitation', version 1"),
        ("scatter", "a network for scatter, not for tower"),
    ],
)
def test_imitation__rejects_unusable_runs(tmp_path: Path, weights: str | None, said: str):
    (tmp_path / "empty").mkdir()
    for place, agent in (("other", "parse-and-plan"), ("scatter", "imitation-scatter")):
        (tmp_path / place).mkdir()
        with as_file(files("lilgym_mp.data") / f"agent-{agent}.safetensors") as file:
            shutil.copy(file, tmp_path / place / "agent.safetensors")
    named = None if weights is None else tmp_path / weights
    with pytest.raises(WeightsError, match=re.escape(said)):
        make_model(make_recipe("ours", "TowerFlipIt", model="imitation"), Tower(), weights=named)


def test_imitation__rejects_another_grid(imitation_run: Path):
    with pytest.raises(WeightsError, match=r"plays Tower, and Scatter on the grid 19 x 5"):
        ImitationModel(Scatter((38, 10)), initialised_from(imitation_run)[1].architecture, "")
