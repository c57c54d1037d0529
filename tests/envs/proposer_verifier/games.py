"""A small game for the tests, with one task."""

from collections import namedtuple

import numpy as np

from lilgym_mp.corpus import Provenance, TaskSet
from lilgym_mp.envs.proposer_verifier import Game, GameSettings, Intent, Role
from lilgym_mp.envs.proposer_verifier.game_arrays import GameArrays
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Colour, Scene
from lilgym_mp.scene.actions import STOP, AddBlock, RemoveBlock
from lilgym_mp.scene.appearances import Tower

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
REJECT, ACCEPT = 0, 1
CONTINUE, STOP_NOW = 0, 1
WAIT = TOWER.action_count  # the proposer's, in turn-based games without messages
ACTIONS = {
    "blue": ADD_BLUE,
    "black": ADD_BLACK,
    "remove": REMOVE_FROM_EMPTY,  # which is invalid
    "STOP": STOPS,
    "wait": WAIT,
    "reject": REJECT,
    "accept": ACCEPT,
    "waits": 2,  # the verifier
    "continue": CONTINUE,
    "halt": STOP_NOW,
    "refuse": 0,
    "believe": 1,
}


def game(**settings):
    return Game(GameSettings.of(settings)).with_tasks(TASKS)


# One turn of a game. Pairs are by Role; the outcome is None if the MDP took no step.
Step = namedtuple("Step", "state movers messages rewards terminated truncated outcome illegal judgement")


class OneGame:
    """A game of the only task, played with the actions of the agents to move."""

    def __init__(self, game, intent=Intent.HELPFUL):
        self.games = GameArrays(game.revealing_truth(), 1)
        self.games.start(np.zeros(1, int), np.zeros(1, int), np.array([intent]))

    @property
    def movers(self):
        return self.games.movers_of(0)

    def step(self, *actions):
        """Plays a turn; for an agent out of turn, 0."""
        games, movers, given = self.games, self.movers, iter(actions)
        games.step(*(np.array([next(given) if role in movers else 0]) for role in Role))
        illegal = tuple(role in movers and "illegal_choice" in games.infos(0)[role] for role in Role)
        rewards = tuple(games.rewards[:, 0].tolist())
        ends = bool(games.terminated[0]), bool(games.truncated[0])
        state, messages = games.state(0), tuple(games.messages[:, 0].tolist())
        return Step(
            state, self.movers, messages, rewards, *ends, games.last_outcome(0), illegal, games.last_judgement(0)
        )


def final_step(game, *actions, intent=Intent.HELPFUL):
    """The last step of a game with these actions; pairs in the simultaneous protocol."""
    return all_steps(game, *actions, intent=intent)[-1]


def all_steps(game, *actions, intent=Intent.HELPFUL):
    """All steps of a game with these actions."""
    played = OneGame(game, intent)
    return [played.step(*action) if isinstance(action, tuple) else played.step(action) for action in actions]
