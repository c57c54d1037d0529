"""Helpers of the solver's tests: tasks, MDPs, playing actions, and exhaustive trial."""

import random

from lilgym_mp.envs.rules import Outcome, make_dynamics
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.scene.appearances import RELEASED_GRID, make_appearance
from lilgym_mp.solver import Solver


def task(program, start=None, *, target=True):
    return Task("one", "A statement.", program, target, start or Scene.empty())


def mdp(appearance, rules="paper", horizon=None, grid=RELEASED_GRID):
    return make_dynamics(make_appearance(appearance, grid), rules, horizon)


def played(dynamics, state, actions):
    """The transition of the last action; none before it may end the episode."""
    *edits, last = actions
    for edit in edits:
        transition = dynamics.step(state, edit)
        assert transition.outcome is Outcome.CONTINUES, edit
        state = transition.state
    return dynamics.step(state, last)


def after_random_edits(dynamics, state, edits, seed):
    """The state after `edits` random legal edits."""
    rng = random.Random(seed)
    for _ in range(edits):
        action = rng.choice(dynamics.legal_mask(state).nonzero()[0][1:].tolist())
        state = dynamics.step(state, dynamics.appearance.decode(action)).state
    return state


def layers_by_trial(dynamics, state, max_edits):
    """The states that 0, 1, ... `max_edits` legal edits reach, each with the first actions to it, by scene."""
    layer = {state.scene: (state, set())}
    yield layer
    for _ in range(max_edits):
        following = {}
        for before, firsts in layer.values():
            for action in dynamics.legal_mask(before).nonzero()[0][1:].tolist():
                after = dynamics.step(before, dynamics.appearance.decode(action)).state
                following.setdefault(after.scene, (after, set()))[1].update(firsts or {action})
        yield following
        layer = following


def optimal_by_trial(dynamics, state, max_edits):
    """The distance to the nearest goal and the optimal first actions, breadth-first over all legal actions."""
    for edits, layer in enumerate(layers_by_trial(dynamics, state, max_edits)):
        reached = [firsts for after, firsts in layer.values() if dynamics.goal_reached(after)]
        if reached:
            return edits, set().union(*reached) or {0}
    return None, set()


def check_optimal_actions(dynamics, state, max_edits):
    """The expert finds the optimal first actions, all of them; there must be some. Returns the distance."""
    edits, firsts = optimal_by_trial(dynamics, state, max_edits)
    found = Solver(dynamics).optimal_actions(state)
    assert (set(found.actions), found.complete, found.steps) == (firsts, True, edits + 1)
    return edits
