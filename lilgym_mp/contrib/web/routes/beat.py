"""/beat: ten tasks that a person and a trained agent both play, their score, and a picture of it to share."""

from __future__ import annotations

import io
from collections.abc import Sequence
from functools import lru_cache
from random import Random
from typing import Annotated, NamedTuple

from fastapi import APIRouter, HTTPException, Query, Request, Response

from lilgym_mp.contrib.web.app_services import AppServices, Services
from lilgym_mp.contrib.web.bodies import JSON, ConfigurationName, RandomId, SplitName
from lilgym_mp.contrib.web.responses import render_page
from lilgym_mp.contrib.web.routes.play import LoadedEpisode, load_episode
from lilgym_mp.contrib.web.runs import PARSER
from lilgym_mp.corpus.matching import well_spelt_ids
from lilgym_mp.evaluation import evaluate
from lilgym_mp.evaluation.film import ScoreLine, score_picture
from lilgym_mp.scene import Scene

router = APIRouter()
api = APIRouter(prefix="/api/beat", tags=["beat"])

TASKS = 10
AGENT_NAME = PARSER.partition(":")[2]
Episodes = Annotated[list[RandomId], Query(min_length=1, max_length=TASKS)]


class Row(NamedTuple):
    """A task, and how many actions each took to solve it; None: not solved."""

    statement: str
    target: bool
    scene: Scene  # in which the person stopped
    you: int | None
    agent: int | None
    shortest: int | None


@router.get("/beat", include_in_schema=False)
def beat_page(request: Request, services: Services) -> Response:
    """The page on which a person plays against the parsing agent."""
    has_agent = PARSER in services.runs.agents()
    return render_page(request, "beat.html", sizes=services.sizes(), agent=AGENT_NAME, has_agent=has_agent)


@api.get("/tasks")
def tasks(
    services: Services,
    configuration: ConfigurationName = "TowerFlipIt",
    split: SplitName = "dev",
    seed: Annotated[int, Query(ge=0, le=10**9)] = 0,
) -> JSON:
    """The ids of ten tasks; the same ones for the same arguments."""
    ids = well_spelt_ids(services.tasks(configuration, split))
    return {"tasks": Random(seed).sample(ids, min(TASKS, len(ids)))}


@api.get("/round")
def score(services: Services, episode: Episodes) -> JSON:
    """The score of the episodes that are over."""
    rows = _rows(services, episode)
    verdict, summary = _told(rows)
    shown = [{name: value for name, value in row._asdict().items() if name != "scene"} for row in rows]
    return {"rows": shown, "verdict": verdict, "summary": summary}


@api.get("/picture", response_class=Response)
def picture(services: Services, episode: Episodes) -> Response:
    """The same as a PNG image. Responds with 409 before an episode is over."""
    rows = _rows(services, episode)
    if not rows:
        raise HTTPException(409, "no episode is over yet")
    title = load_episode(services, episode[0]).row.configuration
    verdict, summary = _told(rows, "Player")
    lines = [
        ScoreLine(f"Make it {str(row.target).lower()}: {row.statement}", row.scene, (row.you, row.agent, row.shortest))
        for row in rows
    ]
    buffer = io.BytesIO()
    score_picture([f"{title}: {verdict}", summary], ["player", AGENT_NAME, "shortest"], lines).save(buffer, "PNG")
    return Response(buffer.getvalue(), media_type="image/png")


def _rows(services: AppServices, ids: Sequence[str]) -> list[Row]:
    loaded = [load_episode(services, each) for each in ids]
    return [_row(services, each) for each in loaded if each.over]


def _row(services: AppServices, loaded: LoadedEpisode) -> Row:
    row, task = loaded.row, loaded.task
    solved = row.outcome == "success" and not row.shown_solution
    others = _others(services, row.configuration, row.split, task.id)
    return Row(task.statement, task.target, loaded.state.scene, len(row.actions) if solved else None, *others)


@lru_cache(1_000)
def _others(services: AppServices, configuration: str, split: str, task_id: str) -> tuple[int | None, int | None]:
    """The actions with which the agent solves a task, and of a shortest solution."""
    agent = None
    if PARSER in services.runs.agents():
        settings = services.settings(configuration)
        policy = services.runs.agent(PARSER).policy(settings)
        (played,) = evaluate(policy, settings, split, task_ids=[task_id])
        agent = len(played.actions) if played.is_success else None
    return agent, services.shortest(configuration, services.tasks(configuration, split).by_id(task_id))


def _told(rows: Sequence[Row], player: str = "You") -> tuple[str, str]:
    """Who won, by tasks solved and then by actions taken for them, and the numbers."""
    own = [row.you for row in rows if row.you is not None]
    agents = [row.agent for row in rows if row.agent is not None]
    mine, other = (len(own), -sum(own)), (len(agents), -sum(agents))
    verdict = "A draw." if mine == other else f"{player if mine > other else AGENT_NAME} won."
    theirs = f"{AGENT_NAME} {len(agents)} in {sum(agents)}"
    shortest = f"The shortest solutions of all take {sum(row.shortest or 0 for row in rows)}."
    return verdict, f"{player} solved {len(own)} of {len(rows)} in {sum(own)} actions, {theirs}. {shortest}"
