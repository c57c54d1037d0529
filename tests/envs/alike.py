"""Compiled cores."""

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

CORES = {"tower": TowerCore, "scatter": ScatterCore}


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
