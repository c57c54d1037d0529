"""Stress test of wrappers: a random stack gives the same play on single, batched and worker environments.

Each stack of one to four wrappers with random settings is put on five single environments, on a batch of five, and, for
some stacks, on workers. Either all refuse it with the same kind of error, or spaces, observations, rewards, flags,
infos, masks and goals are equal at every step.
"""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import lilgym_mp.wrappers as wrappers
from lilgym_mp.envs.workers import WorkerVectorEnv
from lilgym_mp.evaluation import CONFIGURATIONS
from lilgym_mp.scene.actions import describe
from lilgym_mp.scene.appearances import make_appearance

N = 5
STEPS = 12
HORIZON = 4
WORKER_SHARE = 0.2  # of the stacks that are also put on workers
Stack = Sequence[tuple[str, dict[str, Any]]]  # names of factories without version, and settings


def letters(statement: str) -> list[int]:
    """A toy sentence encoder."""
    return [statement.count(letter) for letter in "aeiou"]


SETTINGS: dict[str, tuple[dict[str, Any], ...]] = {
    "action_mask": ({},),
    "box_permutation": ({},),
    "channels_first": ({},),
    "flat_observation": ({},),
    "grid_planes": ({}, {"keep_image": True}),
    "image_observation": ({},),
    "multi_discrete_actions": ({}, {"masks": "slots"}),
    "named_actions": ({},),
    "native_image": ({},),
    "nlvr_reward": ({},),
    "potential_shaping": ({"discount": 0.9},),
    "statement_embedding": ({"encoder": letters},),
    "steps_left": ({},),
    "stop_forcing": ({"mode": "mask"}, {"mode": "replace"}, {"mode": "observe"}),
    "structured_observation": ({}, {"keep_image": True}),
    "text_observation": ({}, {"scene": "drawing"}, {"legal_actions": False}),
    "tokenized_statement": ({}, {"length": 40}),
}


def random_stack(rng: random.Random) -> Stack:
    return [(name, rng.choice(SETTINGS[name])) for name in rng.choices(list(SETTINGS), k=rng.randint(1, 4))]


def stacked(make: Any, stack: Stack) -> Any:
    """The environment that `make` gives, with the stack on it."""
    env = make()
    for name, settings in stack:
        env = getattr(wrappers, f"{name}_v0")(env, **settings)
    return env


def made(make: Any) -> Any:
    """The environment, or the kind of error with which it was refused."""
    try:
        return make()
    except (ValueError, TypeError, gym.error.Error) as fault:
        return type(fault).__name__


def unequal(one: Any, other: Any) -> str | None:
    """Where two results differ, as a path into nested dicts, tuples and object arrays; None if they are equal."""
    if isinstance(one, dict) and isinstance(other, dict) and one.keys() == other.keys():
        parts = [(key, one[key], other[key]) for key in one]
    elif isinstance(one, tuple | list) or (isinstance(one, np.ndarray) and one.dtype == object):
        if len(one) != len(other):
            return f" has {len(other)} parts, not {len(one)}"
        parts = list(zip(range(len(one)), one, other, strict=True))
    elif isinstance(one, dict) and isinstance(other, dict):
        return f" has the keys {sorted(other)}, not {sorted(one)}"
    else:
        return None if np.array_equal(np.asarray(one), np.asarray(other)) else f" is {other}, not {one}"
    return next((f"[{key!r}]{where}" for key, a, b in parts if (where := unequal(a, b))), None)


def differences(configuration: str, stack: Stack, mode: AutoresetMode, seed: int, *, workers: bool) -> Iterator[str]:
    """Where the kinds of environments disagree; "refused" alone if all refuse the stack."""
    id, settings = f"lilgym_mp/{configuration}-v0", {"corpus": "builtin", "split": "train", "horizon": HORIZON}
    single = partial(stacked, partial(gym.make, id, **settings), stack)
    makers = {
        "single": partial(SyncVectorEnv, [single] * N, autoreset_mode=mode),
        "batch": partial(stacked, partial(gym.make_vec, id, num_envs=N, autoreset_mode=mode, **settings), stack),
    }
    if workers:
        make_workers = partial(WorkerVectorEnv, id, N, 2, autoreset_mode=mode, **settings)
        makers["workers"] = partial(stacked, make_workers, stack)
    envs = {kind: made(make) for kind, make in makers.items()}
    try:
        refusals = {kind: env for kind, env in envs.items() if isinstance(env, str)}
        if refusals:
            agree = len(refusals) == len(envs) and len(set(refusals.values())) == 1
            yield "refused" if agree else f"refused as {refusals} of {', '.join(envs)}"
        else:
            yield from _played(envs, stack, configuration, seed)
    finally:
        for env in envs.values():
            if not isinstance(env, str):
                env.close()


def _played(envs: dict[str, Any], stack: Stack, configuration: str, seed: int) -> Iterator[str]:
    """Where the play of random actions differs between the kinds of environments."""
    reference = envs["single"]
    chance = np.random.default_rng(seed)
    for kind, env in envs.items():
        for space in ("single_observation_space", "single_action_space"):
            if getattr(env, space) != getattr(reference, space):
                yield f"{kind}: another {space}"
    for step in range(-1, STEPS):
        if step in (-1, STEPS // 2):
            results = {kind: env.reset(seed=seed + step + 1) for kind, env in envs.items()}
        else:
            actions = _actions(envs["batch"].unwrapped.action_masks(), stack, configuration, chance)
            results = {kind: env.step(actions) for kind, env in envs.items()}
        for name in ("action_masks", "goal_reached"):
            for kind, env in envs.items():
                found = np.stack(env.call(name)) if kind == "single" else getattr(env, name)()
                results[kind] = (*results[kind], found)
        for kind, found in results.items():
            if where := unequal(results["single"], found):
                yield f"{kind}: the result of step {step}{where}"
                return


def _actions(masks: Any, stack: Stack, configuration: str, chance: np.random.Generator) -> Any:
    """Mostly legal actions, in the form that the stack takes."""
    appearance = make_appearance(CONFIGURATIONS[configuration][0])
    indices = [int(chance.choice(np.flatnonzero(mask))) for mask in masks]
    indices = [int(chance.integers(appearance.action_count)) if chance.random() < 0.1 else index for index in indices]
    names = [name for name, _ in stack]
    if "named_actions" in names:
        return tuple(describe(appearance.decode(index)) for index in indices)
    if "multi_discrete_actions" in names:
        return np.array([np.maximum(appearance.to_array(appearance.decode(index)), 0) for index in indices])
    return np.array(indices)


def compare(count: int, seed: int) -> tuple[Counter[str], list[str]]:
    """Compares the kinds of environments on every wrapper alone and on `count` random stacks.

    Returns what was compared, and the differences.
    """
    rng = random.Random(seed)
    compared: Counter[str] = Counter()
    found: list[str] = []
    alone: list[Stack] = [[(name, settings)] for name, each in SETTINGS.items() for settings in each]
    for number, stack in enumerate([*alone, *(random_stack(rng) for _ in range(count))]):
        configuration = rng.choice(list(CONFIGURATIONS))
        mode = rng.choice((AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP))
        workers = rng.random() < WORKER_SHARE
        differing = list(differences(configuration, stack, mode, number, workers=workers))
        compared["refused by all" if differing == ["refused"] else "played"] += 1
        compared["also by workers"] += workers
        if differing != ["refused"]:
            found.extend(f"{configuration}, {mode.name}, {stack}: {each}" for each in differing)
    return compared, found
