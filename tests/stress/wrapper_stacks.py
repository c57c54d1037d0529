"""Stress test of wrappers: a random stack gives the same play on single, batched and worker environments.

Each stack of one to four wrappers with random settings is put on single environments, on a batch of five, and, for some
stacks, on workers. Either all refuse it with the same kind of error, or `lilgym_mp.testing` finds that they play alike.
"""

import random
from collections import Counter
from functools import partial

import gymnasium as gym
from gymnasium.vector import AutoresetMode

import lilgym_mp.wrappers as wrappers
from lilgym_mp.envs.workers import WorkerVectorEnv
from lilgym_mp.evaluation import CONFIGURATIONS
from lilgym_mp.testing import check_vector_env

N = 5
STEPS = 12
HORIZON = 4
WORKER_SHARE = 0.1  # of the stacks that are also put on workers


def letters(statement):
    """A toy sentence encoder."""
    return [statement.count(letter) for letter in "aeiou"]


SETTINGS = {
    "action_mask": ({},),
    "box_permutation": ({},),
    "channels_first": ({},),
    "flat_observation": ({},),
    "grid_planes": ({}, {"keep_image": True}),
    "image_observation": ({},),
    "multi_discrete_actions": ({}, {"masks": "slots"}),
    "nlvr_reward": ({},),
    "potential_shaping": ({"discount": 0.9},),
    "statement_embedding": ({"encoder": letters},),
    "steps_left": ({},),
    "stop_forcing": ({"mode": "mask"}, {"mode": "replace"}, {"mode": "observe"}),
    "structured_observation": ({}, {"keep_image": True}),
    "text_observation": ({}, {"scene": "both"}, {"legal_actions": False}),
    "tokenized_statement": ({}, {"length": 40}),
}


def random_stack(rng):
    return [(name, rng.choice(SETTINGS[name])) for name in rng.choices(list(SETTINGS), k=rng.randint(1, 4))]


def stacked(make, stack):
    """The environment that `make` gives, with the stack on it."""
    env = make()
    for name, settings in stack:
        env = getattr(wrappers, f"{name}_v0")(env, **settings)
    return env


def made(make):
    """The environment, or the kind of error with which it was refused."""
    try:
        return make()
    except (ValueError, TypeError, gym.error.Error) as fault:
        return type(fault).__name__


def differences(configuration, stack, mode, *, workers):
    """Disagreements between the kinds of environments; "refused" alone if all refuse the stack."""
    id, settings = f"lilgym_mp/{configuration}-v0", {"corpus": "builtin", "split": "train", "horizon": HORIZON}
    single = partial(stacked, partial(gym.make, id, **settings), stack)

    def batch(make, **more):
        return stacked(partial(make, id, **more, **settings), stack)

    kinds = {"batch": partial(batch, gym.make_vec)}
    if workers:
        kinds["workers"] = partial(batch, WorkerVectorEnv, num_workers=2)
    expected = made(single)
    for kind, make in kinds.items():
        found = made(partial(make, num_envs=N, autoreset_mode=mode))
        if isinstance(expected, str) or isinstance(found, str):
            yield "refused" if found == expected else f"{kind} gives {found}, single environments {expected}"
            continue
        found.close()
        try:
            check_vector_env(make, single, num_envs=N, modes=[mode], exact_masks=False, steps=STEPS)
        except AssertionError as error:
            yield f"{kind}: {error}"


def compare(count, seed):
    """Compares the kinds of environments on `count` random stacks. Returns what was compared, and the differences."""
    rng = random.Random(seed)
    compared = Counter()
    found = []
    for stack in (random_stack(rng) for _ in range(count)):
        configuration = rng.choice(list(CONFIGURATIONS))
        mode = rng.choice((AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP))
        workers = rng.random() < WORKER_SHARE
        differing = list(differences(configuration, stack, mode, workers=workers))
        compared["refused by all" if set(differing) == {"refused"} else "played"] += 1
        compared["also by workers"] += workers
        if set(differing) != {"refused"}:
            found.extend(f"{configuration}, {mode.name}, {stack}: {each}" for each in differing)
    return compared, found
