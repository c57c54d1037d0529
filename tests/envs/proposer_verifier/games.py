"""A small game for the tests, with one task."""

from lilgym_mp.corpus import Provenance, TaskSet
from lilgym_mp.envs.proposer_verifier import Game, GameSettings, Role
from lilgym_mp.envs.proposer_verifier.engine import GameEngine
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


def played(game, *turns, intent="helpful"):
    """The engine after these turns of the only task, and the turns' results. A turn is the action of the agent to move;
    in the simultaneous protocol, a pair."""
    engine = GameEngine(game.revealing_truth())
    engine.reset(0, {"intent": intent})
    results = []
    for turn in turns:
        given = iter(turn if isinstance(turn, tuple) else [turn])
        results.append(engine.step(*(next(given) if role in engine.movers else None for role in Role)))
    return engine, results
