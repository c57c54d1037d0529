"""Random actions, compiled cores, and forks."""

import multiprocessing
import os

import numpy as np
from gymnasium.vector import AutoresetMode

from lilgym_mp.corpus import TaskSet
from lilgym_mp.corpus.tasks import Provenance
from lilgym_mp.envs.buffers import Buffers, buffer_specs
from lilgym_mp.envs.cores.scatter import ScatterCore
from lilgym_mp.envs.cores.tower import TowerCore
from lilgym_mp.envs.observation import item_capacity
from lilgym_mp.envs.rules import make_dynamics
from lilgym_mp.scene.appearances import make_appearance

STOP_SHARE, ANY_SHARE = 0.1, 0.05  # of random actions: STOP, and any at all; the others are legal
CORES = {"tower": TowerCore, "scatter": ScatterCore}


def random_actions(masks, generator):
    """(N,) mostly legal actions for masks (N, actions)."""
    legal = [generator.choice(np.flatnonzero(mask)) for mask in masks]
    count, actions = masks.shape
    kinds = generator.random(count)
    edits = np.where(kinds < STOP_SHARE + ANY_SHARE, generator.integers(actions, size=count), legal)
    return np.where(kinds < STOP_SHARE, 0, edits)


def started_core(appearance, tasks, horizon=100):
    """A compiled core in which each environment has begun one of the tasks, and its buffers."""
    core, buffers = compiled_core(make_dynamics(make_appearance(appearance), "paper", horizon), tasks)
    core.start(np.arange(len(tasks)), np.arange(len(tasks)))
    return core, buffers


def compiled_core(dynamics, tasks):
    """A compiled core with an environment for each task, and its buffers."""
    actions, capacity = dynamics.appearance.action_count, item_capacity(tasks, dynamics)
    buffers = Buffers.new(buffer_specs(len(tasks), "half", actions, capacity, AutoresetMode.NEXT_STEP))
    own = TaskSet(tasks, Provenance("own", "own", "own", "any", "any", "train", "0" * 64))
    return CORES[dynamics.appearance.name](dynamics, own, buffers, "half"), buffers


def in_fork(use):
    """What a function gives, or raises, in a forked child, as `repr` shows it."""
    hear, tell = multiprocessing.Pipe(duplex=False)

    def tried():
        try:
            tell.send(repr(use()))
        except BaseException as fault:
            tell.send(repr(fault))
        os._exit(0)

    child = multiprocessing.get_context("fork").Process(target=tried)
    child.start()
    child.join()
    return hear.recv()
