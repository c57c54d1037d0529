"""Compares the action mask with `Dynamics.step` for every action in many scenes, and counts errors.

Half of the scenes are start scenes of the builtin corpus; the others come from random valid edits of these and of the
empty scene.
"""

import random
from itertools import product

from lilgym_mp.corpus import load_all_tasks
from lilgym_mp.envs.rules import RULE_SETS, Outcome, State, make_dynamics
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import AddBlock, AddItem
from lilgym_mp.scene.appearances import APPEARANCES, make_appearance

TASK = Task("any", "There is something.", "exist(all_items)", True, Scene.empty())
MAX_EDITS = 12
REMOVE_SHARE = 0.3  # of the edits tried, so that boxes do not just fill up


def start_scenes(appearance):
    """The distinct start scenes of the builtin corpus, after the empty scene."""
    starts = (task.start for tasks in load_all_tasks("builtin", [appearance], ["flipit"]) for task in tasks)
    return [make_appearance(appearance).check_scene(Scene.empty()), *dict.fromkeys(starts)]


def played_scenes(dynamics, starts, count, rng):
    """The scenes after each valid edit of random episodes, start scenes excluded."""
    found = []
    while len(found) < count:
        scene = rng.choice(starts) if rng.random() < 0.7 else starts[0]
        for _ in range(MAX_EDITS):
            scene = _after_valid_edit(dynamics, scene, rng)
            found.append(scene)
    return found[:count]


def _after_valid_edit(dynamics, scene, rng):
    """The scene after a random edit that is valid according to `apply`, not the mask."""
    appearance, placement = dynamics.appearance, dynamics.rules.placement
    while True:
        adds = rng.random() >= REMOVE_SHARE
        action = appearance.decode(rng.randrange(1, appearance.action_count))
        if isinstance(action, AddBlock | AddItem) == adds:
            edit = appearance.apply(scene, action, placement)
            if edit.invalid is None:
                return edit.scene


def scenes_of(dynamics, count, *, start_share=0.5, seed=0):
    """Scenes to check: the empty one, up to `start_share` start scenes, and the others from random play."""
    rng = random.Random(seed)
    starts = start_scenes(dynamics.appearance.name)
    chosen = [starts[0], *rng.sample(starts[1:], min(int(start_share * count), len(starts)) - 1)]
    return chosen + played_scenes(dynamics, starts, count - len(chosen), rng)


def wrong_actions(dynamics, scene, actions=None):
    """The actions, of those args or all, about which the mask and a step disagree."""
    state = State(TASK, scene, 0)
    mask = dynamics.legal_mask(state).tolist()
    decode, step = dynamics.appearance.decode, dynamics.step
    return [
        index
        for index in (range(len(mask)) if actions is None else actions)
        if (step(state, decode(index)).outcome is not Outcome.INVALID_ACTION) != mask[index]
    ]


def compare(count, seed):
    """The actions tried in `count` scenes by appearance and rule set, and those about which the mask is wrong."""
    tried = {}
    wrong = []
    for appearance, rules in product(sorted(APPEARANCES), sorted(RULE_SETS)):
        dynamics = make_dynamics(make_appearance(appearance), rules)
        scenes = scenes_of(dynamics, count, seed=seed)
        tried[f"{appearance} {rules}"] = len(scenes) * dynamics.appearance.action_count
        for scene in scenes:
            found = wrong_actions(dynamics, scene)
            wrong += [f"{rules}: {dynamics.appearance.decode(index)} in {scene.to_json()}" for index in found]
    return tried, wrong
