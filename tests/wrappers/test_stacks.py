"""Stacked wrappers: rebuilding from specs, pickling, and Gymnasium's check."""

import inspect
import pickle
import pydoc
from functools import partial
from itertools import product

import gymnasium as gym
import pytest
from gymnasium.vector import AutoresetMode

from lilgym_mp import testing, wrappers
from lilgym_mp.wrappers import WrongEnvironment
from tests.stress.wrapper_stacks import SETTINGS, letters, stacked

ALONE = [(name, settings) for name, each in SETTINGS.items() for settings in each if name != "flat_observation"]
IDS = [
    "-".join([name, *(f"{key}={value}" for key, value in each.items() if not callable(value))]) for name, each in ALONE
]
FACTORIES = {name: getattr(wrappers, name) for name in wrappers.__all__ if name.endswith("_v0")}


@pytest.mark.parametrize(
    ("configuration", "name", "settings"),
    [
        pytest.param(
            *(configuration, name, settings),
            id=f"{configuration}-{id}",
            marks=pytest.mark.long if configuration == "ScatterScratch" else (),
        )
        for id, (name, settings) in zip(IDS, ALONE, strict=True)
        for configuration in ("TowerScratch", "ScatterScratch")
    ],
)
def test_wrapper__keeps_the_contracts_alone_and_in_batches(corpus, configuration, name, settings):
    make = {"id": f"lilgym_mp/{configuration}-v0", "corpus": str(corpus)}
    single = lambda: stacked(partial(gym.make, **make), [(name, settings)])  # noqa: E731
    testing.check_env(single, exact_masks=name != "stop_forcing", steps=20)
    batch = lambda **more: stacked(partial(gym.make_vec, **make, **more), [(name, settings)])  # noqa: E731
    modes = (AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP)
    testing.check_vector_env(batch, single, num_envs=3, modes=modes, exact_masks=False, steps=8)


def test_flat__keeps_the_contracts(make):
    testing.check_env(lambda: wrappers.FlatObservation(wrappers.TokenizedStatement(make("ScatterFlipIt"))), steps=20)


@pytest.mark.parametrize(("name", "settings"), ALONE, ids=IDS)
def test_spec__rebuilds_the_wrapper(make, name, settings):
    env = stacked(partial(make, "TowerScratch"), [(name, settings)])
    rebuilt = gym.make(env.spec)
    assert str(rebuilt) == str(env)
    assert rebuilt.spec == env.spec
    assert rebuilt.observation_space == env.observation_space
    testing.assert_same(rebuilt.reset(seed=3), env.reset(seed=3))


@pytest.mark.parametrize(
    "wrap",
    [
        lambda env: wrappers.GridPlanes(wrappers.TokenizedStatement(wrappers.StopForcing(env))),
        wrappers.PotentialShaping,
    ],
)
def test_stack__can_be_pickled_in_mid_episode(make, wrap):
    env = wrap(make("TowerFlipIt"))
    env.reset(seed=0)
    env.step(1)
    copy = pickle.loads(pickle.dumps(env))
    testing.assert_same(env.step(2), copy.step(2))


def test_factories__refuse_another_packages_environment():
    arguments = {"statement_embedding_v0": {"encoder": letters}}
    others = (gym.make("CartPole-v1"), gym.make_vec("CartPole-v1", num_envs=2), "TowerScratch")
    for (name, factory), other in product(FACTORIES.items(), others):
        with pytest.raises(WrongEnvironment):
            factory(other, **arguments.get(name, {}))


def test_factory__on_other_vector_environments_suggests_an_alternative(make):
    each = gym.vector.SyncVectorEnv([partial(make, "TowerScratch")] * 2)
    with pytest.raises(WrongEnvironment, match="for others, wrap each environment"):
        wrappers.action_mask_v0(each)


def test_factory__takes_the_arguments_and_has_the_docstring_of_its_class():
    factory = wrappers.tokenized_statement_v0
    assert "vocabulary" in (factory.__doc__ or "")
    with pytest.raises(TypeError, match="words"):
        factory(gym.make_vec("lilgym_mp/TowerScratch-v0", num_envs=2), words=3)


def test_factories__are_found_where_they_say_and_named_in_their_help():
    assert len(FACTORIES) == 15
    for name, factory in FACTORIES.items():
        assert factory.__qualname__ == name
        title, _, signature, *_ = pydoc.render_doc(factory, renderer=pydoc.plaintext).split("\n")
        assert title.startswith(f"Python Library Documentation: function {name} in module lilgym_mp.wrappers")
        assert signature.startswith(f"{name}(")
        assert inspect.signature(factory).return_annotation in ("Any", "AnyEnv")
