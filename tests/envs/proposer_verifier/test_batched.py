"""BatchedGames equals single games, which are batches of one stepped as scalars."""

import copy
import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest

from lilgym_mp.corpus import TaskSet
from lilgym_mp.envs.observation import row_of
from lilgym_mp.envs.proposer_verifier import AGENTS, BatchedGames, TurnError, parallel_env
from lilgym_mp.envs.proposer_verifier.progress import GoalDistance
from lilgym_mp.envs.rules import State
from lilgym_mp.evaluation import Settings
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import ActionError, RemoveBlock
from lilgym_mp.testing import assert_same
from tests.envs.proposer_verifier.games import (
    ACTIONS,
    ADD_BLACK,
    ADD_BLUE,
    CONTINUE,
    STOP_NOW,
    STOPS,
    TASKS,
    TOWER,
)

PROPOSER, VERIFIER = AGENTS
REMOVE_LEFT = TOWER.encode(RemoveBlock(0))
GAMES = 8  # enough for compiled code
# Actions of a veto game of the task "Some block is blue."; infos after them. The verifier's last answer earned -0.1.
VETO_GAME = """
blue waits  | turns=[0, 1] proposal=3  verdict=-1 goal_reached=0 own_turn_rewards=[0.0, 0.0]
wait reject | turns=[1, 0] proposal=-1 verdict=-1 goal_reached=0 own_turn_rewards=[-0.1, -0.1]
blue waits  | turns=[0, 1] proposal=3  verdict=-1 goal_reached=0 own_turn_rewards=[0.0, -0.1]
wait accept | turns=[1, 0] proposal=-1 verdict=-1 goal_reached=1 own_turn_rewards=[-0.1, -0.1]
STOP waits  | turns=[0, 1] proposal=0  verdict=-1 goal_reached=1 own_turn_rewards=[0.0, -0.1]
wait reject | turns=[1, 0] proposal=-1 verdict=0  goal_reached=1 own_turn_rewards=[-0.1, -0.1] holds=1
STOP waits  | turns=[0, 1] proposal=0  verdict=-1 goal_reached=1 own_turn_rewards=[0.0, -0.1]
wait accept | turns=[1, 0] proposal=-1 verdict=1  goal_reached=0 own_turn_rewards=[1.0, 1.0]   holds=1
"""


@pytest.mark.parametrize("count", [1, GAMES])
def test_infos__describe_each_turn_of_a_hand_worked_veto_game(count):
    games = BatchedGames(count, tasks=TASKS, protocol="veto", reveal_truth=True)
    games.reset(seed=0)
    for line in VETO_GAME.strip().splitlines():
        actions, expected = line.split("|")
        proposer, verifier = (np.full(count, ACTIONS[name]) for name in actions.split())
        *_, infos = games.step({PROPOSER: proposer, VERIFIER: verifier})
        for name, value in re.findall(r"(\w+)=(\[.*?\]|\S+)", expected):
            assert np.asarray(infos[name][-1], float).round(6).tolist() == json.loads(value), (line, name)
    assert infos["is_success"].all()


def test_tasks_and_sampler__choose_what_is_played():
    whole = BatchedGames(1).tasks
    some = TaskSet(list(whole)[5:9], whole.provenance)
    asked = []

    def sampler(indices):
        asked.append(indices.tolist())
        return np.full(len(indices), len(asked))

    games = BatchedGames(3, protocol="joint", tasks=some, sampler=sampler)
    _, infos = games.reset(seed=0)
    assert infos["task_index"].tolist() == [1, 1, 1]
    *_, infos = games.step({PROPOSER: np.full(3, ADD_BLUE), VERIFIER: np.array([CONTINUE, STOP_NOW, CONTINUE])})
    assert infos["task_index"].tolist() == [1, 2, 1]
    assert asked == [[0, 1, 2], [1]]
    with pytest.raises(ValueError, match=r"tower; tasks of scatter"):
        BatchedGames(1, tasks=BatchedGames(1, appearance="scatter").tasks)
    with pytest.raises(ValueError, match=r"3 task indices 0 \.\. 3, not array\(\[9, 9, 9\]\)"):
        BatchedGames(3, tasks=some, sampler=lambda indices: np.full(3, 9)).reset(seed=0)


def test_reset__options_set_task_and_intent_of_all_games():
    batch, single = BatchedGames(GAMES, rewards="hidden"), parallel_env(rewards="hidden")
    for task in (single.tasks.ids[3], replace(single.tasks[5], id="given", statement="A blue one.")):
        options = {"task": task, "intent": "deceptive"}
        observations, infos = batch.reset(options=options)
        assert_same(row_of(observations, -1), single.reset(options=options)[0])
        assert observations[PROPOSER]["observation"]["intent"].tolist() == [1] * GAMES
    assert set(infos["task_index"]) == {len(batch.tasks)}
    stops = {agent: np.full(GAMES, STOPS if agent == PROPOSER else STOP_NOW) for agent in AGENTS}
    ends = [batch.step(stops)[4] for _ in range(2)]
    assert ends[-1]["task_index"].max() < len(batch.tasks)  # the next games draw from the split


@pytest.mark.parametrize("copies", [True, False])
def test_images__are_reused_unless_copied_but_last_ones_are_kept(copies):
    batch = BatchedGames(2, protocol="joint", copy=copies)
    images = [batch.reset(seed=0)[0][PROPOSER]["observation"]["image"]]
    shown = images[0].copy()
    stop_one = {PROPOSER: np.array([ADD_BLUE, ADD_BLUE]), VERIFIER: np.array([CONTINUE, STOP_NOW])}
    observations, *_, infos = batch.step(stop_one)
    assert infos["final_observation"][0] is None
    last = infos["final_observation"][1][VERIFIER]["observation"]["image"]
    kept = last.copy()
    images.append(observations[VERIFIER]["observation"]["image"])
    batch.step(stop_one)
    assert (images[0] is images[1]) == (not copies)
    assert np.array_equal(images[0], shown) == copies
    assert np.array_equal(last, kept)


def test_step__refuses_invalid_batches_of_actions():
    batch = BatchedGames(2)
    for arguments in ({"seed": -1}, {"options": {"task": "nothing"}}, {"options": {"intent": "kind"}}):
        with pytest.raises(ValueError, match=r"not -1|'nothing'|'kind'; choose from deceptive, helpful"):
            batch.reset(**arguments)
    batch.reset(seed=0)
    with pytest.raises(TypeError, match="BatchedGames"):
        copy.deepcopy(batch)
    with pytest.raises(TurnError, match="for proposer_0 and verifier_0, not for no agent"):
        batch.step({})
    for given, message in (([0.0, 0.0], "float64"), ([0, 0, 0], "int64"), ([0, 14], "14 of"), ([0, -1], "-1 of")):
        with pytest.raises(ActionError, match=message):
            batch.step({PROPOSER: np.array(given), VERIFIER: np.array([2, 2])})


def test_progress__pays_each_step_towards_the_goal():
    """Of the task "Some block is blue.": an edit to nowhere, one that reaches the goal, and one that leaves it."""
    shaped = {PROPOSER: {"mdp": 1, "progress": 0.5}, VERIFIER: {"progress": 0.25}}
    games = BatchedGames(GAMES, tasks=TASKS, rewards=shaped, protocol="joint")
    games.reset(seed=0)
    for edit, progress in ((ADD_BLACK, 0), (ADD_BLUE, 1), (REMOVE_LEFT, -1)):
        actions = {PROPOSER: np.full(GAMES, edit), VERIFIER: np.full(GAMES, CONTINUE)}
        _, rewards, *_ = games.step(actions)
        assert rewards[PROPOSER] == pytest.approx(np.full(GAMES, -0.1 + 0.5 * progress))
        assert rewards[VERIFIER] == pytest.approx(np.full(GAMES, 0.25 * progress))


def test_goal_distance__counts_the_expert_s_actions_and_is_unknown_without_a_solution():
    distance = GoalDistance(Settings("TowerScratch").dynamics())
    programs = ("exist(filter_color(all_items, Color.BLUE))", "exist(filter_shape(all_items, Shape.CIRCLE))")
    blue, circle = (State(Task("", "", program, True, Scene.empty()), Scene.empty(), 3) for program in programs)
    assert distance(blue) == 2  # whatever the step
    assert math.isnan(distance(circle))
