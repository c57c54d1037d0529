"""BatchedGames equals single games, which are batches of one stepped as scalars."""

from __future__ import annotations

import copy
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from gymnasium.error import ResetNeeded

from lilgym_mp.corpus import TaskSet
from lilgym_mp.envs.proposer_verifier import AGENTS, PROTOCOLS, BatchedGames, TurnError, parallel_env
from lilgym_mp.envs.proposer_verifier.progress import GoalDistance
from lilgym_mp.envs.rules import State
from lilgym_mp.evaluation import Settings
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import ActionError
from lilgym_mp.solver import Solver
from tests.envs.proposer_verifier.games import ACCEPT, ADD_BLUE, CONTINUE, REJECT, STOP_NOW, STOPS, TASKS, WAIT

PROPOSER, VERIFIER = AGENTS
GAMES, STEPS, SEED = 8, 15, 11  # enough games for compiled code
VERIFIER_WAITS = 2
SETTINGS: list[dict[str, Any]] = [
    *({"protocol": protocol, "rewards": "hidden", "message_size": 1} for protocol in PROTOCOLS),
    {"protocol": "veto", "rules": "release", "start": "flipit", "reveal_truth": True},
    {"protocol": "joint", "appearance": "scatter", "start": "flipit", "reveal_truth": True, "homogeneous": True},
    {"protocol": "audit", "rewards": "correctness"},
]


def an_action(mask: np.ndarray, rng: np.random.Generator) -> int:
    """Usually a legal action."""
    return int(rng.choice(np.flatnonzero(mask)) if rng.random() < 0.9 else rng.integers(len(mask)))


@pytest.mark.parametrize("settings", SETTINGS, ids=str)
def test_infos__describe_each_games_turn(settings: dict[str, Any]):
    batch = BatchedGames(GAMES, copy=False, **settings)
    singles = [parallel_env(**settings) for _ in range(GAMES)]
    rng = np.random.default_rng(0)
    _, infos = batch.reset(seed=SEED)
    seen = [single.reset(seed=SEED + index)[0] for index, single in enumerate(singles)]
    for _ in range(STEPS):
        for index, single in enumerate(singles):
            state = single.engine.state
            assert infos["turns"][index].tolist() == [role in single.engine.movers for role in (0, 1)]
            assert batch.tasks[infos["task_index"][index]] == state.mdp.task
            assert infos["proposal"][index] == (-1 if state.proposal is None else state.proposal)
            assert infos.get("goal_reached", {index: None})[index] in (None, state.mdp.task.solved_by(state.mdp.scene))
        actions = [{agent: an_action(each[agent]["action_mask"], rng) for agent in AGENTS} for each in seen]
        *_, infos = batch.step({agent: np.array([action[agent] for action in actions]) for agent in AGENTS})
        for index, (single, action) in enumerate(zip(singles, actions, strict=True)):
            seen[index], *_, info = single.step(action)
            assert infos["is_success"][index] == info[PROPOSER].get("is_success", False)
            judgement = single.engine.games.last_judgement(0)
            assert infos["verdict"][index] == (-1 if judgement is None else judgement.accepted)
            if judgement is not None:
                assert infos.get("holds", {index: judgement.holds})[index] == judgement.holds
            if not single.agents:
                seen[index], _ = single.reset()


def test_own_turn_rewards__of_a_hand_worked_veto_game():
    """A rejected and an accepted edit, then a rejected and an accepted STOP, of the task "Some block is blue."."""
    games = BatchedGames(1, tasks=TASKS, protocol="veto")
    games.reset(seed=0)
    found: list[list[float]] = []
    for proposal, answer in ((ADD_BLUE, REJECT), (ADD_BLUE, ACCEPT), (STOPS, REJECT), (STOPS, ACCEPT)):
        for proposer, verifier in ((proposal, VERIFIER_WAITS), (WAIT, answer)):
            *_, infos = games.step({PROPOSER: np.array([proposer]), VERIFIER: np.array([verifier])})
            found.append(infos["own_turn_rewards"][0].round(6).tolist())
    proposed = [[0.0, 0.0], [0.0, -0.1], [0.0, -0.1], [0.0, -0.1]]  # the verifier's last answer earned -0.1
    answered = [[-0.1, -0.1], [-0.1, -0.1], [-0.1, -0.1], [1.0, 1.0]]
    assert found == [row for pair in zip(proposed, answered, strict=True) for row in pair]


def test_refused__shows_the_proposal_until_an_action_is_played():
    game = parallel_env(protocol="veto")
    seen, _ = game.reset(seed=0)
    refused: list[list[int]] = []
    for proposer, verifier in ((ADD_BLUE, 2), (WAIT, REJECT), (ADD_BLUE, 2), (WAIT, ACCEPT)):
        seen, *_ = game.step({PROPOSER: proposer, VERIFIER: verifier})
        refused.append(seen[PROPOSER]["observation"]["refused"].tolist())
    assert refused == [[-1, -1, -1], [1, 0, 2], [1, 0, 2], [-1, -1, -1]]


def test_proposed_scene__is_the_scene_after_the_proposal():
    game = parallel_env(protocol="veto", views={"scene": "structured", "proposed_scene": True})
    game.reset(seed=0)
    seen, *_ = game.step({PROPOSER: ADD_BLUE, VERIFIER: 2})
    view = seen[VERIFIER]["observation"]
    assert (view["item_array"] == -1).all()
    assert view["proposed_item_array"][0, 0].tolist() == [40, 80, 1, 2, 1]


def test_tasks_and_sampler__choose_what_is_played():
    whole = BatchedGames(1).tasks
    some = TaskSet(list(whole)[5:9], whole.provenance)
    asked: list[list[int]] = []

    def sampler(indices: np.ndarray) -> np.ndarray:
        asked.append(indices.tolist())
        return np.full(len(indices), len(asked))

    games = BatchedGames(3, protocol="joint", tasks=some, sampler=sampler)
    _, infos = games.reset(seed=0)
    assert infos["task_index"].tolist() == [1, 1, 1]
    *_, infos = games.step({PROPOSER: np.full(3, ADD_BLUE), VERIFIER: np.array([CONTINUE, STOP_NOW, CONTINUE])})
    assert infos["task_index"].tolist() == [1, 2, 1]
    assert asked == [[0, 1, 2], [1]]
    with pytest.raises(ValueError, match=r"the game is played on tower; tasks of scatter do not fit it"):
        BatchedGames(1, tasks=BatchedGames(1, appearance="scatter").tasks)
    with pytest.raises(ValueError, match=r"the sampler must return 3 task indices 0 \.\. 3, not array\(\[9, 9, 9\]\)"):
        BatchedGames(3, tasks=some, sampler=lambda indices: np.full(3, 9)).reset(seed=0)


def test_reset__options_set_task_and_intent_of_all_games():
    batch, single = BatchedGames(GAMES, rewards="hidden"), parallel_env(rewards="hidden")
    for task in (single.tasks.ids[3], replace(single.tasks[5], id="given", statement="A blue one.")):
        options = {"task": task, "intent": "deceptive"}
        observations, infos = batch.reset(options=options)
        expected, _ = single.reset(options=options)
        for agent in AGENTS:
            for key, part in expected[agent]["observation"].items():
                assert np.array_equal(observations[agent]["observation"][key], np.stack([part] * GAMES))
        assert observations[PROPOSER]["observation"]["intent"].tolist() == [1] * GAMES
    assert set(infos["task_index"]) == {len(batch.tasks)}
    stops = {agent: np.full(GAMES, STOPS if agent == PROPOSER else STOP_NOW) for agent in AGENTS}
    ends = [batch.step(stops)[4] for _ in range(2)]
    assert ends[-1]["task_index"].max() < len(batch.tasks)  # the next games draw from the split
    with pytest.raises(ValueError, match="no task 'nothing'"):
        batch.reset(options={"task": "nothing"})
    with pytest.raises(ValueError, match="unknown intent 'kind'; choose from deceptive, helpful"):
        batch.reset(options={"intent": "kind"})


def test_final_observations__are_of_the_games_that_ended():
    batch = BatchedGames(3, protocol="joint")
    batch.reset(seed=0)
    *_, infos = batch.step({PROPOSER: np.full(3, ADD_BLUE), VERIFIER: np.array([CONTINUE, STOP_NOW, CONTINUE])})
    assert [observation is None for observation in infos["final_observation"]] == [True, False, True]


@pytest.mark.parametrize("copies", [True, False])
def test_images__are_reused_unless_copied_but_last_ones_are_kept(copies: bool):
    batch = BatchedGames(2, protocol="joint", copy=copies)
    images = [batch.reset(seed=0)[0][PROPOSER]["observation"]["image"]]
    shown = images[0].copy()
    stop_one = {PROPOSER: np.array([ADD_BLUE, ADD_BLUE]), VERIFIER: np.array([CONTINUE, STOP_NOW])}
    observations, *_, infos = batch.step(stop_one)
    last = infos["final_observation"][1][VERIFIER]["observation"]["image"]
    kept = last.copy()
    images.append(observations[VERIFIER]["observation"]["image"])
    batch.step(stop_one)
    assert (images[0] is images[1]) == (not copies)
    assert np.array_equal(images[0], shown) == copies
    assert np.array_equal(last, kept)


def test_step__refuses_invalid_batches_of_actions():
    batch = BatchedGames(2)
    for arguments in ({"seed": -1}, {"options": {"task": "nothing"}}, {"options": {"tasks": "1"}}):
        with pytest.raises(ValueError, match=r"a seed must be|no task|choose from task, intent"):
            batch.reset(**arguments)
    with pytest.raises(ResetNeeded):
        batch.step({PROPOSER: np.zeros(2, int), VERIFIER: np.zeros(2, int)})
    batch.reset(seed=0)
    with pytest.raises(TypeError, match="a BatchedGames cannot be pickled or copied"):
        copy.deepcopy(batch)
    with pytest.raises(TurnError, match="actions must be for proposer_0 and verifier_0, not for no agent"):
        batch.step({})
    with pytest.raises(ActionError, match="actions of verifier_0 must be 2 whole numbers, not float64"):
        batch.step({PROPOSER: np.zeros(2, int), VERIFIER: np.zeros(2)})
    with pytest.raises(ActionError, match="actions of proposer_0 must be 2 whole numbers, not int64"):
        batch.step({PROPOSER: np.zeros(3, int), VERIFIER: np.zeros(2, int)})
    for beyond in (14, -1):
        with pytest.raises(ActionError, match=f"action {beyond} of proposer_0 is out of range"):
            batch.step({PROPOSER: np.array([0, beyond]), VERIFIER: np.array([2, 2])})


@pytest.mark.parametrize("protocol", ["veto", "joint", "critique", "audit"])
def test_progress__pays_each_step_towards_the_goal(protocol: str):
    settings: dict[str, Any] = {"protocol": protocol, "configuration": "TowerFlipIt", "split": "dev"}
    shaped = {PROPOSER: {"mdp": 1, "progress": 0.5}, VERIFIER: {"progress": 0.25}}
    batch, plain = BatchedGames(8, rewards=shaped, **settings), BatchedGames(8, rewards="common", **settings)
    solver = Solver(batch._game.dynamics)
    observations, _ = batch.reset(seed=0)
    plain.reset(seed=0)
    rng, has_paid = np.random.default_rng(0), False
    for _ in range(30):
        before = [batch._games.mdp(index) for index in range(8)]
        masks = [observations[agent]["action_mask"] for agent in (PROPOSER, VERIFIER)]
        chosen = [np.array([rng.choice(np.flatnonzero(row)) for row in mask]) for mask in masks]
        actions = dict(zip((PROPOSER, VERIFIER), chosen, strict=True))
        observations, rewards, terminated, truncated, _ = batch.step(actions)
        _, unshaped, *_ = plain.step(actions)
        for index, state in enumerate(before):
            if (terminated | truncated)[index]:
                continue
            after = batch._games.mdp(index)
            length, left = (solver.solve_from(each._replace(steps=0)).steps for each in (state, after))
            progress = length - left if length and left else 0  # where no solution is found, it is unknown
            has_paid |= progress != 0
            assert rewards[PROPOSER][index] == pytest.approx(unshaped[PROPOSER][index] + 0.5 * progress)
            assert rewards[VERIFIER][index] == pytest.approx(0.25 * progress)
    assert has_paid


def test_goal_distance__counts_the_expert_s_actions_and_is_unknown_without_a_solution():
    distance = GoalDistance(Settings("TowerScratch").dynamics())
    programs = ("exist(filter_color(all_items, Color.BLUE))", "exist(filter_shape(all_items, Shape.CIRCLE))")
    blue, circle = (State(Task("", "", program, True, Scene.empty()), Scene.empty(), 3) for program in programs)
    assert distance(blue) == 2  # whatever the step
    assert math.isnan(distance(circle))
