"""Demonstrations for imitation learning: solutions played out as episodes, and as arrays in one npz file."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lilgym_mp.envs.observation import item_array, item_capacity
from lilgym_mp.envs.rules import Dynamics, State
from lilgym_mp.programs.task import Task
from lilgym_mp.scene.actions import Action
from lilgym_mp.scene.render import Canvas
from lilgym_mp.solver.reports import TaskReport


class Demonstration(NamedTuple):
    """One successful episode of the expert."""

    task: Task
    actions: tuple[Action, ...]
    states: tuple[State, ...]  # before each action; STOP, the last, changes nothing
    rewards: tuple[float, ...]
    terminated: bool
    truncated: bool
    proven_optimal: bool


def demonstration(report: TaskReport, dynamics: Dynamics) -> Demonstration:
    """Plays out the solution of a solved task."""
    task, solution, _ = report
    states: list[State] = []
    rewards: list[float] = []
    state = dynamics.start(task)
    terminated = truncated = False
    for action in solution.actions:
        states.append(state)
        state, (_, _, reward, terminated, truncated, _), _ = dynamics.step(state, action)
        rewards.append(reward)
    proven = solution.proven_optimal
    return Demonstration(task, solution.actions, tuple(states), tuple(rewards), terminated, truncated, proven)


def demonstrations(reports: Iterable[TaskReport], dynamics: Dynamics) -> list[Demonstration]:
    """A demonstration of each solved task, in order."""
    return [demonstration(report, dynamics) for report in reports if report.solution.solved]


def drawn_tasks(tasks: Sequence[Task], episodes: int, seed: int) -> list[Task]:
    """`episodes` tasks drawn uniformly with replacement. Raises ValueError for fewer than one."""
    if episodes < 1:
        raise ValueError(f"episodes must be at least 1, not {episodes}")
    return [tasks[index] for index in np.random.default_rng(seed).integers(len(tasks), size=episodes).tolist()]


def arrays(episodes: Sequence[Demonstration], dynamics: Dynamics, *, images: bool = False) -> dict[str, Any]:
    """N episodes with M actions in total, as arrays; the actions of episode i are at `starts[i]:starts[i + 1]`.

    Raises ValueError for no episodes.
    """
    if not episodes:
        raise ValueError("there are no demonstrations: none of the tasks was solved")
    appearance = dynamics.appearance
    tasks = [episode.task for episode in episodes]
    states = [state for episode in episodes for state in episode.states]
    actions = [action for episode in episodes for action in episode.actions]
    capacity = item_capacity(tasks, dynamics)
    found: dict[str, Any] = {
        "task": np.array([task.id for task in tasks]),
        "statement": np.array([task.statement for task in tasks]),
        "program": np.array([task.program for task in tasks]),
        "target": np.array([task.target for task in tasks]),
        "proven_optimal": np.array([episode.proven_optimal for episode in episodes]),
        "starts": np.cumsum([0, *(len(episode.actions) for episode in episodes)]),  # (N + 1,)
        "action": np.array([appearance.encode(action) for action in actions], np.int32),  # (M,)
        "action_array": np.array([appearance.to_array(action) for action in actions], np.int16),  # (M, 3 or 6)
        "reward": np.array([reward for episode in episodes for reward in episode.rewards], np.float32),  # (M,)
        "items": np.stack([item_array(state.scene, capacity) for state in states]),  # (M, 3, capacity, 5)
    }
    if images:
        canvas = Canvas("half")
        found["image"] = np.stack([canvas.show(state.scene).copy() for state in states])  # (M, 50, 190, 3)
    return found


def write_npz(path: Path, arrays: Mapping[str, Any], about: Mapping[str, Any]) -> None:
    """Writes a compressed npz file of the arrays, and of `about` as JSON. Equal content yields equal bytes."""
    text = json.dumps(about, ensure_ascii=False, sort_keys=True)
    with path.open("wb") as file:
        np.savez_compressed(file, about=np.array(text), **arrays)
