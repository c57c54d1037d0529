"""Stacked wrappers: rebuilding from specs, pickling, and Gymnasium's check."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.vector import AutoresetMode

from lilgym_mp import testing, wrappers
from lilgym_mp.envs.observation import EMPTY
from lilgym_mp.wrappers import WrongEnvironment
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper, factory
from lilgym_mp.wrappers.transformation import EnvState, Transformation
from tests.envs.alike import equal

Make = Callable[..., gym.Env[Any, Any]]
Stack = list[tuple[Any, dict[str, Any]]]


def letters(statement: str) -> list[int]:
    """A toy sentence encoder."""
    return [statement.count(letter) for letter in "aeiou"]


ALONE: Stack = [
    (wrappers.ActionMask, {}),
    (wrappers.BoxPermutation, {}),
    (wrappers.ChannelsFirst, {}),
    (wrappers.GridPlanes, {"keep_image": True}),
    (wrappers.ImageObservation, {}),
    (wrappers.MultiDiscreteActions, {}),
    (wrappers.NLVRReward, {}),
    (wrappers.NamedActions, {}),
    (wrappers.NativeImage, {}),
    (wrappers.StatementEmbedding, {"encoder": letters}),
    (wrappers.StepsLeft, {}),
    (wrappers.StopForcing, {"mode": "mask"}),
    (wrappers.StopForcing, {"mode": "replace"}),
    (wrappers.StructuredObservation, {}),
    (wrappers.TextObservation, {"default": 1}),
    (wrappers.TokenizedStatement, {"length": 40}),
]
NAMES = [
    "-".join([wrapper.__name__, *(f"{name}={value}" for name, value in arguments.items() if not callable(value))])
    for wrapper, arguments in ALONE
]

# Any selection is valid in this order of layers, in any order within a layer.


def stacked(env: gym.Env[Any, Any], stack: Stack) -> gym.Env[Any, Any]:
    for wrapper, arguments in stack:
        env = wrapper(env, **arguments)
    return env


@pytest.mark.parametrize("configuration", ["TowerScratch", "ScatterScratch"])
@pytest.mark.parametrize(("wrapper", "arguments"), ALONE, ids=NAMES)
def test_wrapper__keeps_the_contracts_alone_and_in_batches(
    corpus: Path, configuration: str, wrapper: Any, arguments: dict[str, Any]
):
    make: Any = {"id": f"lilgym_mp/{configuration}-v0", "corpus": str(corpus)}
    single = lambda: wrapper(gym.make(**make), **arguments)  # noqa: E731
    testing.check_env(single, exact_masks=wrapper is not wrappers.StopForcing, steps=40)
    batch = lambda **settings: factory(wrapper)(gym.make_vec(**make, **settings), **arguments)  # noqa: E731
    modes = (AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP)
    testing.check_vector_env(batch, single, num_envs=3, modes=modes, exact_masks=False, steps=15)


def test_flat__keeps_the_contracts(make: Make):
    testing.check_env(lambda: wrappers.FlatObservation(wrappers.TokenizedStatement(make("ScatterFlipIt"))), steps=20)


@pytest.mark.parametrize(("wrapper", "arguments"), ALONE, ids=NAMES)
def test_spec__rebuilds_the_wrapper(make: Make, wrapper: Any, arguments: dict[str, Any]):
    env = wrapper(make("TowerScratch"), **arguments)
    assert env.spec is not None
    rebuilt: Any = gym.make(env.spec)
    assert str(rebuilt) == str(env)
    assert rebuilt.spec == env.spec
    assert rebuilt.observation_space == env.observation_space
    assert same_play(env, rebuilt)


def test_spec__survives_json(make: Make):
    env = wrappers.FlatObservation(wrappers.TokenizedStatement(wrappers.StopForcing(make("TowerScratch"))))
    assert env.spec is not None
    rebuilt = gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    assert str(rebuilt) == str(env)


def same_play(one: gym.Env[Any, Any], other: gym.Env[Any, Any]) -> bool:
    """Whether both environments give equal results for a seed and some actions."""
    one.action_space.seed(0)
    outcomes = [env.reset(seed=3) for env in (one, other)]
    for _ in range(3):
        if not equal(*outcomes):
            return False
        action = one.action_space.sample()
        outcomes = [env.step(action) for env in (one, other)]
        if outcomes[0][2] or outcomes[0][3]:
            break
    return equal(*outcomes)


def test_stack__can_be_pickled_in_mid_episode(make: Make):
    env = stacked(
        make("TowerFlipIt"), [(wrappers.StopForcing, {}), (wrappers.TokenizedStatement, {}), (wrappers.GridPlanes, {})]
    )
    env.reset(seed=0)
    env.step(1)
    copy = pickle.loads(pickle.dumps(env))
    assert equal(env.step(2), copy.step(2))


FACTORIES = {name: getattr(wrappers, name) for name in wrappers.__all__ if name.endswith("_v0")}


@pytest.mark.parametrize("name", FACTORIES)
def test_factory__refuses_another_packages_environment(name: str):
    arguments = {"statement_embedding_v0": {"encoder": letters}, "reverse_curriculum_v0": {"edits": 1}}.get(name, {})
    others = (gym.make("CartPole-v1"), gym.make_vec("CartPole-v1", num_envs=2), "TowerScratch")
    for other in others:
        with pytest.raises(WrongEnvironment):
            FACTORIES[name](other, **arguments)


def test_factory__on_other_vector_environments_suggests_an_alternative(make: Make):
    each = gym.vector.SyncVectorEnv([partial(make, "TowerScratch")] * 2)
    with pytest.raises(WrongEnvironment, match="for others, wrap each environment"):
        wrappers.action_mask_v0(each)


def test_factory__has_the_signature_and_docstring_of_its_class():
    factory = wrappers.tokenized_statement_v0
    assert "vocabulary" in (factory.__doc__ or "")
    with pytest.raises(TypeError, match="words"):
        factory(gym.make_vec("lilgym_mp/TowerScratch-v0", num_envs=2), words=3)  # pyright: ignore[reportCallIssue]


class CountedItems(Transformation):
    """The number of items, by a Transformation that is not a Format."""

    changes_observations = True

    def observation_space(self) -> spaces.Space[Any]:
        return spaces.Box(0, 100, (1,), np.int64)

    def observations(self, observations: Any, state: EnvState) -> Any:
        return (state.items[..., -1] != EMPTY).sum(axis=(1, 2))[:, None]


class ItemCount(EnvWrapper[CountedItems]):
    transformation_class = CountedItems


def test_batch__of_a_transformation_that_is_no_format_keeps_the_contracts():
    make = partial(gym.make_vec, "lilgym_mp/TowerScratch-v0", horizon=3)
    single = lambda: ItemCount(gym.make("lilgym_mp/TowerScratch-v0", horizon=3))  # noqa: E731
    testing.check_vector_env(lambda **settings: factory(ItemCount)(make(**settings)), single, num_envs=3, steps=15)
