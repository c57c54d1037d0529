"""/play: solve tasks by hand under the environment's rules and rewards.

The database stores an episode's task and actions; its MDP state is rebuilt by replaying them.
"""

from __future__ import annotations

import secrets
import sqlite3
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from fastapi import APIRouter, Depends, HTTPException, Request, Response
from pydantic import BaseModel, Field

from lilgym_mp.contrib.web.app_services import AppServices, Services
from lilgym_mp.contrib.web.bodies import (
    JSON,
    ConfigurationName,
    Name,
    RandomId,
    SplitName,
    parts_body,
    pick,
    removable_items,
    scene_body,
    steps_body,
)
from lilgym_mp.contrib.web.database import PlayedEpisode, find_episode, save_episode
from lilgym_mp.contrib.web.responses import refusing, render_page
from lilgym_mp.corpus.matching import well_spelt_ids
from lilgym_mp.envs.rules import Dynamics, Outcome, State
from lilgym_mp.programs.task import Task
from lilgym_mp.scene.actions import describe, named
from lilgym_mp.scene.appearances import InvalidReason

router = APIRouter()
api = APIRouter(prefix="/api/play", tags=["play"])

INVALID_EXPLANATIONS = {
    InvalidReason.SEPARATOR: "items cannot lie between the boxes",
    InvalidReason.OVERLAP: "the item would overlap another one",
    InvalidReason.OUT_OF_BOX: "the item would not fit into its box there",
    InvalidReason.FULL_TOWER: "this tower is full",
    InvalidReason.EMPTY_TOWER: "there is no block to remove",
    InvalidReason.NOTHING_TO_REMOVE: "there is no item to remove",
}
OUTCOME_EXPLANATIONS = {
    Outcome.SUCCESS: "You stopped when the statement had the target truth value.",
    Outcome.WRONG_STOP: "You stopped, but the statement does not have the target truth value.",
    Outcome.HORIZON: "You used the last action allowed, and it was not STOP.",
}


class NewEpisode(BaseModel):
    """Settings of an episode; without `task_id` a random task is drawn."""

    configuration: ConfigurationName = "TowerFlipIt"
    split: SplitName = "dev"
    task_id: Name | None = None
    player: Name = Field("", description="stored with the episode")


class ActionTaken(BaseModel):
    """An action by name, such as ADD(LEFT, BLUE), and the step count that the player saw when taking it."""

    action: Name
    steps: int = Field(ge=0, le=1_000)


@dataclass(frozen=True, slots=True)
class LoadedEpisode:
    """An episode's database row, task and current MDP state."""

    row: PlayedEpisode
    task: Task
    dynamics: Dynamics
    state: State

    @property
    def over(self) -> bool:
        """Whether the episode has ended."""
        return self.row.outcome is not None


def _find_task(services: AppServices, configuration: str, split: str, task_id: str | None) -> Task:
    """The task with that id, or a random well-spelt one for None. Responds with 404 if there is none."""
    tasks = services.tasks(configuration, split)
    with refusing(404):
        return tasks.by_id(secrets.choice(well_spelt_ids(tasks)) if task_id is None else task_id)


def find_loaded(connection: sqlite3.Connection, services: Services, episode_id: RandomId) -> LoadedEpisode:
    """An episode, replayed to its current state.

    Responds with 404 if there is no such episode, 409 if it belongs to another corpus.
    """
    row = find_episode(connection, episode_id)
    if row is None:
        raise HTTPException(404, "there is no such episode; start a new one")
    if row.corpus != services.corpus:
        raise HTTPException(409, f"this episode belongs to the corpus {row.corpus!r}, which is not being served")
    task = _find_task(services, row.configuration, row.split, row.task_id)
    dynamics = services.dynamics(row.configuration)
    state = dynamics.start(task)
    for index in row.actions:
        state = dynamics.step(state, dynamics.appearance.decode(index)).state
    return LoadedEpisode(row, task, dynamics, state)


def load_episode(services: Services, episode_id: RandomId) -> LoadedEpisode:
    """FastAPI dependency: the stored episode named in the path."""
    with services.database.read() as connection:
        return find_loaded(connection, services, episode_id)


Loaded = Annotated[LoadedEpisode, Depends(load_episode)]


@router.get("/", include_in_schema=False)
@router.get("/play", include_in_schema=False)
def play_page(request: Request, services: Services) -> Response:
    """The start page offers a task to play, too."""
    values = {"sizes": services.sizes(), "corpus": services.corpus}
    return render_page(request, "play.html", is_home=request.url.path == "/", **values)


@api.post("/episodes", status_code=201)
def begin(new: NewEpisode, services: Services) -> JSON:
    """Starts an episode."""
    task = _find_task(services, new.configuration, new.split, new.task_id)
    dynamics = services.dynamics(new.configuration)
    fields = {**new.model_dump(), "task_id": task.id, "corpus": services.corpus, "statement": task.statement}
    row = PlayedEpisode(id=secrets.token_urlsafe(16), **fields)
    with services.database.write() as connection:
        save_episode(connection, row)
    return _episode_body(LoadedEpisode(row, task, dynamics, dynamics.start(task)))


@api.get("/episodes/{episode_id}")
def episode(loaded: Loaded) -> JSON:
    """The current state of an episode."""
    return _episode_body(loaded)


@api.post("/episodes/{episode_id}/actions")
def act(episode_id: RandomId, taken: ActionTaken, services: Services) -> JSON:
    """Takes an action; an illegal one is refused."""
    with services.database.write() as connection:
        loaded = find_loaded(connection, services, episode_id)
        row = loaded.row
        dynamics = loaded.dynamics
        if loaded.over:
            raise HTTPException(409, "this episode is over; start a new one")
        if taken.steps != loaded.state.steps:
            raise HTTPException(409, f"this episode is already at step {loaded.state.steps}; reload it")
        action = named(taken.action)
        index = dynamics.appearance.encode(action)
        transition = dynamics.step(loaded.state, action)
        if transition.invalid is not None:
            raise HTTPException(409, f"Not done: {INVALID_EXPLANATIONS[transition.invalid]}.")
        row.actions = [*row.actions, index]
        row.reward += transition.reward
        if transition.result.ends:
            row.outcome = str(transition.outcome)
        save_episode(connection, row)
    return _episode_body(LoadedEpisode(row, loaded.task, dynamics, transition.state))


@api.get("/episodes/{episode_id}/legal")
def legal(loaded: Loaded) -> JSON:
    """Legal actions by the exact mask."""
    indices = [] if loaded.over else np.flatnonzero(loaded.dynamics.legal_mask(loaded.state)).tolist()
    return {"actions": [describe(loaded.dynamics.appearance.decode(index)) for index in indices]}


@api.post("/episodes/{episode_id}/solution")
def solution(episode_id: RandomId, services: Services) -> JSON:
    """The expert's solution; the database keeps whether it was requested before the episode's end."""
    with services.database.write() as connection:
        loaded = find_loaded(connection, services, episode_id)
        loaded.row.shown_solution = loaded.row.shown_solution or not loaded.over
        save_episode(connection, loaded.row)
    solved = services.solver(loaded.row.configuration).solve(loaded.task)
    return {
        "found": solved.solved,
        "proven_shortest": solved.proven_optimal,
        "reason": solved.reason,
        "start": scene_body(loaded.task.start),
        "steps": steps_body(loaded.dynamics, loaded.task.start, solved.actions),
    }


def _episode_body(loaded: LoadedEpisode) -> JSON:
    """An episode as its player sees it. The program stays hidden until the end."""
    row = loaded.row
    appearance = loaded.dynamics.appearance
    return {
        **pick(row, "id", "configuration", "split", "task_id", "outcome", "shown_solution"),
        **pick(loaded.task, "statement", "target"),
        "steps": loaded.state.steps,
        "actions_left": loaded.dynamics.horizon - loaded.state.steps,
        "reward": round(row.reward, 6),
        "actions": [describe(appearance.decode(index)) for index in row.actions],
        "over": loaded.over,
        "grid": appearance.grid,  # columns, rows; null in Tower
        "scene": scene_body(loaded.state.scene),
        "end": _end_body(loaded) if loaded.over else None,
        "removable": {} if loaded.over else removable_items(loaded.dynamics, loaded.state.scene),
    }


def _end_body(loaded: LoadedEpisode) -> JSON:
    """The rule that ended the episode, with the value of each part of the program."""
    task = loaded.task
    scene = loaded.state.scene
    return {
        "rule": OUTCOME_EXPLANATIONS[Outcome(loaded.row.outcome)],
        "program": task.program,
        "truth": task.truth(scene),
        "parts": parts_body(task.program, scene),
    }
