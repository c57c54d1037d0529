"""Helpers of the solver's tests: tasks, MDPs, playing actions, and exhaustive trial."""

import random

from lilgym_mp.envs.rules import Outcome, make_dynamics
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.scene.appearances import RELEASED_GRID, make_appearance


def task(program, start=None, *, target=True):
    return Task("one", "A statement.", program, target, start or Scene.empty())


def mdp(appearance, rules="paper", horizon=None, grid=RELEASED_GRID):
    return make_dynamics(make_appearance(appearance, grid), rules, horizon)


def outcome(dynamics, state, actions):
    """The outcome of the last action; none before it may end the episode."""
    *edits, last = actions
    for edit in edits:
        transition = dynamics.step(state, edit)
        assert transition.outcome is Outcome.CONTINUES, edit
        state = transition.state
    return dynamics.step(state, last).outcome


def after_random_edits(dynamics, state, edits, seed):
    """The state after `edits` random legal edits."""
    rng = random.Random(seed)
    for _ in range(edits):
        action = rng.choice(dynamics.legal_mask(state).nonzero()[0][1:].tolist())
        state = dynamics.step(state, dynamics.appearance.decode(action)).state
    return state


def optimal_by_trial(dynamics, state, max_edits):
    """The distance to the nearest goal and the optimal first actions, breadth-first over all legal actions."""
    if dynamics.goal_reached(state):
        return 0, {0}
    layer = {state.scene: (state, set())}  # with the first actions to each
    for edits in range(1, max_edits + 1):
        next_layer = {}
        for before, firsts in layer.values():
            for action in dynamics.legal_mask(before).nonzero()[0][1:].tolist():
                after = dynamics.step(before, dynamics.appearance.decode(action)).state
                next_layer.setdefault(after.scene, (after, set()))[1].update(firsts or {action})
        reached = [firsts for after, firsts in next_layer.values() if dynamics.goal_reached(after)]
        if reached:
            return edits, set().union(*reached)
        layer = next_layer
    return None, set()
