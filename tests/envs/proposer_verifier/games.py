"""A small game for the tests, with one task."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from lilgym_mp.actions import STOP, AddBlock, RemoveBlock
from lilgym_mp.appearances import Tower
from lilgym_mp.corpus import Provenance, TaskSet
from lilgym_mp.envs.proposer_verifier import Game, GameSettings, Intent, Role
from lilgym_mp.envs.proposer_verifier.game import GameState, GameStep
from lilgym_mp.envs.proposer_verifier.views import GameSetup
from lilgym_mp.scene import Colour, Scene
from lilgym_mp.task import Task

TOWER = Tower()
SOME_BLUE = Task(
    "some-blue",
    "Some block is blue.",
    "exist(filter_color(all_items, Color.BLUE))",
    True,
    TOWER.check_scene(Scene.empty()),
)
TASKS = TaskSet([SOME_BLUE], Provenance("test", "test", "test", "tower", "scratch", "train", ""))

STOPS = TOWER.encode(STOP)
ADD_BLUE = TOWER.encode(AddBlock(0, Colour.BLUE))
ADD_BLACK = TOWER.encode(AddBlock(1, Colour.BLACK))
REMOVE_FROM_EMPTY = TOWER.encode(RemoveBlock(2))
REJECT, ACCEPT, VERIFIER_STOPS = 0, 1, 2
CONTINUE, STOP_NOW = 0, 1
WAIT = TOWER.action_count  # the proposer's, in turn-based games without messages


def setup(**settings: Any) -> GameSetup:
    return replace(GameSettings.of(**settings).setup(), tasks=TASKS)


def game(**settings: Any) -> Game:
    return setup(**settings).game


def final_step(game: Game, *actions: int | tuple[int, int], intent: Intent = Intent.HELPFUL) -> GameStep:
    """The last step of a game with these actions; pairs in the simultaneous protocol."""
    return all_steps(game, *actions, intent=intent)[-1]


def all_steps(game: Game, *actions: int | tuple[int, int], intent: Intent = Intent.HELPFUL) -> list[GameStep]:
    """All steps of a game with these actions."""
    state: GameState = game.start(SOME_BLUE, intent)
    steps: list[GameStep] = []
    for action in actions:
        if isinstance(action, tuple):
            step = game.step(state, *action)
        elif state.movers == (Role.PROPOSER,):
            step = game.step(state, action)
        else:
            step = game.step(state, None, action)
        steps.append(step)
        state = step.state
    return steps
